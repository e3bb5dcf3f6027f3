"""The table of presets in docs/extend/arms.md, from the arms themselves and the first lines of their files.

``python -m tools.arm_table`` writes it between the page's marks ``<!-- presets -->`` and ``<!-- end of presets -->``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from planners import arm_names, load_arm
from planners.files import write_text
from planners.robot.arm_files import FOLDER
from planners.robot.limits import JointLimits
from tools.site.marks import replaced

PAGE = Path(__file__).parent.parent / "docs" / "extend" / "arms.md"
_PAPERS = {
    "PLANAR_3R": "The arm of the least-torque paper: MinTorqueMove-v0.",
    "SCARA_1M": "The arm of the conveyor-tracking paper: ConveyorTrack-v0.",
    "SCARA_50CM": "The arm of ObstacleDodge-v0.",
}


def table() -> str:
    """The presets as a Markdown table."""
    rows = [
        "| name | links, m | torque limits, N m | joint ranges, deg | plane | what it is |",
        "|---|---|---|---|---|---|",
    ]
    for name in sorted(arm_names(), key=lambda name: (name not in _PAPERS, name)):
        arm = load_arm(name)
        lengths, torques = (
            ", ".join(f"{value:.4g}" for value in values) for values in (arm.lengths, arm.limits.torque)
        )
        plane = "vertical" if arm.gravity else "horizontal"
        what = _PAPERS.get(name) or (FOLDER / f"{name}.yaml").read_text().partition("\n")[0].removeprefix("# ")
        rows.append(f"| `{name}` | {lengths} | {torques} | {_ranges(arm.limits)} | {plane} | {what} |")
    return "\n".join(rows) + "\n"


def page() -> str:
    """The page with the table as it should be."""
    return replaced(PAGE.read_text(encoding="utf-8"), "presets", table())


def _ranges(limits: JointLimits) -> str:
    """Joint ranges in degrees."""
    pairs = zip(np.degrees(limits.angle_lower), np.degrees(limits.angle_upper), strict=True)
    return ", ".join(
        "free" if np.isinf(high) else f"+-{high:.4g}" if low == -high else f"{low:.4g} to {high:.4g}"
        for low, high in pairs
    )


if __name__ == "__main__":
    write_text(PAGE, page())
