"""Arms from names, files and mappings: the same arm back, presets as their files say, and refusals of bad files."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import PLANAR_3R, SCARA_50CM, Arm, JointLimits, arm_document, arm_names, load_arm
from planners.documents import parse_json, parse_yaml, read_document
from planners.excavator.machine import EXCAVATOR
from planners.excavator.plane import JOINTS, planar_bodies
from planners.robot.arm_files import FOLDER

MINE = """
lengths_m: [0.42, 0.31]
masses_kg: [6, 4.5]
gravity_m_s2: 9.81
base_m: [0.1, -0.2]
link_radius_m: 5.0e-2
limits:
  torque_N_m: [40, 15]
  velocity_deg_s: 200
  acceleration_rad_s2: [20.0, 1e1]
  angle_deg: [[-30, 210], 150]
"""


def test_a_file_gives_an_arm_with_its_units_applied(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(MINE)
    arm = load_arm(file)
    limits = JointLimits(
        torque=[40, 15],
        velocity=math.radians(200.0),
        acceleration=[20, 10],
        angle=[tuple(np.radians([-30.0, 210.0])), math.radians(150.0)],
    )
    assert arm == Arm("mine", [0.42, 0.31], [6, 4.5], limits, gravity=9.81, base=(0.1, -0.2), link_radius=0.05)
    assert load_arm(str(file)) == load_arm(yaml.safe_load(MINE) | {"name": "mine"}) == arm
    (tmp_path / "mine.json").write_text(json.dumps(arm_document(arm)))
    assert load_arm(tmp_path / "mine.json") == arm


def test_an_arm_and_a_name_are_arms() -> None:
    assert load_arm(SCARA_50CM) is SCARA_50CM
    assert load_arm("PLANAR_3R") is PLANAR_3R
    assert arm_document("so101") == arm_document(load_arm("so101"))


@st.composite
def arms(draw: st.DrawFn) -> Arm:
    n = draw(st.integers(1, 6))
    numbers = lambda low, high: draw(st.lists(st.floats(low, high), min_size=n, max_size=n))  # noqa: E731
    limits = {
        kind: [math.inf if draw(st.booleans()) else value for value in numbers(1e-3, 1e5)]
        for kind in ("torque", "velocity", "acceleration", "jerk")
    }
    angle = [draw(st.sampled_from([math.inf, abs(a) + 0.1, (a, a + b)])) for a, b in zip(
        numbers(-9.0, 9.0), numbers(0.01, 9.0), strict=True)]  # fmt: skip
    return Arm(
        draw(st.text(max_size=9)),
        numbers(1e-3, 5.0),
        numbers(1e-3, 1e3),
        JointLimits(**limits, angle=angle),
        coms=numbers(0.0, 5.0),
        inertias=numbers(1e-6, 1e3),
        gravity=draw(st.floats(-20.0, 20.0)),
        base=[draw(st.floats(-5.0, 5.0)), 0.0],
        link_radius=draw(st.floats(0.0, 0.3)),
    )


@given(arms())
@settings(deadline=None, max_examples=30)
def test_a_document_leads_back_to_the_same_arm(arm: Arm) -> None:
    """To the bit, through strict JSON and through YAML."""
    document = arm_document(arm)
    assert load_arm(document) == arm
    assert load_arm(json.loads(json.dumps(document, allow_nan=False))) == arm
    assert load_arm(parse_yaml(yaml.safe_dump(document), "it")) == arm
    assert arm_document(load_arm(document)) == document


@pytest.mark.parametrize("name", arm_names())
def test_every_preset_is_an_arm_that_can_hold_itself(name: str) -> None:
    arm = load_arm(name)
    assert arm.name == name
    assert 1 <= arm.n_joints <= 6
    assert np.isfinite(arm.limits.array("torque")).all()
    assert load_arm(arm_document(arm)) == arm
    rng = np.random.default_rng(0)
    bounds = np.maximum(arm.limits.angle_lower, -np.pi), np.minimum(arm.limits.angle_upper, np.pi)
    q = rng.uniform(*bounds, (200, arm.n_joints))
    assert (np.abs(arm.bias(q, np.zeros_like(q))) < 0.9 * arm.limits.array("torque")).all()


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.yaml")), ids=lambda file: file.stem)
def test_files_of_presets_say_where_their_numbers_come_from(file: Path) -> None:
    document = read_document(file)
    assert document["name"] == file.stem
    assert len(document["source"]) > 50
    assert "estimated" in document["source"]
    limits = load_arm(file.stem).limits
    assert np.isfinite([limits.array("velocity"), limits.array("acceleration"), limits.angle_half]).all()


def test_there_are_presets_with_ranges_that_are_not_symmetric() -> None:
    assert len(arm_names()) >= 9
    assert sum(load_arm(name).limits.angle_middle.any() for name in arm_names()) >= 4


def test_the_excavator_is_the_machine_of_the_excavator_tasks() -> None:
    arm, bodies = load_arm("excavator"), planar_bodies(EXCAVATOR)
    tip = float(np.hypot(*bodies.tip))
    np.testing.assert_allclose(arm.lengths, [*bodies.lengths, tip], rtol=1e-5)
    np.testing.assert_allclose(arm.masses, bodies.masses)
    along = np.array([[1.0, 0.0], [1.0, 0.0], bodies.tip / tip])
    np.testing.assert_allclose(arm.coms, np.einsum("ij,ij->i", bodies.coms, along), rtol=1e-5)
    about_joints = bodies.inertias + bodies.masses * np.einsum("ij,ij->i", bodies.coms, bodies.coms)
    np.testing.assert_allclose(arm.inertias + np.array(arm.masses) * np.square(arm.coms), about_joints, rtol=1e-5)
    assert arm.limits.torque == EXCAVATOR.limits.torque[JOINTS]
    assert arm.limits.velocity == EXCAVATOR.limits.velocity[JOINTS]
    turned = math.atan2(bodies.tip[1], bodies.tip[0])
    np.testing.assert_allclose(arm.limits.angle_middle, [0.0, 0.0, turned], atol=1e-4)
    np.testing.assert_allclose(arm.limits.angle_half, EXCAVATOR.limits.angle_half[JOINTS])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length_m": [1.0]}, r'unknown key of arm "length_m"; did you mean "lengths_m"\?'),
        ({"lengths": [1.0]}, 'did you mean "lengths_m"'),
        ({"limits": {"torque": [1.0, 1.0]}}, r'unknown key of limits "torque"; did you mean "torque_N_m"\?'),
        ({"limits": {"angle_rad": 1.0, "angle_deg": 60.0}}, "angle limits are given in two units"),
        ({"limits": [1.0, 2.0]}, r"limits \[1.0, 2.0\] must be keys and values, as in torque_N_m: \[10.0, 4.0\]"),
        ({"limits": {"torque_N_m": [1.0, -1.0]}}, r"torque limits \(1.0, -1.0\) must be positive"),
        ({"lengths_m": [1.0, "long"]}, r"lengths \[1.0, 'long'\] must be numbers, as in \(0.4, 0.3\)"),
        ({"lengths_m": [1.0, math.nan]}, r"lengths \(1.0, nan\) must be finite"),
        ({"masses_kg": [1.0]}, "1 masses for 2 links"),
        ({"gravity_m_s2": "down"}, "gravity 'down' must be a number"),
        ({"gravity_m_s2": "1_0"}, "gravity '1_0' must be a number"),
        ({"base_m": 1.0}, r"base \(1.0,\) must be 2 finite numbers"),
        ({"name": 3}, "name 3 must be a text"),
    ],
)
def test_bad_documents_are_refused_with_what_is_allowed(changes: dict[str, Any], message: str) -> None:
    good = {"lengths_m": [1.0, 0.5], "masses_kg": [1.0, 1.0]}
    load_arm(good)
    with pytest.raises(ValueError, match=message):
        load_arm(good | changes)


def test_missing_keys_names_and_files_are_named() -> None:
    with pytest.raises(ValueError, match="arm has no masses_kg; an arm needs lengths_m and masses_kg"):
        load_arm({"lengths_m": [1.0]})
    with pytest.raises(ValueError, match=r"no file my\.yaml; the arms known by name are PLANAR_3R, SCARA_1M"):
        load_arm("my.yaml")
    with pytest.raises(ValueError, match=r'unknown arm .* "SCARA_50"; did you mean "SCARA_50CM"\?'):
        load_arm("SCARA_50")
    with pytest.raises(ValueError, match=r"no file x+\.yaml"):
        load_arm(5000 * "x" + ".yaml")
    with pytest.raises(ValueError, match="7 is no arm; give an Arm, a name, the path of a YAML or JSON file, or a"):
        load_arm(7)  # type: ignore[arg-type]


BOMB = "a: &a [x, x]\n" + "\n".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [*{chr(97 + i)}, *{chr(97 + i)}]" for i in range(20)
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "references .* are not read"),
        ("lengths_m: !!python/tuple [1.0]", "tags .* are not read"),
        ("lengths_m: [1.0]\nlengths_m: [2.0]", '"lengths_m" is given twice'),
        ("[" * 5000, "levels of lists and mappings|is no YAML"),
        ("lengths_m: [", "is no YAML"),
        ("masses_kg: [1, 1]\nlengths_m: [1_0, 0b11, 1_0.5]", r"lengths \['1_0', '0b11', '1_0.5'\] must be numbers"),
        ("? [a, b]\n: 1", "is no YAML|cannot be a key"),
        ("when: 2026-99-99", "is no YAML"),
        ("when: 2026-01-01", "2026-01-01 is read as a date: put it in quotes"),
        ("1: [1.0]", "the key 1 is no text: put it in quotes"),
        ("lengths_m: [0x" + 40 * "f" + "]", "an integer of 160 bits; 64 are the most"),
        ("[1," + 30_000 * "1," + "]", "must hold the keys and values of an arm"),
        ("just words", "must hold the keys and values of an arm"),
        ("- 1.0", "must hold the keys and values of an arm"),
        ("", "must hold the keys and values of an arm"),
        ("# " + 70_000 * "x", "larger than 64 KiB"),
    ],
    ids=[
        "bomb",
        "tag",
        "twice",
        "deep",
        "cut",
        "underscores",
        "key",
        "no-date",
        "date",
        "number",
        "huge",
        "long",
        "text",
        "list",
        "empty",
        "large",
    ],
)
def test_files_that_are_no_plain_yaml_are_refused_at_once(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        load_arm(file)


def test_files_that_are_no_json_or_no_text_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "bad.json"
    for text, message in (
        ("{", "is no JSON"),
        ('{"a": 1, "a": 2}', '"a" is given twice'),
        ("[" * 60_000, "is no JSON"),
        ("[" * 13 + "]" * 13, "more than 12 levels of lists and mappings"),
        ('{"a": ' + 400 * "9" + "}", "an integer of 1329 bits; 64 are the most"),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=message):
            load_arm(file)
    file.write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_document(file) == {"a": 1}
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(ValueError, match="no text in UTF-8"):
        load_arm(file)
    with pytest.raises(ValueError, match="it is no file"):
        read_document(tmp_path)


@given(st.text(max_size=200))
@settings(deadline=None)
def test_any_text_is_read_or_refused(text: str) -> None:
    for parse in (parse_yaml, parse_json):
        with suppress(ValueError):
            parse(text, "it")
