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


def total(values: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Add values in their order, so that the result does not depend on the number of episodes.

    ``values``: arrays of shape ``(n,)``, or the rows of an array. Returns shape ``(n,)``.
    """
    return np.asarray(reduce(operator.add, values))


def tracking(signals: Signals) -> np.ndarray:
    """Compare measured angles with healthy walking: mean of 1 / (1 + (error / 10°)²) over the joints.

    The reference is that of the controllers (Koopman et al. 2014) at speed and height of the episode. The
    place in its cycle is the time since the leg entered the first phase of the table.
    """
    names = signals.names("measured_angle_rad")
    references = signals.stack([name.replace("measured_angle", "reference") for name in names])
    ratios = (signals.stack(names) - references) / TRACKING_WIDTH
    return total(1.0 / (1.0 + ratios * ratios)) / len(names)


def device_effort(signals: Signals) -> np.ndarray:
    """Return minus the mean over the joints of the squared motor torque as a share of its limit."""
    names = signals.names("motor_torque_Nm")
    shares = signals.stack(names) / _limits(signals, names)
    return -total(shares * shares) / len(names)


def wearer_effort(signals: Signals) -> np.ndarray:
    """Return minus the sum of the squared voluntary torques of the wearer per body mass in [(N·m/kg)²]."""
    torques = signals.each("voluntary_torque_Nm") / signals["wearer_mass_kg"]
    return -total(torques * torques)


def power(signals: Signals) -> np.ndarray:
    """Return minus the power that the battery delivers per body mass in [W/kg]; charging does not count."""
    return np.asarray(-np.maximum(signals["battery_power_W"], 0.0) / signals["wearer_mass_kg"])


def load_peak(signals: Signals) -> np.ndarray:
    """Return minus the sum over the feet of the squared load beyond that of healthy slow walking.

    The load is the one that the gait controller receives, as a share of the carried weight.
    """
    excess = np.maximum(signals.each("foot_load") / signals["carried_share"] - HEALTHY_LOAD, 0.0)
    return -total(excess * excess)


def saturation(signals: Signals) -> np.ndarray:
    """Return minus the share of the joints whose command exceeds the torque limit."""
    names = signals.names("motor_command_torque_Nm")
    beyond = np.abs(signals.stack(names)) > _limits(signals, names)
    return -total(1.0 * beyond) / len(names)


def smoothness(signals: Signals) -> np.ndarray:
    """Return minus the mean squared change of the command in a control step as a share of the limit."""
    names = signals.names("motor_command_torque_Nm")
    shares = np.array([signals.change(name) for name in names]) / _limits(signals, names)
    return -total(shares * shares) / len(names)


def fall(signals: Signals) -> np.ndarray:
    """Return -1 if the episode ended in this step: a fall, a divergence, or a trip of the safety monitor."""
    return np.where((signals["status"] != 0.0) | (signals["trip_tick"] >= 0.0), -1.0, 0.0)


def alive(signals: Signals) -> np.ndarray:
    """Return 1 unless the episode ended in this step."""
    return 1.0 + fall(signals)


def _limits(signals: Signals, names: Sequence[str]) -> np.ndarray:
    """Return the torque limits of the joints of some signals in [N·m], shape ``(m, n)``."""
    joints = [name.split("_")[:2] for name in names]
    return signals.stack([f"{side}_{joint}_torque_limit_Nm" for side, joint in joints])


REWARDS: dict[str, RewardTerm] = {
    term.__name__: term
    for term in (
        tracking, device_effort, wearer_effort, power, load_peak, saturation, smoothness, fall, alive,
    )
}  # fmt: skip
