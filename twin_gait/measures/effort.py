r"""Effort: saturation of the motors, use of the battery, shares of the work, and conservation of energy.

Interaction torque. Where braces bind the wearer to the device, their torque is the action of the device on
the wearer, and the log contains it. Without braces the leg and the device's frame are one rigid body, so no
torque of a cuff exists. The torque of the device on the leg at a joint is then the torque at the output of
the gear: the torque of the motor less the friction of motor and gear and less the torque that accelerates
the rotor,

.. math::

    \tau_{int} = \tau_{motor} + \tau_{friction} - J_{rotor}\,\dot\omega

A torque sensor between gear and frame would measure it. It still contains the weight and inertia of the
frame itself, as the reading of such a sensor does.
"""

import math
from collections.abc import Mapping

import numpy as np

from twin_gait.parameters.drives import LimitParameters

# The current differs from a target that is met by less than this because of floating-point rounding.
CURRENT_TOLERANCE = 1e-9  # [A]


def saturation_cases(
    command: np.ndarray, target_current: np.ndarray, current: np.ndarray, limits: LimitParameters
) -> dict[str, np.ndarray]:
    """Find the ticks in which a motor cannot follow its command.

    ``at_torque_limit``: the command is beyond the torque limit; ``at_current_limit``: the target current is
    at the current limit; ``voltage_limited``: the bus voltage drives less current than the target;
    ``saturated``: at least one of the three. Returns booleans, one a tick.

    ``command``: commanded torque before limits in [N·m]; ``target_current``: current after torque and current
    limit in [A]; ``current``: current after the voltage limit in [A]; ``limits``: limits of the joint.
    """
    torque = np.abs(command) > limits.torque
    target = np.abs(target_current) >= limits.current
    voltage = np.abs(target_current - current) > CURRENT_TOLERANCE
    saturated = torque | target | voltage
    return {
        "at_torque_limit": torque,
        "at_current_limit": target,
        "voltage_limited": voltage,
        "saturated": saturated,
    }


