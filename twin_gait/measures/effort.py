"""What the motors and the battery have to give."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

# A target that is met in floating point differs from the current by less than this.
CURRENT_TOLERANCE = 1e-9  # [A]


class SaturationShares(NamedTuple):
    """Shares of the ticks in which a motor could not do what it was told, each in [0, 1].

    Attributes:
        at_torque_limit: The command is beyond the torque limit.
        at_current_limit: The target current sits at the current limit.
        voltage_limited: The bus voltage drives less current than the target.
        saturated: At least one of the three.
    """

    at_torque_limit: float
    at_current_limit: float
    voltage_limited: float
    saturated: float


def saturation_shares(
    command: np.ndarray,
    target_current: np.ndarray,
    current: np.ndarray,
    *,
    torque_limit: float,
    current_limit: float,
) -> SaturationShares:
    """Count the ticks in which a limit cuts what the controller asks for.

    Args:
        command: Commanded torque before limits in [N m], shape ``(n,)``.
        target_current: Current after torque and current limit in [A], shape ``(n,)``.
        current: Current after the voltage limit in [A], shape ``(n,)``.
        torque_limit: In [N m].
        current_limit: In [A].

    Returns:
        The shares; NaN for an empty record.
    """
    if len(command) == 0:
        return SaturationShares(math.nan, math.nan, math.nan, math.nan)
    torque = np.abs(command) > torque_limit
    current_cut = np.abs(target_current) >= current_limit
    voltage = np.abs(target_current - current) > CURRENT_TOLERANCE
    cases = (torque, current_cut, voltage, torque | current_cut | voltage)
    return SaturationShares(*(float(np.mean(case)) for case in cases))


class Load(NamedTuple):
    """Load of a motor over a run.

    Attributes:
        peak: Largest magnitude.
        rms: Root mean square, which heats the winding.
        continuous_share: RMS over what the motor can hold for ever; above 1 it overheats in the end.
    """

    peak: float
    rms: float
    continuous_share: float


def load(values: np.ndarray, continuous: float) -> Load:
    """Peak and root mean square of a torque or a current.

    Args:
        values: Torque in [N m] or current in [A], shape ``(n,)``.
        continuous: What can be held for ever, same unit.

    Returns:
        The load; NaN for an empty record.
    """
    if len(values) == 0:
        return Load(math.nan, math.nan, math.nan)
    rms = float(np.sqrt(np.mean(values * values)))
    return Load(float(np.max(np.abs(values))), rms, rms / continuous)


class BatteryUse(NamedTuple):
    """What a run takes from the battery.

    Attributes:
        mean: Mean power in [W].
        peak: Largest power in [W].
        lowest: Least power in [W]; negative while braking motors feed the pack.
        energy: Drawn less fed back in [J].
        continuous_share: Mean power over what the pack can give for ever.
    """

    mean: float
    peak: float
    lowest: float
    energy: float
    continuous_share: float


def battery_use(power: np.ndarray, tick: float, continuous_power: float) -> BatteryUse:
    """Power and energy from the battery.

    Args:
        power: Of all motors in [W], constant within a tick, shape ``(n,)``.
        tick: Sampling period in [s].
        continuous_power: Of the pack in [W].

    Returns:
        The use; NaN for an empty record.
    """
    if len(power) == 0:
        return BatteryUse(*(math.nan,) * 5)
    mean = float(np.mean(power))
    return BatteryUse(
        mean, float(np.max(power)), float(np.min(power)), float(np.sum(power)) * tick, mean / continuous_power
    )


def battery_life(energy: float, power: float) -> float:
    """How long a full battery lasts at a mean power of the motors; electronics are not reckoned with.

    Args:
        energy: Of the full battery in [J].
        power: Mean power in [W].

    Returns:
        Time in [s]; infinite where the motors take nothing on balance, NaN without a power.
    """
    if math.isnan(power):
        return math.nan
    return energy / power if power > 0.0 else math.inf


class SwitchChanges(NamedTuple):
    """Change of a torque at each switch of phase, in [N m], shape ``(n_switches,)`` each.

    Attributes:
        at_switch: From the tick before the switch to the tick of the switch.
        over_blending: Largest from the tick before the switch to any tick up to the end of the blending.
    """

    at_switch: np.ndarray
    over_blending: np.ndarray


def changes_at_switches(torque: np.ndarray, switches: np.ndarray, blending_ticks: int) -> SwitchChanges:
    """How much a torque changes when the phase does.

    Args:
        torque: In [N m], shape ``(n,)``.
        switches: First ticks of new phases, each above 0 and below n, shape ``(m,)``.
        blending_ticks: Length of the fade; 0 without.

    Returns:
        Magnitudes of the changes.
    """
    at_switch, over_blending = np.zeros(len(switches)), np.zeros(len(switches))
    for number, tick in enumerate(switches):
        change = np.abs(torque[tick : tick + blending_ticks + 1] - torque[tick - 1])
        at_switch[number], over_blending[number] = change[0], change.max()
    return SwitchChanges(at_switch, over_blending)
