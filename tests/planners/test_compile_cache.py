"""Compiled functions are compiled again when source that they reach has changed, wherever their cache lies."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from importlib import reload
from pathlib import Path
from types import ModuleType

import numba
import pytest

from planners import compile_cache
from planners.compiled import calls

FILES = {
    "planners/__init__.py": "import planners.compile_cache",
    "planners/low.py": "from numba import njit\n@njit(cache=True)\ndef low(x): return x + 1.0",
    "planners/high.py": "from numba import njit\nfrom planners.low import (  # (a comment)\n    low,\n)\n"
    "@njit(cache=True)\ndef high(x): return low(x) * 10.0",
    "planners/other.py": "OTHER = 1.0",
    "envs/__init__.py": "",
    "envs/upper.py": "from planners.high import high",
    "mine/task.py": "from numba import njit\nimport helper\nhelp = helper.help\n"
    "@njit(cache=True)\ndef task(x): return help(x) + 0.5",
    "mine/helper.py": "from numba import njit\nfrom envs import upper\nthen = upper.high\n"
    "@njit\ndef help(x): return then(x) + 100.0",
    "plain/alone.py": "from numba import njit\n@njit(cache=True)\ndef alone(x): return x",
}

# Every step runs in a process of its own, forked from one that has imported numba.
STEPS = """
import os, sys, time, warnings
from pathlib import Path
import numba

def run(label):
    sys.stdout.flush()
    if child := os.fork():
        assert os.waitpid(child, 0)[1] == 0
        return
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        from planners.high import high
        from task import task
        value = task(0.0), high(0.0)
    misses = sum(f.stats.cache_misses.total() for f in (task, high))
    print(label, *value, misses, sum(one.category is RuntimeWarning for one in caught), flush=True)
    os._exit(0)

def edit(name, old, new):  # in place, with the time and the size of before
    path = Path(name)
    status = path.stat()
    path.write_text(path.read_text().replace(old, new))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))

run("first")
if len(sys.argv) > 1:
    edit("planners/other.py", "1.0", "2.0"); run("unrelated")
    edit("mine/helper.py", "100.0", "200.0"); run("helper")
