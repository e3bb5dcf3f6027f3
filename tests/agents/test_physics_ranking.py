"""Scores do not hang on the physics engine: Pymunk and the equations of motion rank all policies alike."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import envs
from tools import physics_fidelity as fidelity

PAGE = (Path(__file__).parents[2] / "docs" / "physics.md").read_text()
every_task = pytest.mark.parametrize("env_id", envs.env_ids())


@every_task
def test_the_ranking_of_all_policies_survives_the_change_of_physics(env_id: str) -> None:
    found = [fidelity.scores(env_id, physics) for physics in fidelity.PHYSICS]
    medians = [{name: median for name, (median, _) in scores.items()} for scores in found]
    assert len(medians[0]) >= 5
    assert len(set(medians[0].values())) == len(medians[0])
    pymunk, exact = (sorted(scores, key=lambda name: scores[name]) for scores in medians)
    assert pymunk == exact

    factor, rows = fidelity.primary_metric(env_id).factor, {}
    for row in re.findall(rf"^\| {env_id} \| (\S+) \| [^|]+ \| (\S+) \| (\S+) \| \S+ \|$", PAGE, flags=re.MULTILINE):
        rows[row[0]] = [np.inf if cell == "never" else float(cell) for cell in row[1:]]
    assert rows.keys() == medians[0].keys()
    for name, numbers in rows.items():
        assert numbers == pytest.approx([factor * scores[name] for scores in medians], rel=0.02)


@every_task
def test_the_page_states_how_far_the_motions_are_apart(env_id: str) -> None:
    (row,) = re.findall(rf"^\| {env_id} \| (\S+) rad \| (\S+) rad \|$", PAGE, flags=re.MULTILINE)
    apart = fidelity.angles_apart(env_id)
    assert [np.median(apart), apart.max()] == pytest.approx([float(cell) for cell in row], rel=0.1)
    assert apart.min() > 0.0
    assert apart.max() < 1e-3
