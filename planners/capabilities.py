"""What every variant of every planner takes and keeps, declared beside it; refusals, and the check of what it returns.

A variant declares, for each kind of target, what it `Takes`. A problem outside of that is refused at once, with the
variants that take it. A motion that breaks what its variant promises is refused, never returned.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, ParamSpec

import numpy as np

from planners.checks import brief, checked_count, refuse_unknown, require_choice, require_finite
from planners.interrupts import plain_interrupts
from planners.options import checked_options
from planners.problem import FixedHand, FixedJoints, Infeasible, MotionProblem, MovingHand
from planners.promises import require_range, require_solved, require_start, require_within_limits
from planners.robot.limits import LIMIT_KINDS
from planners.trajectory import NoMotion, Trajectory, sampled_trajectory

TargetKind = Literal["joints", "hand", "moving hand"]
TARGETS: dict[type, TargetKind] = {FixedJoints: "joints", FixedHand: "hand", MovingHand: "moving hand"}

SMOOTHLESS = ("torque", "velocity", "acceleration", "angle")
"""Kinds of limit that a motion can keep although its acceleration jumps."""

MOST_LINKS = 6


@dataclass(frozen=True)
class Takes:
    """What a variant takes and keeps for one kind of target.

    Attributes:
        links: numbers of links.
        obstacles: whether discs are ``"avoided"``, or only ``"checked"``: the motion is planned without them, and
            refused if it touches one.
        keeps: kinds of limit that every returned motion keeps; a problem with finite limits of another kind is refused.
        needs: kinds of limit that must be finite.
        precision: largest distance from the target at the end, m or rad; more where the option ``tolerance`` says so.
            Ten times as much a second still counts as rest.
        accelerating: whether a moving target may accelerate.
        arrives: ``"early"`` as soon as it can, or ``"on time"`` at the horizon exactly.
    """

    links: tuple[int, ...] = tuple(range(1, MOST_LINKS + 1))
    obstacles: Literal["avoided", "checked"] = "checked"
    keeps: tuple[str, ...] = LIMIT_KINDS
    needs: tuple[str, ...] = ()
    precision: float = 1e-6
    accelerating: bool = True
    arrives: Literal["early", "on time"] = "early"

    def __post_init__(self) -> None:
        for name, example in {"links": (2, 3), "keeps": ("velocity",), "needs": ("velocity",)}.items():
            given = getattr(self, name)
            if isinstance(given, str) or not isinstance(given, Iterable):
                raise ValueError(f"{name} {brief(given)} must be several, as in {example}")
            object.__setattr__(self, name, tuple(given))
        if not self.links:
            raise ValueError("links () must be one number of links or more, as in (2, 3)")
        for count in self.links:
            checked_count("links", count)
        require_choice("obstacles", self.obstacles, ("avoided", "checked"))
        require_choice("arrives", self.arrives, ("early", "on time"))
        require_choice("accelerating", self.accelerating, (True, False))
        refuse_unknown(self.keeps, LIMIT_KINDS, "kind of limit")
        for kind in self.needs:  # what is not kept has to be infinite
            require_choice("needs", kind, self.keeps)
        require_finite("precision", self.precision, sign="not negative")

    def objection(self, problem: MotionProblem) -> str | None:
        """Why a problem is not taken, or None if it is."""
        n, limits = problem.arm.n_joints, problem.joint_limits
        if n not in self.links:
            return f"takes {_listed(self.links)} links, and {problem.arm.name} has {n}"
        if isinstance(problem.target, MovingHand) and problem.target.acceleration.any() and not self.accelerating:
            return "follows a target of constant velocity only"
        if n < 3 and isinstance(problem.target, FixedHand) and problem.target.orientation is not None:
            return f"goes without an orientation: {n} link{'s'[: n - 1]} cannot choose that of the hand; leave it out"
        for kind in LIMIT_KINDS:
            finite = np.isfinite(limits.array(kind))
            if kind in self.needs and not finite.all():
                return f"needs a finite {kind} limit of every joint; give limits"
            if kind not in self.keeps and finite.any():
                return f"keeps no {kind} limits; leave them out of the problem's limits"
        return None


@dataclass(frozen=True)
class Variant:
    """A variant of a planner.

    Attributes:
        planner, name: such as ``"dpct"`` and ``"optimal"``.
        plan: the planner, with the checks of this module.
        takes: what it takes, for each kind of target.
        promises: whether its motions are checked; a user's own planner promises nothing unless it says so.
    """

    planner: str
    name: str
    plan: Callable[..., Trajectory] = field(compare=False)
    takes: Mapping[TargetKind, Takes] = field(compare=False)
    promises: bool = True

    def __str__(self) -> str:
        """How messages name it: ``dpct (optimal)``."""
        return f"{self.planner} ({self.name})" if self.name else self.planner

    def objection(self, problem: MotionProblem) -> str | None:
        """Why a problem is not taken, or None if it is."""
        kind = TARGETS[type(problem.target)]
        if kind not in self.takes:
            return f"goes to a target of kind {_listed(self.takes)}, not {kind}"
        return self.takes[kind].objection(problem)


_variants: dict[tuple[str, str], Variant] = {}

OWN = ("dpct", "lagrange", "apf", "quintic", "trapezoid")
"""Names of planarm's own planners, in the order in which `plan` tries them."""

