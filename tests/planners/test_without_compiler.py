"""With NUMBA_DISABLE_JIT planners work, or refuse with a sentence."""

from __future__ import annotations

import os
import subprocess
import sys

SCRIPT = """
from planners import SCARA_50CM, FixedHand, FixedJoints, MotionProblem, apf, quintic
from planners.excavator.kalman import FilterSettings, KalmanComputedTorque
quintic.plan(MotionProblem(SCARA_50CM, [0.2, 1.5], FixedJoints([0.3, 1.4]), 3.0))
print("planned")
for call in (
    lambda: apf.plan(MotionProblem(SCARA_50CM, [0.2, 1.5], FixedHand([0.3, 0.2]), 3.0)),
    lambda: KalmanComputedTorque(FilterSettings()),
):
    try:
        call()
    except ImportError as error:
        print(error)
"""


def test_planners_without_a_compiler_work_or_say_what_they_need() -> None:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        "planned",
        "the field among discs runs compiled code only; unset NUMBA_DISABLE_JIT",
        "the Kalman filter of the excavator runs compiled code only; unset NUMBA_DISABLE_JIT",
    ]
