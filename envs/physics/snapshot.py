"""What Chipmunk keeps of a body and of a joint between two steps, copied out of its C structs and back.

A joint starts the next step from the impulse of the last one, which no function of Chipmunk gives or sets, and a body's
position is stored by its centre of mass. So the numbers are copied as they lie in memory; `layout_is_known` checks with
Chipmunk's own functions that they lie where this module reads them.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pymunk
from numba import njit
from numpy.typing import NDArray

from envs.physics import chipmunk
from planners.typing import Array

Addresses = NDArray[np.int64]

BODY = tuple(range(2, 23))
"""Numbers of a `cpBody`, in units of 8 bytes: mass, moment and their inverses, centre of mass, position, velocity and
force of it, angle, its velocity, torque, and the transform of the frame."""

JOINT = (7, 13, 14, 15, 16, 25, 26)
"""Numbers of a `cpPivotJoint`, in units of 8 bytes: error bias, both anchors, and the impulse of the last step."""

_SIZE = max(*BODY, *JOINT) + 1

_MASS, _MOMENT, _COG, _POSITION, _VELOCITY, _ANGLE, _SPIN = 2, 4, 6, 8, 10, 14, 15


def numbers_of(bodies: int, joints: int) -> int:
    """How many numbers a space with so many bodies and joints has."""
    return 1 + bodies * len(BODY) + joints * len(JOINT)


@njit(cache=True, nogil=True)
def save(spaces: Addresses, bodies: Addresses, joints: Addresses, numbers: Array) -> None:
    """Copy the numbers of every space, ``(n,)``, with its bodies and joints, ``(n, k)``, into ``numbers``."""
    for index in range(spaces.shape[0]):
        numbers[index, 0] = chipmunk.space_get_current_time_step(spaces[index])
        at = 1
        for body in bodies[index]:
            memory = chipmunk.array_at(body, (_SIZE,))
            for place in BODY:
                numbers[index, at] = memory[place]
                at += 1
        for joint in joints[index]:
            memory = chipmunk.array_at(joint, (_SIZE,))
            for place in JOINT:
                numbers[index, at] = memory[place]
                at += 1


@njit(cache=True, nogil=True)
def load(spaces: Addresses, bodies: Addresses, joints: Addresses, numbers: Array) -> None:
    """Write the numbers that `save` has copied back."""
    for index in range(spaces.shape[0]):
        chipmunk.space_set_current_time_step(spaces[index], numbers[index, 0])
        at = 1
        for body in bodies[index]:
            memory = chipmunk.array_at(body, (_SIZE,))
            for place in BODY:
                memory[place] = numbers[index, at]
                at += 1
        for joint in joints[index]:
            memory = chipmunk.array_at(joint, (_SIZE,))
            for place in JOINT:
                memory[place] = numbers[index, at]
                at += 1


@lru_cache(maxsize=1)
def layout_is_known() -> bool:
    """Whether this Pymunk's Chipmunk keeps its numbers where this module reads them."""
    space, (one, two) = pymunk.Space(), (pymunk.Body(2.0, 3.0), pymunk.Body(5.0, 7.0))
    joint = pymunk.PivotJoint(one, two, (0.25, -0.5), (-0.75, 1.25))
    joint.error_bias = 0.0
    one.center_of_gravity, one.angle, one.position = (0.5, 0.125), 0.375, (1.5, -2.5)
    two.velocity, two.angular_velocity = (11.0, -13.0), 17.0
    space.add(one, two, joint)
    space.step(0.01)
    numbers = np.zeros((1, numbers_of(2, 1)))
    one_at, two_at = chipmunk.address(one._body), chipmunk.address(two._body)
    addresses = (
        np.array([chipmunk.address(space._space)]),
        np.array([[one_at, two_at]]),
        np.array([[chipmunk.address(joint._constraint)]]),
    )
    save(*addresses, numbers)
    step, first, second = numbers[0, 0], numbers[0, 1:22], numbers[0, 22:43]
    bias, *anchors = numbers[0, 43:48].tolist()
    impulse = math.hypot(*numbers[0, 48:].tolist())
    cos, sin = math.cos(one.angle), math.sin(one.angle)
    expected = [
        (step, 0.01),
        (bias, 0.0),
        (impulse, joint.impulse),
        *zip(anchors, (0.25, -0.5, -0.75, 1.25), strict=True),
        *[(second[place - 2], value) for place, value in ((_MASS, 5.0), (_MOMENT, 7.0), (_SPIN, two.angular_velocity))],
        *zip(second[_VELOCITY - 2 :][:2], two.velocity, strict=True),
        *zip(second[_POSITION - 2 :][:2], two.position, strict=True),
        *zip(first[_COG - 2 :][:2], (0.5, 0.125), strict=True),
        (first[_ANGLE - 2], one.angle),
        *zip(first[15:], (cos, sin, -sin, cos, *one.position), strict=True),
    ]
    return bool(impulse > 0.0) and all(math.isclose(found, known, abs_tol=1e-12) for found, known in expected)