edit("planners/low.py", "1.0", "2.0"); run("low")
"""


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    for name, source in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(source + "\n")
    source = Path(compile_cache.__file__).read_bytes()
    (tmp_path / "planners" / "compile_cache.py").write_bytes(source)
    return tmp_path


def run(packages: Path, code: str, *arguments: str, **environment: str) -> list[list[str]]:
    paths = os.pathsep.join(str(packages / name) for name in ("", "mine", "plain"))
    inherited = {name: value for name, value in os.environ.items() if name != "XDG_CACHE_HOME"}
    environment = {**inherited, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", **environment}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=packages,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    )
    return [line.split() for line in done.stdout.splitlines()]


BY_ADDRESS = {
    "planners/far.py": "from planners.compiled.calls import Kernel\nfrom planners.low import low\n"
    "def far(x): return low(x) * 3.0\nFAR = Kernel(far)",
    "mine/near.py": "from numba import njit\nfrom planners.compiled.calls import call_real\n"
    "@njit(cache=True)\ndef near(address, x): return call_real(address, x)",
}


def test_an_edit_behind_an_address_is_compiled_and_its_caller_is_not(packages: Path) -> None:
    (packages / "planners" / "compiled").mkdir()
    (packages / "planners" / "compiled" / "calls.py").write_bytes(Path(calls.__file__).read_bytes())
    for name, source in BY_ADDRESS.items():
        (packages / name).write_text(source + "\n")
    code = "from numba import float64\nfrom near import near\nfrom planners.far import FAR\n"
    code += "print(near(FAR.address(float64), 1.0))\n"
    code += "print(*(sum(f.stats.cache_misses.values()) for f in (near, FAR._compiled)))"
    assert run(packages, code, NUMBA_CACHE_DIR="") == [["6.0"], ["1", "1"]]
    low = packages / "planners" / "low.py"
    low.write_text(low.read_text().replace("1.0", "2.0"))
    assert run(packages, code, NUMBA_CACHE_DIR="") == [["9.0"], ["0", "1"]]
    assert run(packages, code, NUMBA_CACHE_DIR="") == [["9.0"], ["0", "0"]]


def make_read_only(packages: Path) -> None:
    """No ``__pycache__`` can be made, by root neither."""
    for folder in ("planners", "envs", "mine"):
        (packages / folder / "__pycache__").write_text("")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
@pytest.mark.parametrize("place", ["beside the source", "NUMBA_CACHE_DIR", "home", "nowhere"])
def test_an_edit_is_compiled_wherever_the_cache_lies(packages: Path, place: str) -> None:
    environment = {"NUMBA_CACHE_DIR": "", "XDG_CACHE_HOME": "", "HOME": str(packages / "home")}
    if place == "NUMBA_CACHE_DIR":
        environment["NUMBA_CACHE_DIR"] = str(packages / "chosen")
    if place in ("home", "nowhere"):
        make_read_only(packages)
        environment.pop("XDG_CACHE_HOME")
    if place == "nowhere":
        environment["HOME"] = os.devnull
    more = place == "home"
    steps = {
        label: tuple(map(float, values)) for label, *values in run(packages, STEPS, *["more"] * more, **environment)
    }
    caches = [path.name for path in packages.rglob("*.nbi")]
    if place == "nowhere":
        assert steps == {"first": (110.5, 10.0, 2, 1), "low": (120.5, 20.0, 2, 1)}
        assert not caches
    else:
        whole = {"unrelated": (110.5, 10.0, 0, 0), "helper": (210.5, 10.0, 1, 0), "low": (220.5, 20.0, 2, 0)}
        after = whole if more else {"low": (120.5, 20.0, 2, 0)}
        assert steps == {"first": (110.5, 10.0, 2, 0), **after}
        assert sorted(name.split("-")[0] for name in caches) == ["high.high", "low.low", "task.task"]


def test_without_a_home_no_folder_is_made_in_the_working_folder(packages: Path) -> None:
    make_read_only(packages)
    code = "import os; os.path.expanduser = lambda path: path\nfrom planners.low import low\nlow(1.0)"
    run(packages, "import warnings; warnings.simplefilter('ignore')\n" + code, HOME="", XDG_CACHE_HOME="")
    assert not list(packages.glob("~*"))


def test_functions_of_other_projects_are_left_to_numba(packages: Path) -> None:
    code = "import planners, alone; alone.alone(1.0); print(type(alone.alone._cache._impl.locator).__name__)"
    assert run(packages, code, NUMBA_CACHE_DIR="") == [["InTreeCacheLocator"]]


def imports_of(path: Path) -> set[str]:
    return {os.path.basename(file) for file in compile_cache._imports(path, path.read_bytes())}


@pytest.mark.parametrize(
    ("line", "reached"),
    [
        ("from package.one import name", {"one.py"}),
        ("from package import one", {"one.py"}),
        ("from package import one as name, two", {"one.py", "two.py"}),
        ("from package import (\n    one,  # (first)\n    two,\n)", {"one.py", "two.py"}),
        ("from package import one, \\\n    two", {"one.py", "two.py"}),
        ("from package import absent, one", {"__init__.py", "one.py"}),
        ("from package import *", {"__init__.py"}),
        ("import package.one as name, package.two", {"one.py", "two.py"}),
        ("import package.one; import package.two", {"one.py", "two.py"}),
        ("from . import one", {"one.py"}),
        ("from .two import name", {"two.py"}),
        ("from .. import package", {"__init__.py"}),
        ("def later():\n    from package.one import name", {"one.py"}),
        ("import numpy, os.path", set()),
    ],
)
def test_imports_are_found_however_they_are_written(tmp_path: Path, line: str, reached: set[str]) -> None:
    for name in ("__init__", "one", "two"):
        (tmp_path / "package").mkdir(exist_ok=True)
        (tmp_path / "package" / f"{name}.py").touch()
    path = tmp_path / "package" / "kernel.py"
    path.write_text(line + "\n")
    assert imports_of(path) == reached


def test_a_module_that_is_loaded_again_runs_its_new_code(
    packages: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    monkeypatch.syspath_prepend(packages / "plain")
    request.addfinalizer(lambda: sys.modules.pop("again", None))
    source = packages / "plain" / "again.py"
    text = "from numba import njit\nimport planners.typing\nimport again_low\n"
    text += "value = again_low.VALUE\n@njit(cache=True)\ndef again(): return value\n"
    (packages / "plain" / "again_low.py").write_text("VALUE = 1.0\n")
    source.write_text(text)
    import again_low  # type: ignore[import-not-found]

    module: ModuleType = __import__("again")
    assert module.again() == 1.0
    (packages / "plain" / "again_low.py").write_text("VALUE = 22.0\n")
    source.write_text(text + "# edited\n")
    reload(again_low)
    assert reload(module).again() == 22.0


@pytest.mark.parametrize("enabled", [True, False])
def test_no_garbage_is_collected_while_compiling(enabled: bool) -> None:
    """Afterwards it is again, if it was before; also when compiling fails."""

    def during() -> bool:
        raise NotImplementedError

    @numba.extending.overload(during)
    def type_it() -> Callable[[], bool]:
        seen.append(gc.isenabled())
        return lambda: True

    seen: list[bool] = []
    (gc.enable if enabled else gc.disable)()
    try:
        numba.njit(lambda: during())()
        with pytest.raises(numba.TypingError):
            numba.njit(lambda: during() + "text")()
        assert set(seen) == {False}
        assert gc.isenabled() == enabled
    finally:
        gc.enable()


FIRST_PLAN = """
from collections import Counter
import numpy as np
from numba.core import event
from planners import PLANAR_3R, FixedJoints, MotionProblem, plan

compiled = Counter()

class Listener(event.Listener):
    def on_start(self, started):
        compiled[started.data["dispatcher"].py_func.__module__.split(".")[0]] += 1

    def on_end(self, ended):
        pass

event.register("numba:compile", Listener())
plan(MotionProblem(PLANAR_3R, np.zeros(3), FixedJoints(np.full(3, 0.3)), 2.0), "quintic")
print(compiled["planners"], sum(compiled.values()))
"""


def test_a_first_plan_compiles_little(tmp_path: Path) -> None:
    """The quintic's plan and its measurement; the rest are NumPy functions that Numba compiles for them."""
    done = subprocess.run(
        [sys.executable, "-c", FIRST_PLAN],
        cwd=Path(compile_cache.__file__).parent.parent,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        check=True,
        capture_output=True,
        text=True,
    )
    own, altogether = map(int, done.stdout.split())
    assert 0 < own <= 24
    assert altogether <= 44
