"""How every test runs."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Programs that tests start import this checkout, like the tests themselves, whatever is installed.
os.environ["PYTHONPATH"] = os.pathsep.join(
    filter(None, [str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH")])
)

os.environ["PLANARM_PROCESSES"] = "1"  # pytest -n uses the processors itself

MARKERS = {
    "rl": ("stable_baselines3", 'pip install "planarm[rl]"'),
    "moviepy": ("moviepy", "pip install moviepy"),
    "cluster": ("ray", 'pip install "planarm[cluster]"'),
    "browser": ("playwright", "pip install playwright, and Chromium"),
}
"""The module that tests with a marker need, and how to get it."""

# The same examples in every run, so that a failure can be met again and belongs to the change that made it.
# `pytest --hypothesis-profile explore` draws new ones. The time of one is the machine's, and that of the first one the
# compiler's: there is no deadline.
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None)
settings.load_profile("same")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests whose marker names a module that is not installed."""
    missing = {marker: remedy for marker, (module, remedy) in MARKERS.items() if find_spec(module) is None}
    for item in items:
        for marker in item.iter_markers():
            if marker.name in missing:
                item.add_marker(pytest.mark.skip(reason=f"needs {missing[marker.name]}"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, as Playwright drives it."""
    api = pytest.importorskip("playwright.sync_api")
    path = os.environ.get("PLANARM_CHROMIUM") or shutil.which("chromium")
    if path is None:
        pytest.skip("needs Chromium: install it, or name it in PLANARM_CHROMIUM")
    with api.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield running
        running.close()
