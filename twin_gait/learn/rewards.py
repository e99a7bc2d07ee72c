"""Reward terms of an environment for learning: functions of the signals, without a dimension.

Each returns one value for every episode, computed at the end of a control step. A larger value is better:
terms for tracking are between 0 and 1, terms for effort are 0 or negative.
"""

import operator
from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

from twin_gait.learn.signals import Signals
from twin_gait.measures.reference import WINTER_SLOW_SPEED, normative_ground_force
from twin_gait.measures.strides import PERCENT

RewardTerm = Callable[[Signals], np.ndarray]

TRACKING_WIDTH = np.radians(10.0)  # [rad], error at which the term for tracking is one half
# Highest foot load in healthy slow walking, over the carried weight.
HEALTHY_LOAD = float(normative_ground_force(PERCENT, speed=WINTER_SLOW_SPEED).vertical.max())


def total(values: Sequence[np.ndarray]) -> np.ndarray:
    """Add values in their order, so that the result does not depend on the number of episodes."""
    return np.asarray(reduce(operator.add, values))


def tracking(signals: Signals) -> np.ndarray:
    """Compare measured angles with healthy walking: mean of 1 / (1 + (error / 10°)²) over the joints.

    The reference is that of the controllers (Koopman et al. 2014) at speed and height of the episode. The
    place in its cycle is the time since the leg entered the first phase of the table.
    """
    names = signals.names("measured_angle_rad")
    terms = []
    for name in names:
        ratio = (signals[name] - signals[name.replace("measured_angle", "reference")]) / TRACKING_WIDTH
        terms.append(1.0 / (1.0 + ratio * ratio))
    return total(terms) / len(names)


def device_effort(signals: Signals) -> np.ndarray:
    """Return minus the mean over the joints of the squared motor torque as a share of its limit."""
    shares = [signals[name] / signals[_limit(name)] for name in signals.names("motor_torque_Nm")]
    return -total([share * share for share in shares]) / len(shares)


def wearer_effort(signals: Signals) -> np.ndarray:
    """Return minus the sum of the squared voluntary torques of the wearer per body mass in [(N·m/kg)²]."""
    mass = signals["wearer_mass_kg"]
    torques = [torque / mass for torque in signals.each("voluntary_torque_Nm")]
    return -total([torque * torque for torque in torques])


def power(signals: Signals) -> np.ndarray:
    """Return minus the power that the battery delivers per body mass in [W/kg]; charging does not count."""
    return np.asarray(-np.maximum(signals["battery_power_W"], 0.0) / signals["wearer_mass_kg"])


def load_peak(signals: Signals) -> np.ndarray:
    """Return minus the sum over the feet of the squared load beyond that of healthy slow walking.

    The load is the one that the gait controller receives, as a share of the carried weight.
    """
    share = signals["carried_share"]
    beyond = [np.maximum(load / share - HEALTHY_LOAD, 0.0) for load in signals.each("foot_load")]
    return -total([excess * excess for excess in beyond])


def saturation(signals: Signals) -> np.ndarray:
    """Return minus the share of the joints whose command exceeds the torque limit."""
    names = signals.names("motor_command_torque_Nm")
    return -total([1.0 * (np.abs(signals[name]) > signals[_limit(name)]) for name in names]) / len(names)


def smoothness(signals: Signals) -> np.ndarray:
    """Return minus the mean squared change of the command in a control step as a share of the limit."""
    names = signals.names("motor_command_torque_Nm")
    shares = [signals.change(name) / signals[_limit(name)] for name in names]
    return -total([share * share for share in shares]) / len(names)


def fall(signals: Signals) -> np.ndarray:
    """Return -1 if the episode ended in this step: a fall, a divergence, or a trip of the safety monitor."""
    return np.where((signals["status"] != 0.0) | (signals["trip_tick"] >= 0.0), -1.0, 0.0)


def alive(signals: Signals) -> np.ndarray:
    """Return 1 unless the episode ended in this step."""
    return 1.0 + fall(signals)


def _limit(name: str) -> str:
    """Return the name of the torque limit of the joint of a signal."""
    side, joint, *_ = name.split("_")
    return f"{side}_{joint}_torque_limit_Nm"


REWARDS: dict[str, RewardTerm] = {
    term.__name__: term
    for term in (
        tracking, device_effort, wearer_effort, power, load_peak, saturation, smoothness, fall, alive,
    )
}  # fmt: skip
