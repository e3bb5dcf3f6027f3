"""The colours of every picture, as (red, green, blue)."""

Color = tuple[int, ...]

FLOOR = (243, 245, 248)
WORKSPACE = (250, 251, 253)
GRID = (229, 233, 239)
PANEL = (255, 255, 255)
BORDER = (220, 225, 232)
TRACK = (234, 238, 243)

INK = (38, 50, 71)
MUTED = (128, 140, 158)

ACCENT = (47, 128, 196)
GOOD = (46, 168, 124)
GOOD_TEXT = (24, 118, 84)
ON_ACCENT = (255, 255, 255)
WAITING = (240, 160, 60)
BAD = (219, 72, 78)

EARTH = (156, 128, 98)

LINK_BASE = (48, 62, 88)
LINK_HAND = (66, 122, 166)
JOINT = (250, 251, 253)
HAND = (235, 87, 87)

BELT = (86, 96, 112)
BELT_STRIPE = (104, 115, 132)
BELT_RAIL = (178, 187, 199)
ROLLER = (140, 150, 165)
ROLLER_SHINE = (203, 210, 220)

DARK: dict[str, Color] = {
    "FLOOR": (20, 25, 34),
    "WORKSPACE": (25, 31, 42),
    "GRID": (36, 44, 58),
    "PANEL": (29, 36, 48),
    "BORDER": (50, 60, 77),
    "TRACK": (44, 53, 69),
    "INK": (226, 232, 241),
    "MUTED": (147, 160, 180),
    "ACCENT": (88, 164, 228),
    "GOOD_TEXT": (96, 205, 160),
    "ON_ACCENT": (12, 20, 32),
    "LINK_BASE": (110, 130, 166),
    "LINK_HAND": (116, 176, 220),
    "JOINT": (20, 25, 34),
    "EARTH": (128, 105, 80),
    "BELT": (58, 68, 85),
    "BELT_STRIPE": (76, 88, 108),
    "BELT_RAIL": (92, 104, 124),
    "ROLLER": (98, 110, 130),
    "ROLLER_SHINE": (140, 152, 172),
}
"""Colours that differ on a dark page."""


def mix(first: Color, second: Color, share: float) -> Color:
    """Linear interpolation: ``first`` at share 0, ``second`` at share 1."""
    return tuple(round(a + share * (b - a)) for a, b in zip(first, second, strict=True))
