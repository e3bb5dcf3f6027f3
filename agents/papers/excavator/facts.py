"""The results of the excavator paper as statements, with the numbers that show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from agents.papers.excavator.runs import (
    ALL_TOGETHER,
    CENTRE_OFF,
    DEFAULT,
    FIXED,
    INTEGRAL,
    NOMINAL,
    PAPER,
    PULL,
    PUSH,
    Case,
    NamedController,
)
from agents.papers.report import Fact, Record
from planners.excavator import EXCAVATOR, forward_kinematics, inverse_kinematics
from planners.typing import Array

POSTURES = 10_000


def facts(payloads: Sequence[Record], mismatched: Sequence[Record]) -> Iterator[Fact]:
    """All facts, from the records of :mod:`agents.papers.excavator.runs`."""
    own = _of(payloads, DEFAULT, NOMINAL)
    if loaded := [row for row in own if row["mass"]]:
        (first, last), (_, last_integral) = (_shares(payloads, DEFAULT, baseline) for baseline in (FIXED, INTEGRAL))
        integral = _shares(payloads, INTEGRAL, FIXED)[1]
        yield Fact(
            f"{DEFAULT.title}: the error of the joints is at most {_percent(first)} of that of computed torque in the "
            f"first cycle (wanted: 8 %) and {_percent(last)} in the last (0.5 %), and {_percent(last_integral)} of "
            f"that of computed torque with an integral (5 %). The integral alone has {_percent(integral)} of the error "
            "of computed torque: a comparison without it shows little.",
            {
                "first_of_fixed": first,
                "last_of_fixed": last,
                "last_of_integral": last_integral,
                "integral_of_fixed": integral,
            },
        )

        first = max(abs(row["first"]["mass_estimate"] / row["mass"] - 1.0) for row in loaded)
        swing = max(row["last"]["mass_error"] / row["mass"] for row in loaded)
        yield Fact(
            f"{DEFAULT.title}: after one cycle the mass is estimated within {_percent(first)} (wanted: 1 %); in the "
            f"last its error is at most {_percent(swing)}.",
            {"after_first_cycle": first, "worst_in_last": swing},
        )

    joints, tip = (max(row["last"][name] for row in own) for name in ("joints", "tip"))
    yield Fact(
        f"{DEFAULT.title}: in the last cycle at most {np.degrees(joints):.4f} deg (wanted: 0.02) and "
        f"{1e3 * tip:.2f} mm at the tip (1), whatever the payload.",
        {"joints": joints, "tip": tip},
    )

    _, share = _shares(mismatched, DEFAULT, INTEGRAL, ALL_TOGETHER)
    tip = max(row["last"]["tip"] for row in _of(mismatched, DEFAULT, ALL_TOGETHER))
    yield Fact(
        f"{DEFAULT.title}, all together: at most {_percent(share)} of the error of computed torque with an integral "
        f"(wanted: a third), {1e3 * tip:.1f} mm at the tip (5).",
        {"last_of_integral": share, "tip": tip},
    )

    heaviest = {entry: _of(mismatched, entry, CENTRE_OFF)[-1] for entry in (PAPER, INTEGRAL, DEFAULT)}
    errors = {entry.title: float(np.degrees(row["last"]["joints"])) for entry, row in heaviest.items()}
    offset = ", ".join(f"{value:g}" for value in CENTRE_OFF.offset)
    yield Fact(
        f"A mass is not enough: with the centre of {heaviest[PAPER]['mass']:g} kg off by ({offset}) m the error of the "
        "joints is " + ", ".join(f"{value:.3f} deg ({title})" for title, value in errors.items()) + ".",
        errors,
    )

    yield outside_force(mismatched)
    yield round_trip()
    yield printed_sign()


def outside_force(mismatched: Sequence[Record]) -> Fact:
    """What forces on the tip do to each law with the lightest of the payloads."""
    values: Record = {}
    parts = []
    for case in (PUSH, PULL):
        rows = {entry.title: _of(mismatched, entry, case)[0] for entry in (INTEGRAL, PAPER, DEFAULT)}
        errors = {title: float(np.degrees(row["last"]["joints"])) for title, row in rows.items()}
        values[case.title] = errors
        parts.append(f"{case.title}: " + ", ".join(f"{value:.3f} deg ({title})" for title, value in errors.items()))
    pulled = _of(mismatched, PAPER, PULL)[0]
    values["mass_error"] = pulled["last"]["mass_error"]
    return Fact(
        f"Forces on the tip from outside, {pulled['mass']:g} kg. {'; '.join(parts)}. The paper's law is off by "
        f"up to {values['mass_error']:.0f} kg in the mass under the pull: it adapts parameters of the arm, and a force "
        "from outside is none.",
        values,
    )


def round_trip() -> Fact:
    """Inverse kinematics of random postures, and forward kinematics of every branch."""
    q = _random_postures()
    tip, axis = forward_kinematics(q)
    branches = inverse_kinematics(tip, axis)
    found = ~np.isnan(branches.q[..., 0])
    tips, axes = forward_kinematics(np.where(found[..., None], branches.q, 0.0))
    position = np.linalg.norm(tips - tip[:, None], axis=-1)[found].max()
    direction = np.linalg.norm(axes - axis[:, None], axis=-1)[found].max()
    turn = np.abs(np.angle(np.exp(1j * (branches.q - q[:, None])))).max(axis=-1)
    recovered = float((np.nanmin(np.where(found, turn, np.inf), axis=-1) < 1e-6).mean())
    share = float((found.sum(axis=-1) == 8).mean())
    return Fact(
        f"Of {POSTURES} random postures within +-150 deg {_percent(share)} have all eight branches; every branch found "
        f"puts the tip back within {position:.0e} m and the tool's direction within {direction:.0e}, and in "
        f"{_percent(recovered)} the posture itself is among them.",
        {"all_branches": share, "position": float(position), "direction": float(direction), "recovered": recovered},
    )


def printed_sign() -> Fact:
    """Eq 2-14 as printed, and with the sign of its second line put right: the boom's angle from them."""
    q, geometry = _random_postures(), EXCAVATOR.geometry
    along, across = geometry.a2 + geometry.a3 * np.cos(q[:, 2]), geometry.a3 * np.sin(q[:, 2])
    x = along * np.cos(q[:, 1]) - across * np.sin(q[:, 1])
    y = across * np.cos(q[:, 1]) + along * np.sin(q[:, 1])
    within = {}
    for name, sign in (("printed", -1.0), ("repaired", 1.0)):
        matrix = np.stack([np.stack([along, -across], axis=-1), np.stack([across, sign * along], axis=-1)], axis=-2)
        cosine, sine = np.moveaxis(np.linalg.solve(matrix, np.stack([x, y], axis=-1)[..., None])[..., 0], -1, 0)
        error = np.angle(np.exp(1j * (np.arctan2(sine, cosine) - q[:, 1])))
        within[name] = float((np.abs(error) < 1e-6).mean())
    return Fact(
        f"Eq 2-14 as printed gives the boom's angle in {_percent(within['printed'])} of the postures, with a plus sign "
        f"in its second line in {_percent(within['repaired'])}.",
        within,
    )


def _random_postures() -> Array:
    lower, upper = EXCAVATOR.limits.angle_lower, EXCAVATOR.limits.angle_upper
    return np.random.default_rng(0).uniform(lower, upper, (POSTURES, len(EXCAVATOR.links)))


def _of(rows: Sequence[Record], entry: NamedController, case: Case) -> list[Record]:
    return [row for row in rows if (row["controller"], row["case"]) == (entry.title, case.title)]


def _shares(
    rows: Sequence[Record], entry: NamedController, baseline: NamedController, case: Case = NOMINAL
) -> tuple[float, float]:
    """Largest ratio of the joints' errors of two controllers over the payloads, in the first and in the last cycle."""
    pairs = zip(_of(rows, entry, case), _of(rows, baseline, case), strict=True)
    loaded = [(own, other) for own, other in pairs if own["mass"]]
    first, last = (
        max(own[cycle]["joints"] / other[cycle]["joints"] for own, other in loaded) for cycle in ("first", "last")
    )
    return first, last


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
