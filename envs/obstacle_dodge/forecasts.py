"""What a forecast of a disc's path is made from and what it says, and the field that acts on such forecasts.

A forecast depends on the disc's motion up to now and on the arm's straight move to its goal, at which discs are aimed
(`envs.obstacle_dodge.paths`): it is the same for any number of discs. Its numbers are in a frame along the disc's
present velocity.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from envs.observation import Observation
from envs.obstacle_dodge.env import ObstacleDodge
from envs.obstacle_dodge.experts import DodgingExpert
from envs.obstacle_dodge.paths import FARTHEST
from planners import Arm
from planners.apf.dodge import STEP
from planners.typing import Array

KNOTS = (0.15, 0.3, 0.5, 0.7, 0.9, 1.15, 1.4, 1.65, 1.9)
"""Times ahead for which a forecast gives a disc's displacement, s; between them it is linear."""

LAGS = (0.1, 0.2, 0.4, 0.8)
"""How long ago the earlier velocities were, of which a forecast knows, s."""

AHEAD = (0.0, 0.5, 1.0, 2.0)
"""Times ahead at which a forecast knows elbow and hand in the straight move to the goal, s."""

PACE = 2.2
"""A forecast of 1 is a displacement with this mean velocity, m/s."""

INPUTS, OUTPUTS = 8 + 4 * len(AHEAD) + 2 * len(LAGS), 2 * len(KNOTS)
"""Numbers that a forecast is made from, and numbers in it: displacements along and across the velocity."""


class Move(NamedTuple):
    """The starts of episodes: postures at rest, ``(num_envs, 2)``, and at the goal with the same elbow, rad."""

    start: Array
    goal: Array


def move_of(seen: dict[str, Array]) -> Move:
    """The straight move to the goal, from parsed observations of an episode's start."""
    start = seen["joint_position"]
    postures = start[:, None] + seen["posture_error"].reshape(-1, 2, 2)
    same = np.sign(np.sin(postures[:, :, 1])) == np.sign(np.sin(start[:, 1:]))
    return Move(start, postures[np.arange(len(start)), np.argmax(same, axis=1)])


