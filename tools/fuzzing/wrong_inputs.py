"""Wrong shapes, types and values: one argument of a small valid problem, or one option, replaced by something else.

Refused is right if the message names the argument; accepted is right if the motion keeps its promises.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np

import planners
from planners import Arm, FixedHand, FixedJoints, JointLimits, MotionProblem, MovingHand, Obstacle, capabilities
from tools.fuzzing.promises import broken_promises

LARGE = 10**400
"""Beyond what a float holds."""

Argument = tuple[str, str]
"""What takes it, and its name."""


def bad_values() -> list[Any]:
    """Values of which few are right anywhere, made anew for each problem."""
    read_only = np.array([0.2, 0.4])
    read_only.setflags(write=False)
    numbers = [
        0,
        1,
        -1,
        2.5,
        -0.5,
        0.0,
        np.nan,
        np.inf,
        -np.inf,
        1e300,
        -1e300,
        1e-300,
        LARGE,
        -LARGE,
        2**70,
        True,
        1 + 2j,
    ]
    scalars = [
        np.float32(0.4),
        np.float16(0.4),
        np.int8(1),
        np.bool_(True),
        np.complex64(1j),
        Fraction(1, 3),
        Decimal("0.4"),
    ]
    others = [
        "x",
        "",
        "0.5",
        "optimal",
        b"x",
        None,
        object(),
        int,
        len,
        ...,
        range(2),
        slice(2),
        {},
        {"a": 1.0},
        {0.2, 0.4},
    ]
    lists = [
        [],
        (),
        [0.4],
        [0.2, 0.4],
        (0.2, 0.4, 0.6),
        7 * [0.1],
        [[0.2, 0.4]],
        [[0.2], [0.4]],
        [None, None],
        ["0.2", "a"],
    ]
    lists += [
        [0.2, np.nan],
        [0.2, np.inf],
        [0.2, LARGE],
        [0.2, 1j],
        [0.2, -0.4],
        [True, False],
        [[0.2, 0.4], 0.1],
        [0.2, [0.4]],
    ]
    arrays = [
        np.array(values, dtype)
        for values in ([0.2, 0.4], [0.2, 0.4, 0.6])
        for dtype in ["f2", "f4", "f8", "i1", "i8", "u1", "?", "c16", "O", "U3"]
    ]
    arrays += [np.zeros(0), np.array(0.4), np.zeros((2, 2)), np.zeros((1, 2)), np.zeros((2, 0)), np.full(2, np.nan)]
    arrays += [
        np.ma.masked_array([0.2, 0.4], [False, True]),
        np.array(["2020", "2021"], "M8[Y]"),
        read_only,
        np.array([0.4, 0.2])[::-1],
    ]
    pair, place, still = np.array([0.2, 0.4]), np.array([0.3, 0.9]), np.zeros(2)
    disc = Obstacle(place, still, 0.1)
    arm = Arm("other", [0.4], [1.0])
    ours = [arm, arm.limits, FixedJoints(pair), FixedHand(place), MovingHand(place, pair), disc, Obstacle, [disc]]
    return [*numbers, *scalars, *others, *lists, *arrays, *ours]


def attempt(generator: np.random.Generator) -> tuple[str, list[str]]:
    """Try one value at one place: what became of it, and the faults."""
    values = bad_values()
    where = list(_arguments())[int(generator.integers(0, len(_arguments())))]
    value = values[int(generator.integers(0, len(values)))]
    entry = _taking(where, generator)
    what = f"{where[0]} {where[1]} = {value!r:.60}"
    try:
        problem, motion = _plan(entry, where, value)
    except (ValueError, TypeError) as refusal:
        named = _named(where[1], str(refusal)) or isinstance(refusal, planners.Infeasible)
        return "refused", [] if named else [f"{what}: {type(refusal).__name__} {refusal}"]
    except Exception as error:
        return "exception", [f"{what}: {type(error).__name__} {error}"]
    if not isinstance(motion, planners.Trajectory):
        return "exception", [f"{what}: returned {motion!r:.80}"]
    options = {where[1]: value} if where[0] == "option" else {}
    return "accepted", [f"{what}: {fault}" for fault in broken_promises(problem, motion, entry, options)]


def _arguments() -> list[Argument]:
    kinds: list[Callable[..., Any]] = [Arm, JointLimits, FixedJoints, FixedHand, MovingHand, Obstacle, MotionProblem]
    places = [(kind.__name__, name) for kind in kinds for name in inspect.signature(kind).parameters]
    places += [("plan", name) for name in ("problem", "planner", "variant", "no_such_option")]
    return places + 3 * [("option", name) for name in dict.fromkeys(name for _, name in _options())]


def _options() -> list[tuple[capabilities.Variant, str]]:
    return [
        (entry, name)
        for _, entry in sorted(capabilities.VARIANTS.items())
        for name in inspect.signature(entry.plan).parameters
        if name != "problem"
    ]


def _taking(where: Argument, generator: np.random.Generator) -> capabilities.Variant:
    """A variant that has the option; for arguments of the problem a quick one that takes its target."""
    if where[0] == "option":
        having = [entry for entry, name in _options() if name == where[1]]
        return having[int(generator.integers(0, len(having)))]
    if where[0] == "MovingHand":
        return capabilities.VARIANTS["dpct", "optimal"]
    quick = [("dpct", "timing"), ("lagrange", "via"), ("trapezoid", "")]
    if where[0] not in ("FixedHand", "Obstacle"):
        quick += [("quintic", ""), ("dpct", "optimal"), ("apf", "field")]
    return capabilities.VARIANTS[quick[int(generator.integers(0, len(quick)))]]


def _plan(entry: capabilities.Variant, where: Argument, value: Any) -> tuple[MotionProblem, Any]:
    """Make the problem with the value in its place, and plan."""

    def made(kind: Callable[..., Any], **given: Any) -> Any:
        return kind(**{**given, **_placed(where, value, kind.__name__)})

    limits = made(JointLimits, torque=[30.0, 15.0], velocity=[3.0, 3.0], acceleration=[9.0, 9.0], angle=[2.8, 2.8])
    arm = made(Arm, name="arm", lengths=[0.4, 0.3], masses=[3.0, 2.0], limits=limits, gravity=0.0)
    kinds = entry.takes if entry.promises or entry.planner != "dpct" else ["moving hand"]
    if where[0] == "MovingHand" or "joints" not in kinds:
        target = made(MovingHand, position=[0.45, 0.35], velocity=[0.05, 0.0], acceleration=[0.0, 0.0])
    elif where[0] == "FixedHand":
        target = made(FixedHand, position=[0.35, 0.4])
    else:
        target = made(FixedJoints, q=[0.8, 0.9])
    obstacles = (
        (made(Obstacle, position=[-0.6, -0.3], velocity=[0.0, 0.0], radius=0.05),) if where[0] == "Obstacle" else ()
    )
    problem = made(MotionProblem, arm=arm, q=[0.3, 0.7], target=target, horizon=3.0, obstacles=obstacles, payload=0.2)
    if where[0] == "plan":
        given = {"problem": problem, "planner": entry.planner, "variant": entry.name, where[1]: value}
        return problem, planners.plan(**given)
    return problem, entry.plan(problem, **_placed(where, value, "option"))


def _placed(where: Argument, value: Any, taker: str) -> dict[str, Any]:
    return {where[1]: value} if where[0] == taker else {}


def _named(name: str, message: str) -> bool:
    """Whether a message names an argument, in the singular or with spaces."""
    words = {name, name.replace("_", " "), name.rstrip("s"), *NAMES.get(name, ())}
    return any(word in message for word in words)


NAMES = {
    "q": ("angles",),
    "qd": ("velocities", "velocity"),
    "lengths": ("links",),
    "coms": ("com",),
    "arm": ("Arm",),
    "problem": ("MotionProblem",),
    "masses": ("mass",),
    "inertias": ("inertia",),
    "no_such_option": ("option",),
}
"""Other words for arguments."""
