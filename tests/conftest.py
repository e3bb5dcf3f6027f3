"""How every test runs."""

from __future__ import annotations

from hypothesis import settings

# The same examples in every run, so that a failure can be met again and belongs to the change that made it.
# `pytest --hypothesis-profile explore` draws new ones.
settings.register_profile("same", derandomize=True)
settings.register_profile("explore", derandomize=False)
settings.load_profile("same")
