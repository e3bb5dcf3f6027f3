"""Pictures: describe a frame as a `Scene`, draw it with a `Renderer`. pygame-ce is imported on first use."""

from envs.rendering.renderer import Renderer
from envs.rendering.scene import Belt, Scene

__all__ = ["Belt", "Renderer", "Scene"]
