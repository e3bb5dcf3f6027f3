"""`kill -9` at random moments of writing a file: the old content or the new, never a part."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CAMPAIGN = """
import os, random, signal, sys, time
from pathlib import Path
from planners.files import write_bytes

path, kills, size = Path(sys.argv[1]), 50, 2_000_000
path.write_bytes(size * b"a")
before, replaced = path.read_bytes(), 0
random.seed(0)
for _ in range(kills):
    child = os.fork()
    if child == 0:
        for number in range(10**9):
            write_bytes(path, size * bytes([98 + number % 20]))
    time.sleep(random.uniform(0.0, 0.04))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    content = path.read_bytes()
    assert len(content) == size and len(set(content)) == 1, (len(content), set(content))
    replaced += content != before
    before = content
print(replaced)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_file_is_old_or_new_after_kills_at_random_moments_of_writing(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CAMPAIGN, str(tmp_path / "file.bin")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 0  # some were replaced, so that kills met the writing
