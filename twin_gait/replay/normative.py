"""Healthy walking from the literature as a recorded walk of two legs, to try a table on."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK
from twin_gait.measures.reference import (
    CYCLE,
    KILOMETRES_PER_HOUR,
    WINTER_CYCLE_TIME,
    WINTER_JOINTS,
    WINTER_SPEED,
    normative_angle,
    reference_curve,
    reference_cycle_time,
)
from twin_gait.parameters import Patient
from twin_gait.replay.recording import Recording
from twin_gait.vocabulary import JointName, Side

STRIDES = 8
KOOPMAN, WINTER = "koopman", "winter"
Curve = Callable[[JointName, np.ndarray], np.ndarray]


class NormativeWalk(NamedTuple):
    """A walk made of curves from the literature."""

    recording: Recording  # the walk; the left leg begins at heel contact, the right one half a stride later
    speed: float  # of walking in [m] / [s]
    cycle_time: float  # stride time in [s]


def is_normative(name: str) -> bool:
    """Whether a name asks for a walk from the literature."""
    return name == WINTER or name.startswith(f"{KOOPMAN}@")


def normative_walk(name: str, *, strides: int = STRIDES) -> NormativeWalk:
    """Make a walk of curves from the literature.

    ``name``: ``koopman@1.5`` for the regression of Koopman et al. (2014) at a walking speed in km/h, or
    ``winter`` for the means of Winter (1991) at natural cadence; ``strides``: how many. Raises ParameterError
    if there is no such walk, or the regression does not reach the speed.
    """
    curve, joints, speed, cycle_time = _winter() if name == WINTER else _koopman(name)
    time = np.arange(round(strides * cycle_time / TICK)) * TICK
    angles = {}
    for side, lead in ((Side.LEFT, 0.0), (Side.RIGHT, 0.5)):
        percent = CYCLE * np.mod(time / cycle_time + lead, 1.0)
        angles[side] = {str(joint): curve(joint, percent) for joint in joints}
    return NormativeWalk(Recording(name, 0.0, angles, {}, {}), speed, cycle_time)


def _winter() -> tuple[Curve, tuple[JointName, ...], float, float]:
    return normative_angle, WINTER_JOINTS, WINTER_SPEED, WINTER_CYCLE_TIME


def _koopman(name: str) -> tuple[Curve, tuple[JointName, ...], float, float]:
    speed = _speed(name)
    height = Patient().height

    def curve(joint: JointName, percent: np.ndarray) -> np.ndarray:
        return reference_curve(joint, percent, speed=speed, height=height)

    return curve, tuple(JointName), speed, reference_cycle_time(speed, height)


def _speed(name: str) -> float:
    kind, _, text = name.partition("@")
    try:
        speed = float(text) / KILOMETRES_PER_HOUR
    except ValueError:
        speed = math.nan
    if kind != KOOPMAN or not math.isfinite(speed):
        raise ParameterError(f"{name}: expected {KOOPMAN}@SPEED with the speed in km/h, such as koopman@1.5")
    return speed