RESERVED = (
    "agent",
    "random",
    "follower",
    "kalman",
    "adaptive",
    "adaptive_computed_torque",
    "integral_computed_torque",
    "computed_torque",
)
"""Names of planarm's other policies, which a user's planner cannot have either."""


def all_variants() -> dict[tuple[str, str], Variant]:
    """Every variant by planner and name, also as ``VARIANTS``; see `variants_of` for the default.

    Planarm's own planners are imported when this is first asked, and come first.
    """
    for planner in OWN:
        import_module(f"planners.{planner}")
    ordered = sorted(_variants, key=lambda key: key[0] if key[0] in OWN else "user's")
    if ordered != list(_variants):  # whichever was imported first
        for key in ordered:
            _variants[key] = _variants.pop(key)
    return _variants


if TYPE_CHECKING:
    VARIANTS: dict[tuple[str, str], Variant]


def __getattr__(name: str) -> Any:
    if name == "VARIANTS":
        return all_variants()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


P = ParamSpec("P")


def variant(
    planner: str, name: str, takes: Mapping[TargetKind, Takes], *, promises: bool = True
) -> Callable[[Callable[P, Trajectory]], Callable[P, Trajectory]]:
    """Declare a function of a problem as a variant of a planner.

    A problem that it does not take is a ValueError at once, and a result that is no Trajectory a TypeError. A motion
    of another problem than the one asked is measured again. One that begins elsewhere, breaks a limit, touches an
    obstacle, is not continuous or misses the target is Infeasible, unless the variant promises nothing. Two options
    that a variant may have change this: ``checked=False`` returns whatever was planned, and ``contact="delay"`` also
    motions that touch an obstacle or end elsewhere, for planning again before they do.
    """

    def declare(function: Callable[P, Trajectory]) -> Callable[P, Trajectory]:
        @functools.wraps(function)
        def plan(*args: P.args, **kwargs: P.kwargs) -> Trajectory:
            problem = args[0] if args else kwargs.get("problem")
            if not isinstance(problem, MotionProblem):
                raise TypeError(f"{declared} plans a MotionProblem, not {type(problem).__name__}")
            _require_taken(declared, problem)
            if promises and isinstance(problem.target, FixedJoints) and "angle" in takes["joints"].keeps:
                require_range(problem, problem.target.q)
            with plain_interrupts(), _finite_arithmetic(declared):
                trajectory = _of_problem(declared, problem, function(*args, **checked_options(function, kwargs)))
            if promises and kwargs.get("checked", True):
                require_start(str(declared), trajectory, turned=kwargs.get("elbow", "start") != "start")
                require_within_limits(str(declared), trajectory)
                if kwargs.get("contact") != "delay":
                    precision = takes[TARGETS[type(problem.target)]].precision
                    wanted = max(precision, float(kwargs.get("tolerance", 0.0)))  # type: ignore[arg-type]
                    require_solved(str(declared), problem, trajectory, wanted, _avoiding(problem, declared))
            return trajectory

        declared = _variants[planner, name] = Variant(planner, name, plan, takes, promises)
        return plan

    return declare


