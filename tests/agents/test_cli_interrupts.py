"""The command interrupted where nothing of it runs yet, or after it has run: no traceback, nothing left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

INTERRUPTED = """
import signal, sys
import agents.cli, agents.commands.rollout as rollout, planners.compile_cache as cache
def run(options):
    print(cache.temporary_folder("nothing is kept"), flush=True)
    signal.raise_signal(signal.SIGTERM)
rollout.run = run
sys.argv = ["planarm", "rollout", "ConveyorTrack-v0"]
sys.exit(agents.cli.main())
"""


def test_an_interrupted_command_leaves_no_temporary_folder() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert done.returncode == 143
    assert not Path(done.stdout.strip()).exists()


IMPORTING = """
import sys
class Interrupts:
    def find_spec(self, name, path, target=None):
        if name == "numba.core.caching":
            raise KeyboardInterrupt
import agents.cli
sys.meta_path.insert(0, Interrupts())
sys.argv = ["planarm", "list"]
sys.exit(agents.cli.main())
"""


def test_an_interrupt_in_the_middle_of_the_imports_is_no_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORTING], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