def forecast_inputs(arm: Arm, t: Array, move: Move, place: Array, velocity: Array, earlier: Array) -> Observation:
    """What a forecast of one disc is made from, ``(num_envs, INPUTS)``.

    Args:
        arm: with two links; the straight move takes half of its accelerations.
        t: since the start of the episode, ``(num_envs,)``, s.
        move: the straight move.
        place, velocity: of the disc, ``(num_envs, 2)``, m from the base and m/s.
        earlier: velocities `LAGS` ago, ``(num_envs, len(LAGS), 2)``, m/s; before the start, the first one.
    """
    change, top = np.abs(move.goal - move.start), arm.limits.array("velocity")
    hardest = 0.5 * arm.limits.array("acceleration")
    ramped = change < top * top / hardest
    seconds = np.where(ramped, 2.0 * np.sqrt(change / hardest), change / top + top / hardest).max(axis=1)
    points = []
    for ahead in AHEAD:
        u = np.clip((t + ahead) / np.maximum(seconds, 1e-3), 0.0, 1.0)
        share = np.where(u < 0.5, 2.0 * u * u, 1.0 - 2.0 * (1.0 - u) ** 2)[:, None]
        angles = np.cumsum(move.start + share * (move.goal - move.start), axis=1)
        links = arm.length_array[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        points += [links[:, 0] - place, links[:, 0] + links[:, 1] - place]
    own = into_frame(velocity, place[:, None])[:, 0]
    speed, away = np.hypot(*velocity.T), np.hypot(*place.T)
    rim = np.sqrt(np.maximum(0.0, own[:, 0] ** 2 + FARTHEST**2 - away**2)) - own[:, 0]
    single = [np.minimum(t, 2.5), 4.0 * np.minimum(t, 0.4), speed, away, own[:, 0], own[:, 1]]
    single += [np.minimum(rim, 3.0), np.minimum(rim / np.maximum(speed, 0.05), 3.0)]
    around = into_frame(velocity, np.concatenate([np.stack(points, axis=1), earlier - velocity[:, None]], axis=1))
    return np.concatenate([np.stack(single, axis=1), around.reshape(len(t), -1)], axis=1).astype(np.float32)


def into_frame(velocity: Array, vectors: Array, *, back: bool = False) -> Array:
    """Vectors ``(num_envs, k, 2)`` along and across velocities ``(num_envs, 2)``; or from there ``back``."""
    angle = np.arctan2(velocity[:, 1], velocity[:, 0])[:, None]
    c, s = np.cos(angle), np.sin(angle) * (-1.0 if back else 1.0)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def labels(velocity: Array, displacements: Array) -> NDArray[np.float32]:
    """The forecast that says displacements at `KNOTS`, ``(num_envs, len(KNOTS), 2)``, m: ``(num_envs, OUTPUTS)``."""
    shares = into_frame(velocity, displacements) / (PACE * np.array(KNOTS)[:, None])
    return shares.reshape(len(velocity), -1).astype(np.float32)


def displacements(velocity: Array, forecasts: Array, steps: int) -> Array:
    """Displacements that forecasts ``(num_envs, OUTPUTS)`` say at multiples of `STEP`, ``(num_envs, steps, 2)``, m."""
    shares = forecasts.reshape(len(velocity), len(KNOTS), 2) * (PACE * np.array(KNOTS)[:, None])
    times, knots = STEP * np.arange(1, steps + 1), np.array([0.0, *KNOTS])
    weights = np.stack([np.interp(times, knots, unit) for unit in np.eye(len(knots))[1:]], axis=1)
    ahead: Array = weights @ into_frame(velocity, shares, back=True)
    return ahead


class Track(NamedTuple):
    """What is remembered of an episode: the field's memory; the move; velocities of the discs, the latest first."""

    field: Any
    move: Move
    velocities: Array  # (num_envs, periods, discs, 2), m/s


class ForecastingExpert(DodgingExpert):
    """The field among discs, which it expects where forecasts say.

    Args:
        task: the environment's task.
        network: gives forecasts ``(rows, OUTPUTS)`` from `forecast_inputs`.

    Raises:
        ValueError: with a second arm.
    """

    def __init__(self, task: ObstacleDodge, network: Callable[[Observation], NDArray[np.float32]]) -> None:
        super().__init__(task)
        if task.config.second_arm:
            raise ValueError(
                "forecasts are of discs that move by themselves, not of a second arm: leave out second_arm"
            )
        self._network = network
        self._lags = [max(1, round(lag / task.config.control_period)) for lag in LAGS]

    def _is_own(self, state: Any) -> bool:
        """Whether `_act` may have returned a state."""
        return isinstance(state, Track)

    def _act(self, observations: Observation, state: Any, starts: NDArray[np.bool_]) -> tuple[Array, Track]:
        seen = self.task.layout.parse(observations)
        track = self.followed(seen, state, starts | self._begins(seen))
        deciding = ~track.field["decided"]
        rows = np.flatnonzero(deciding if self.idle is None else deciding & ~self.idle)
        forecasts = np.zeros((len(rows), self._discs, OUTPUTS))
        for disc in range(self._discs if len(rows) else 0):
            forecasts[:, disc] = self._network(self.inputs(seen, track, rows, disc))
        return self.act(seen, track, rows, forecasts)

    def act(
        self, seen: dict[str, Array], track: Track, rows: NDArray[np.int64], forecasts: Array
    ) -> tuple[Array, Track]:
        """Actions ``(num_envs, 2)`` and the next track, with forecasts ``(len(rows), discs, OUTPUTS)`` in some rows.

        The rows are those that decide now; see `Track.field`.
        """
        discs = self._discs
        expected = np.zeros((len(track.field), self.steps, discs, 2))
        places = seen["obstacle"].reshape(len(expected), -1, 2)
        for disc in range(discs):
            ahead = displacements(track.velocities[rows, 0, disc], forecasts[:, disc], self.steps)
            expected[rows, :, disc] = places[rows, disc][:, None] + ahead
        self._payload = np.zeros(len(expected))
        qdd, field = self._accelerate(seen, track.field, expected)
        return self._action_for(seen, qdd), track._replace(field=field)

    def inputs(self, seen: dict[str, Array], track: Track, rows: NDArray[np.int64], disc: int) -> Observation:
        """What the forecast of a disc is made from in some rows, ``(len(rows), INPUTS)``."""
        config = self.task.config
        t = config.horizon - seen["time_left"][rows, 0]
        past = track.velocities[rows, :, disc]
        known = np.minimum(np.array(self._lags), np.round(t / config.control_period).astype(int)[:, None])
        move = Move(track.move.start[rows], track.move.goal[rows])
        place = seen["obstacle"].reshape(len(track.field), -1, 2)[rows, disc]
        earlier = past[np.arange(len(rows))[:, None], known]
        return forecast_inputs(self.task.arm, t, move, place, past[:, 0], earlier)

    def followed(self, seen: dict[str, Array], state: Any, begins: NDArray[np.bool_]) -> Track:
        """The track with the present observations in it, begun anew where an episode begins."""
        batch = len(begins)
        now = seen["obstacle_velocity"].reshape(batch, -1, 2)[:, : self._discs]
        move = move_of(seen)
        if not isinstance(state, Track) or len(state.velocities) != batch:
            begins = np.ones(batch, dtype=bool)
            state = Track(self._memory_of(batch), move, np.zeros((batch, 1 + max(self._lags), *now.shape[1:])))
        velocities = np.concatenate([now[:, None], state.velocities[:, :-1]], axis=1)
        velocities[begins] = now[begins, None]
        field = state.field.copy()  # what was returned before does not change
        field[begins] = np.zeros(1, field.dtype)
        kept = [np.where(begins[:, None], new, old) for new, old in zip(move, state.move, strict=True)]
        return Track(field, Move(*kept), velocities)
