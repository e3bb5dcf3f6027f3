"""``python -m tools.site`` builds the site of docs/ into ``site/``; every warning, such as a broken link, is an error.

``--serve`` then serves it on this machine alone, until Ctrl-C. Needs the extra ``docs``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Annotated

import tyro

ROOT = Path(__file__).parent.parent.parent


@dataclass(frozen=True)
class SiteOptions:
    """Build the site of docs/."""

    pages: Path = ROOT / "docs"
    """Folder with the pages."""
    out: Path = ROOT / "site"
    """Folder to write; what the next build can use again goes into OUT.cache and jupyter_execute beside it."""
    links: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Ask the network about every link to elsewhere instead."""
    serve: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Serve the site to this machine when it is built."""
    port: int = 8000
    """Port to serve at."""


def main(options: SiteOptions) -> int:
    """Build, and serve if asked; Sphinx's exit code."""
    try:
        from sphinx.cmd.build import build_main
    except ImportError:
        raise SystemExit('the site needs Sphinx: pip install -c constraints.txt -e ".[docs]"') from None

    out, cache = str(options.out), f"{options.out}.cache"
    builder = "linkcheck" if options.links else "html"
    how = ["-b", builder, "-n", "-W", "--keep-going", "-q", "-c", str(ROOT / "docs")]
    folders = ["-d", f"{cache}/pages", "-D", f"nb_execution_cache_path={cache}/notebooks"]
    code = int(build_main([*how, *folders, str(options.pages), out if builder == "html" else cache]))
    if code == 0 and options.serve:
        handler = partial(SimpleHTTPRequestHandler, directory=out)
        with ThreadingHTTPServer(("127.0.0.1", options.port), handler) as server:
            print(f"http://127.0.0.1:{options.port}, until Ctrl-C")
            server.serve_forever()
    return code


if __name__ == "__main__":
    raise SystemExit(main(tyro.cli(SiteOptions)))