def register(name: str, plan: Callable[..., Trajectory], takes: Mapping[TargetKind, Takes] | None = None) -> None:
    """Make a user's own planner known by name: to `plan`, to every environment as an expert, and to every command.

    Args:
        name: of the planner; registering the same name again replaces it.
        plan: a function of a `MotionProblem` that returns a Trajectory (see `sampled_trajectory`), or raises
            Infeasible. Its motions are measured, but not refused.
        takes: what it takes and keeps, for each kind of target. With this, problems outside of it are refused at once,
            and motions that break what it keeps too. By default any problem, and no promise.

    Raises:
        ValueError: if planarm itself has a planner or a policy of this name, or the name is not an identifier.
        TypeError: if ``plan`` cannot be called, or ``takes`` does not map kinds of target to `Takes`.
    """
    if not isinstance(name, str):
        raise TypeError(f"the name of a planner is a text, not {brief(name)}")
    if not callable(plan):
        raise TypeError(f"the planner {name} is {brief(plan)}; give a function of a MotionProblem")
    if takes is not None and not (isinstance(takes, Mapping) and set(takes) <= set(TARGETS.values())):
        raise TypeError(f"takes {brief(takes)} of {name} must map {_listed(map(repr, TARGETS.values()))} to Takes")
    for kind, taken in (takes or {}).items():
        if not isinstance(taken, Takes):
            raise TypeError(f"takes of {name} has {brief(taken)} for {kind!r}; write Takes(...)")
    if not name.isidentifier():
        raise ValueError(f"planner name {name!r} must be an identifier, such as my_planner")
    if name in OWN:
        raise ValueError(f"{name!r} is a planner of planarm; choose another name")
    if name in RESERVED:
        raise ValueError(f"{name!r} is a policy of planarm; choose another name")
    anything = dict.fromkeys(TARGETS.values(), Takes(obstacles="checked"))
    variant(name, "", takes or anything, promises=takes is not None)(plan)


def capability_rows() -> list[tuple[str, str, str, str, str, str, str]]:
    """Of each variant and target: planner, variant, target, links, obstacles, limits kept, arrival."""
    return [
        (
            entry.planner,
            entry.name,
            kind,
            _span(takes.links),
            takes.obstacles,
            ", ".join(takes.keeps) if entry.promises else "its own rules only",
            takes.arrives,
        )
        for entry in sorted(all_variants().values(), key=lambda entry: _order(entry.planner))
        for kind, takes in entry.takes.items()
    ]


def own_planners() -> dict[str, Callable[[MotionProblem], Trajectory]]:
    """The planners that users have registered, by name."""
    return {planner: entry.plan for (planner, _), entry in _variants.items() if planner not in OWN}


def plan(problem: MotionProblem, planner: str | None = None, variant: str | None = None, **options: Any) -> Trajectory:
    """Plan a motion with a planner and variant, or with the first that can.

    Args:
        problem: the motion asked for.
        planner: such as ``"dpct"``; when left out, all that take the problem and promise to solve it are tried in turn
            until one does, first those that avoid obstacles where there are any.
        variant: of the planner; its default when left out.
        options: of the variant.

    Raises:
        Infeasible: if no motion solves the problem, with the reason of the first planner tried, and what the others
            answered.
        ValueError: if a name or an option is unknown, or nothing takes the problem.
    """
    if planner is not None:
        require_choice("planner", planner, _names())
        return plan_variant(planner, variants_of(planner)[0] if variant is None else variant, problem, options)
    if variant is not None or options:
        raise ValueError("a variant and options need a planner: give planner, such as 'dpct'")
    if not isinstance(problem, MotionProblem):
        raise TypeError(f"plan takes a MotionProblem, not {type(problem).__name__}")
    able = _able(problem)
    if not able:
        raise ValueError(f"no planner takes this problem: {'; '.join(_objections(problem))}")
    kind = TARGETS[type(problem.target)]

    def rank(entry: Variant) -> tuple[bool, int]:
        aimless = bool(problem.obstacles) and entry.takes[kind].obstacles != "avoided"
        return aimless, _order(entry.planner)

    able.sort(key=rank)
    failures = []
    for entry in able:
        try:
            return entry.plan(problem)
        except Infeasible as failure:
            failures.append(failure)
    first, *others = failures
    if not others:
        raise first
    answers = ", ".join(f"{entry}: {failure.reason}" for entry, failure in zip(able[1:], others, strict=True))
    raise Infeasible(first.reason, f"{able[0]}: {first.message}; also tried {answers}", **first.details)


