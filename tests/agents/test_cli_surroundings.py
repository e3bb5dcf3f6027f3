"""Commands with a full compile cache, and without compiled code."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path


def test_a_full_compile_cache_is_a_warning_and_no_error_of_printing(tmp_path: Path) -> None:
    code = "import sys\nfrom numba.core import caching\n"
    code += "def full(*_): raise OSError(28, 'No space left on device')\n"
    code += "caching.IndexDataCacheFile.save = full\n"
    code += "from agents.cli import main\nsys.exit(main(sys.argv[1:]))"
    command = shlex.split("plan --arm SCARA_50CM --start 0.2 1.5 --to-joints 1.2 0.8 --horizon 2 --planner quintic")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, *command], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert done.stderr.count("compiled functions are not kept for the next process") == 1
    assert "cannot print" not in done.stderr


def test_interpreted_kernels_are_refused_in_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "planarm", "paper-excavator", "--cycles", "1"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "planarm paper-excavator: this runs compiled code only; unset NUMBA_DISABLE_JIT\n"