def saturation_shares(cases: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Compute the shares of the ticks of :func:`saturation_cases`, by their names in a summary.

    ``at_torque_limit_share``, ``at_current_limit_share``, ``voltage_limited_share`` and ``saturated_share``;
    NaN for an empty record.
    """
    return {f"{name}_share": share_of_ticks(case) for name, case in cases.items()}


def share_of_ticks(case: np.ndarray) -> float:
    """Return the share of the ticks in which a condition is true; NaN for an empty record."""
    return np.count_nonzero(case) / len(case) if len(case) else math.nan


def battery_use(power: np.ndarray, tick: float, continuous_power: float) -> dict[str, float]:
    """Compute the power and energy that a run draws from the battery, by names in a summary.

    ``power_mean_W``, ``power_peak_W`` and ``power_lowest_W``, which is negative while braking motors feed the
    pack; ``energy_J``: energy drawn less energy fed back; ``continuous_share``: mean power divided by the
    continuous power of the pack. NaN for an empty record. ``power``: power drawn from the pack in [W],
    constant within a tick, shape ``(n,)``; ``continuous_power``: power that the pack can supply continuously,
    in [W].
    """
    drawn = power if len(power) else np.full(1, math.nan)
    return {
        "power_mean_W": float(drawn.mean()),
        "power_peak_W": float(drawn.max()),
        "power_lowest_W": float(drawn.min()),
        "energy_J": float(drawn.sum()) * tick,
        "continuous_share": float(drawn.mean()) / continuous_power,
    }


def battery_life(energy: float, power: float) -> float:
    """Compute how long a full battery lasts at a mean power.

    ``energy``: energy of the full battery in [J]; ``power``: mean power drawn from it in [W]. Returns the
    time in [s]; infinite where nothing is drawn on balance, NaN without a power.
    """
    if math.isnan(power):
        return math.nan
    return energy / power if power > 0.0 else math.inf


def changes_at_switches(
    torque: np.ndarray, switches: np.ndarray, blending_ticks: np.ndarray | int
) -> np.ndarray:
    """Compute the largest change of a torque after each switch of phase.

    The torque at the tick before the switch is compared with every tick up to the end of the blend.
    ``torque`` in [N·m], shape ``(n,)``; ``switches``: first ticks of new phases, each above 0 and below n,
    shape ``(m,)``; ``blending_ticks``: length of each blend, or one length for all; 0 without blending.
    Returns magnitudes in [N·m], shape ``(m,)``.
    """
    ends = np.asarray(switches) + blending_ticks + 1
    spans = zip(switches, ends, strict=True)
    return np.array([np.abs(torque[tick:end] - torque[tick - 1]).max() for tick, end in spans])


# Largest relative residual of the energy balance of a run with a stable step of Runge-Kutta. Of 64 random
# walks at 0.25 ms the stable ones have at most 9e-8, the others at least 6e-5 (examples/validation.py).
LARGEST_RESIDUAL = 1e-6


def energy_balance(energy: np.ndarray, works: np.ndarray) -> dict[str, float]:
    """Compare the change of energy with the work of all sources, by names in a summary.

    ``energy_residual_J``: largest difference of the two since the start; ``energy_throughput_J``: all work in
    and out, the sum over ticks and sources of its magnitude; ``energy_residual_share``: the first divided by
    the second. NaN where the record is empty or no work was done.

    ``energy``: kinetic and potential energy in [J]; ``works``: work done since some instant by every source
    in [J], shape ``(n_sources, n)``.
    """
    largest = throughput = math.nan
    if len(energy):
        work = works.sum(axis=0)
        largest = float(np.abs((energy - energy[0]) - (work - work[0])).max())
        steps = works[:, 1:] - works[:, :-1]
        throughput = float(np.abs(steps, out=steps).sum())
    share = largest / throughput if throughput > 0.0 else math.nan
    return {
        "energy_residual_J": largest,
        "energy_throughput_J": throughput,
        "energy_residual_share": share,
    }


def interaction_torque(
    motor: np.ndarray, friction: np.ndarray, velocity: np.ndarray, rotor_inertia: float, tick: float
) -> np.ndarray:
    r"""Compute the torque of the device on the leg at one joint.

    ``motor``: motor torque at the joint in [N·m], one value a tick; ``friction``: torque of the friction on
    the joint in [N·m]; ``velocity`` of the joint in [rad/s]; ``rotor_inertia``: inertia of
    motor and gear seen at the joint in [kg·m²]. Returns the torque in [N·m], positive in increasing angle;
    the acceleration is a central difference, 0 in a record of one tick.
    """
    acceleration = np.gradient(velocity, tick) if len(velocity) > 1 else np.zeros(len(velocity))
    return np.asarray(motor + friction - rotor_inertia * acceleration)


def root_mean_square(values: np.ndarray) -> float:
    """Compute the root mean square, in the unit of the values; NaN for an empty record."""
    return math.sqrt((values * values).mean()) if len(values) else math.nan


def positive_work(torque: np.ndarray, velocity: np.ndarray, tick: float) -> float:
    r"""Compute the work that a torque puts into the motion, :math:`\int \max(0, \tau\omega)\,dt`.

    ``torque`` in [N·m], one value a tick; ``velocity`` in [rad/s]. Returns the work in [J].
    """
    return float(np.sum(np.maximum(torque * velocity, 0.0)) * tick)


def share_of_work(work: float, other: float) -> float:
    """Compute the share of one of two sources in the positive work of both.

    ``work``: positive work of the one in [J]; ``other``: positive work of the other in [J]. Returns the share
    in [0, 1]; NaN if neither does any work.
    """
    total = work + other
    return work / total if total > 0.0 else math.nan


def opposing_torque(device: np.ndarray, wearer: np.ndarray) -> np.ndarray:
    r"""Compute the torque with which device and wearer push against each other.

    .. math::

        \min(|\tau_d|, |\tau_w|) \quad\text{where their signs differ, else 0}

    ``device`` and ``wearer`` in [N·m], shape ``(n,)``. Returns magnitude in [N·m], shape ``(n,)``.
    """
    against = device * wearer < 0.0
    return np.where(against, np.minimum(np.abs(device), np.abs(wearer)), 0.0)
