"""The site of docs/: its pages are what the code says; it builds without a warning and loads nothing from elsewhere."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tools.site import environments

ROOT = Path(__file__).parent.parent
PUBLIC = [
    *("envs", "envs.experts", "envs.rendering", "agents", "planners", "planners.control", "planners.excavator"),
    *("planners.dpct", "planners.lagrange", "planners.apf"),
]


@pytest.mark.parametrize("path", environments.pages(), ids=lambda path: path.stem)
def test_the_page_of_an_environment_is_what_its_docstring_card_and_leaderboard_say(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == environments.pages()[path], "run python -m tools.site.environments"


@pytest.mark.parametrize("package", ["agents", "envs"])
def test_what_is_loaded_when_asked_for_is_listed_on_its_page_of_the_reference(package: str) -> None:
    listed = re.findall(
        r"^\.\. auto(?:class|function):: (\w+)$", (ROOT / f"docs/api/{package}.md").read_text(), flags=re.MULTILINE
    )
    assert sorted(import_module(package).__all__) == sorted(listed)


def build(pages: Path, out: Path) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("myst_nb", reason='needs pip install "planarm[docs,rl,viz]"')
    command = [sys.executable, "-m", "tools.site", "--pages", str(pages), "--out", str(out)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500, check=False)


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site."""
    out = tmp_path_factory.mktemp("site") / "site"
    done = build(ROOT / "docs", out)
    assert done.returncode == 0, done.stderr
    return out


@pytest.mark.docs
def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe|link)\b[^>]*?(?:src|href)="([^"]+)"', text)
        assert loaded
        assert not [place for place in loaded if re.match(r"(https?:)?//", place)], page


@pytest.mark.docs
def test_the_reference_has_everything_public(site: Path) -> None:
    from sphinx.util.inventory import InventoryFile

    with (site / "objects.inv").open("rb") as file:
        entries = InventoryFile.load(file, "", lambda base, path: path)
    found = {name.rpartition(".")[2] for kind in entries.values() for name in kind}
    for package in PUBLIC:
        module = import_module(package)
        names = {name for name in module.__all__ if not isinstance(getattr(module, name), ModuleType)}
        assert names
        assert not names - found, package


@pytest.mark.docs
def test_a_bad_link_anchor_formula_or_name_ends_the_build(tmp_path: Path) -> None:
    pages = tmp_path / "pages"
    pages.mkdir()
    (pages / "index.md").write_text(
        "# Page\n\n[one](none.md), [two](#no-such-place), $a^2$, $\\tilde x_1$ and $\\nosuchmacro$\n\n"
        "```{eval-rst}\n`planners.no_such_name` and `planners.Arm`\n```\n"
    )
    done = build(pages, tmp_path / "site")
    assert done.returncode != 0
    for complaint in ("none.md", "no-such-place", "nosuchmacro", "planners.no_such_name"):
        assert complaint in done.stderr
    assert "planners.Arm" not in done.stderr
    shown = re.sub(r"\s+(?=<)", "", (tmp_path / "site/index.html").read_text())
    assert "<msup><mi>a</mi><mn>2</mn></msup>" in shown
    assert "munder" not in shown  # the index of an accented letter is beside it


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *args: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.mark.docs
@pytest.mark.browser
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")])
def test_pages_open_without_complaint_at_any_width(
    browser: Any, address: str, site: Path, width: int, scheme: str
) -> None:
    context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme)
    page, complaints = context.new_page(), []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "request",
        lambda request: None if request.url.startswith((address, "data:")) else complaints.append(request.url),
    )
    for file in sorted(site.rglob("*.html")):
        page.goto(address + file.relative_to(site).as_posix())
        wide = page.evaluate("document.documentElement.scrollWidth")
        assert wide <= width, f"{file.name} is {wide} wide"
        assert complaints == [], file.name
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", background)[:3])) < 200) == (scheme == "dark")
    context.close()


@pytest.mark.docs
@pytest.mark.browser
def test_the_search_finds_an_environment(browser: Any, address: str) -> None:
    page = browser.new_page()
    page.goto(f"{address}search.html?q=settling")
    page.wait_for_selector("#search-results li a")
    assert "ConveyorTrack-v0" in page.inner_text("#search-results")
    page.close()