def plan_variant(planner: str, name: str, problem: MotionProblem, options: Mapping[str, Any]) -> Trajectory:
    """Plan a motion with a variant of a planner, by their names and with its options.

    Raises:
        Infeasible: if no motion solves the problem, with the reason.
        ValueError: if the variant or an option is unknown, or an option is out of range.
    """
    require_choice("variant", name, variants_of(planner))
    function = all_variants()[planner, name].plan
    allowed = [option for option in inspect.signature(function).parameters if option != "problem"]
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise ValueError(f"variant {name!r} has no option {', '.join(unknown)}; it has {', '.join(allowed)}")
    return function(problem, **options)


def variants_of(planner: str) -> list[str]:
    """Names of a planner's variants, the default first and the paper's own last."""
    return sorted((name for of, name in all_variants() if of == planner), key=lambda name: name == "paper")


def _require_taken(declared: Variant, problem: MotionProblem) -> None:
    """Refuse a problem that a variant does not take, with the variants that do."""
    objection = declared.objection(problem)
    if objection is not None:
        able = [str(other) for other in _able(problem)]
        advice = f"{', '.join(able)} can" if able else "no variant can"
        raise ValueError(f"{declared} {objection}; {advice}")


def _of_problem(declared: Variant, problem: MotionProblem, motion: Any) -> Trajectory:
    """What a variant has returned, measured for the problem that was asked."""
    if not isinstance(motion, Trajectory):
        raise TypeError(f"{declared} returned {brief(motion)}; a planner returns a Trajectory or raises Infeasible")
    if motion.problem is problem or motion.problem == problem:
        return motion
    kept = {name: getattr(motion, name) for name in ("planner", "cost", "rendezvous_time", "rides_until")}
    return sampled_trajectory(problem, motion.t, motion.q, motion.qd, motion.qdd, **kept)


@contextmanager
def _finite_arithmetic(declared: Variant) -> Iterator[None]:
    """Refuse a problem whose numbers are so far apart that a planner of planarm divides by 0, or leaves the floats."""
    if declared.planner not in OWN:
        yield
        return
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            yield
    except (ArithmeticError, NoMotion) as error:
        message = f"{declared} cannot compute with numbers that are so far apart ({error}); give a horizon, limits"
        raise Infeasible("limits", f"{message} and a start velocity that fit each other and the arm") from error


def _able(problem: MotionProblem) -> list[Variant]:
    """The variants that take a problem and promise what they keep."""
    return [entry for entry in all_variants().values() if entry.promises and entry.objection(problem) is None]


def _avoiding(problem: MotionProblem, failed: Variant) -> str:
    """Advice for a problem whose obstacles are in the way of the motion of one variant."""
    kind = TARGETS[type(problem.target)]
    others = [entry for entry in _able(problem) if entry != failed]
    able = [str(entry) for entry in others if entry.takes[kind].obstacles == "avoided"]
    return f"{', '.join(able)} can avoid obstacles" if able else "no other variant avoids obstacles on the way to it"


def _names() -> list[str]:
    return list(dict.fromkeys(planner for planner, _ in all_variants()))


def _objections(problem: MotionProblem) -> list[str]:
    return [f"{entry} {entry.objection(problem) or 'promises no solution'}" for entry in all_variants().values()]


def _order(planner: str) -> int:
    """Place of a planner in lists: planarm's own first."""
    return OWN.index(planner) if planner in OWN else len(OWN)


def _span(links: tuple[int, ...]) -> str:
    return f"{links[0]} to {links[-1]}" if len(links) > 1 else str(links[0])


def _listed(values: Iterable[object]) -> str:
    *first, last = map(str, values)
    return f"{', '.join(first)} or {last}" if first else last
