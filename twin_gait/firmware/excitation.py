"""Inputs that excite the constants of boards, gait controller and codec: bounds, timeouts and heat.

A walk stays inside the bounds of the monitor. These inputs approach each bound from both sides.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import chain, product
from typing import Any, TypeAlias

import numpy as np

from twin_gait.control.joint_board import Limits
from twin_gait.core.guards import evaluate_guard
from twin_gait.core.safety import SPEED_TRIP, Bounds
from twin_gait.firmware.can_codec import CanMessage
from twin_gait.gait.signals import DEVICE_SIGNALS

Rows: TypeAlias = np.ndarray  # Inputs of a unit, shape ``(ticks,)``, from its tick 0 on.
Values: TypeAlias = np.ndarray  # Signals of all legs and of the device, shape ``(signals,)``, in SI units.
THRESHOLD_MARGIN = 0.003  # Distance from a bound or a threshold, as a share of it.
HEAT = 12.0  # Heat to which the winding tends while the heat model is excited; the monitor trips at 1.
LONG = 1000.0  # Time in a phase in [s] that opens every guard on it.
SEED = 48  # Seed of the random inputs.


def board_episodes(unit: Any, dtype: np.dtype[Any], *, repeated: bool) -> Iterator[Rows]:
    """Yield inputs of a joint board that excite its bounds, its limits and its friction model.

    ``repeated``: whether an earlier board has the same constants, which are printed once.
    """
    settings, bounds = unit.settings, unit.state.bounds
    rows = BoardInputs(bounds, settings.rates.period, dtype)
    deaf = rows.rows_at_speed(0.3 * bounds.highest_speed, rows.middle, 16)
    deaf["received"] = False
    yield deaf
    if repeated:
        return
    yield from rows.monitor_bound_rows()
    yield from rows.heating_rows()
    limits: Limits = settings.limits
    for side in (1.0 - THRESHOLD_MARGIN, 1.0 + THRESHOLD_MARGIN):
        yield rows.rows_at_rest(bounds.torque_ticks + 3, target=side * bounds.highest_torque)
        yield rows.rows_at_rest(3, target=-side * bounds.highest_command)
        yield rows.rows_at_rest(3, target=side * unit.state.limits.torque)
    yield from rows.command_lag_rows()
    silent = rows.rows_at_rest(limits.controller_timeout + limits.lowering_ticks + 9, speed=0.1)
    silent["setpoint"]["gravity"], silent["received"][4:] = 5.0, False
    yield silent
    held = rows.rows_at_rest(9, speed=0.2)
    held["setpoint"]["held"], held["setpoint"]["damping"] = True, 40.0
    yield held
    yield rows.random_motion_rows(np.random.default_rng(SEED))


class BoardInputs:
    """Inputs of a board, with signals of the drive that are consistent with the encoder."""

    def __init__(
        self, bounds: Bounds, period: float, dtype: np.dtype[Any], middle: float | None = None
    ) -> None:
        """Store the constants of a board; ``middle``: rest angle in [rad], by default between the stops."""
        self.bounds, self.period, self.dtype = bounds, period, dtype
        self.middle = 0.5 * (bounds.lower + bounds.upper) if middle is None else middle

    def rows_along(self, angles: np.ndarray, current: float = 0.0) -> Rows:
        """Return rows with angles in [rad], and the voltage of a motor that turns with them."""
        rows = np.zeros(len(angles), self.dtype)
        speed = np.diff(angles, prepend=angles[:1]) / self.period
        rows["angle"], rows["current"], rows["received"] = angles, current, True
        rows["voltage"] = self.bounds.emf_constant * speed + self.bounds.model_resistance * current
        return rows

    def rows_at_rest(
        self, ticks: int, *, speed: float = 0.0, current: float = 0.0, deviation: float = 0.0,
        target: float = 0.0,
    ) -> Rows:  # fmt: skip
        """Return rows with a joint at rest, and a motor with a speed, a current and a target torque.

        ``speed`` in [rad/s], ``current`` and its ``deviation`` in [A], ``target`` in [N·m].
        """
        rows = self.rows_along(np.full(ticks + 2, self.middle))
        rows["current"][2:], rows["current_deviation"][2:] = current, deviation
        rows["voltage"][2:] = self.bounds.emf_constant * speed + self.bounds.model_resistance * current
        rows["setpoint"]["target"][2:] = target
        return rows

    def rows_at_speed(self, speed: float, end: float, ticks: int = 120) -> Rows:
        """Return rows with a joint that moves at a speed in [rad/s] to an angle in [rad]."""
        return self.rows_along(end + speed * self.period * np.minimum(np.arange(-ticks, 4), 0))

    def monitor_bound_rows(self) -> Iterator[Rows]:
        """Yield rows on both sides of each bound of the monitor that drive or encoder can exceed."""
        bounds = self.bounds
        for side in (1.0 - THRESHOLD_MARGIN, 1.0 + THRESHOLD_MARGIN):
            yield self.rows_at_speed(side * bounds.highest_speed, self.middle)
            jump = np.full(4, self.middle)
            jump[2:] += side * bounds.angle_step
            yield self.rows_along(jump)
            yield self.rows_at_rest(bounds.frozen_ticks + 3, speed=side * bounds.frozen_speed)
            yield self.rows_at_rest(3, current=side * bounds.highest_current)
            yield self.rows_at_rest(bounds.drive_ticks + 3, deviation=-side * bounds.drive_deviation)
            speed = 0.8 * bounds.highest_speed
            stop = (1.0 - 0.1 * (side - 1.0)) * bounds.stop_distance_factor * speed * speed
            yield self.rows_at_speed(speed, bounds.upper - stop)
            yield self.rows_at_speed(-speed, bounds.lower + stop)
        residual = 1.1 * bounds.model_deviation * bounds.model_gain / self.period
        yield self.rows_at_rest(900, speed=min(residual, 0.95 * bounds.frozen_speed))
        missing = np.full(4, self.middle)
        missing[2:] = math.nan
        yield self.rows_along(missing)

    def heating_rows(self) -> Iterator[Rows]:
        """Yield rows with a current that heats the winding until the monitor trips, if there is one."""
        bounds = self.bounds
        current = min(math.sqrt(HEAT * bounds.cooling / bounds.heating), 0.99 * bounds.highest_current)
        final = bounds.heating * current * current / bounds.cooling
        if final > 1.02:
            yield self.rows_at_rest(
                3 + math.ceil(math.log(1.0 - 1.0 / final) / math.log(1.0 - bounds.cooling)), current=current
            )

    def command_lag_rows(self) -> Iterator[Rows]:
        """Yield rows with a spring so stiff that the command lags behind its setpoint, around the bound."""
        bounds = self.bounds
        speed = 0.6 * bounds.highest_speed
        for side in (1.0 - THRESHOLD_MARGIN, 1.0 + THRESHOLD_MARGIN):
            rows = self.rows_at_speed(speed, self.middle, 220)
            rows["setpoint"]["stiffness"] = side * bounds.command_deviation / (speed * self.period)
            rows["setpoint"]["equilibrium"] = rows["angle"]
            yield rows

    def random_motion_rows(self, random: np.random.Generator, ticks: int = 1500) -> Rows:
        """Return rows with smooth motions of all speeds, and setpoints that change."""
        times, bounds = np.arange(ticks) * self.period, self.bounds
        angles = np.full(ticks, self.middle)
        for part in (0.3, 0.15, 0.05):
            speed = part * bounds.highest_speed
            angles += speed * np.sin((rate := random.uniform(3.0, 12.0)) * times) / rate
        rows = self.rows_along(angles, 1.5)
        for name, most in (
            ("stiffness", 50.0),
            ("damping", 5.0),
            ("gain", 1.0),
            ("gravity", 9.0),
            ("inertia", 9.0),
        ):
            rows["setpoint"][name] = np.repeat(random.uniform(0.0, most, ticks // 50), 50)
        rows["setpoint"]["equilibrium"] = self.middle
        return rows


def controller_episodes(unit: Any, dtype: np.dtype[Any]) -> Iterator[Rows]:
    """Yield inputs of the gait controller that excite its timeouts and its bounds of supply and loads."""
    limits, state = unit.settings.limits, unit.state
    supply, per_leg = state.supply, len(state.joints) // len(state.legs)
    for side in (1.0 - THRESHOLD_MARGIN, 1.0 + THRESHOLD_MARGIN):
        low = standing_rows(supply.low_ticks + 4, state, dtype)
        low["direct"]["bus_voltage"][2:] = supply.least_voltage * side
        yield low
        for number, leg in enumerate(state.legs):
            frozen = standing_rows(limits.frozen_load_ticks + 6, state, dtype)
            frozen["direct"]["loads"][:, number] = 0.5
            frozen["measurements"]["motor_speed"][:, number * per_leg] = leg.frozen_speed * side
            yield frozen
    for number in range(len(state.joints)):
        silent = standing_rows(limits.board_timeout + 6, state, dtype)
        silent["received"][2:, number] = False
        yield silent
    deaf = standing_rows(limits.board_timeout + 6, state, dtype)
    deaf["received"] = False
    yield deaf
    tripped = standing_rows(limits.lowering_ticks + 50, state, dtype)
    tripped["measurements"]["cause"][40:, 0] = SPEED_TRIP
    tripped["measurements"]["angle"] = tripped["measurements"]["last_angle"] = 0.3
    yield tripped
    late = standing_rows(limits.phase_ticks + 3, state, dtype)
    late["measurements"]["angle"], late["direct"]["loads"] = closing_angles(state, 1.0), math.nan
    yield late


def standing_rows(ticks: int, state: Any, dtype: np.dtype[Any]) -> Rows:
    """Return rows of the gait controller or the exoskeleton with joints at their first equilibrium angles."""
    rows, per_leg = np.zeros(ticks, dtype), len(state.joints) // len(state.legs)
    around = rows["direct"]
    around["bus_voltage"], around["loads"] = state.supply.voltage, 0.4
    if "boards" in field_names(rows):
        around["loads"][::2] *= 1.0 + 1e-6  # A constant load at a moving hip is a cause of a trip.
    for name in {"walk", "step"} & set(field_names(device_inputs(rows))):
        device_inputs(rows)[name] = 1.0
    if "received" in field_names(rows):
        rows["received"] = True
        for number, joint in enumerate(state.joints):
            phase = state.legs[number // per_leg].phase
            rows["measurements"]["angle"][:, number] = joint.setpoints[phase].equilibrium
    return rows


def codec_rows(messages: Sequence[CanMessage], dtype: np.dtype[Any]) -> Rows:
    """Return numbers and frames for every message: bounds of each signal, their neighbours, and others."""
    random, count, parts = np.random.default_rng(SEED), 64, list[Rows]()
    for number, message in enumerate(messages):
        rows = np.zeros(count, dtype)
        rows["message"], frames = number, rows["frame"]
        frames["identifier"], frames["length"] = message.identifier, message.length
        for index, signal in enumerate(message.signals):
            low, high = int(signal.lowest), int(signal.highest)
            near = [0, signal.missing, *(code + step for code in (low, high) for step in (-1, 0, 1))]
            codes = np.r_[near, random.integers(low, high, count - len(near), endpoint=True)]
            random.shuffle(codes)
            steps = codes + random.choice([-0.501, -0.499, 0.0, 0.499, 0.501], count)
            steps[random.choice(count, 3, replace=False)] = math.nan, math.inf, -math.inf
            rows["values"][:, index] = steps * signal.scale + signal.offset
            frames["halves"][:, signal.half] |= (codes & signal.mask) << signal.start
        frames["halves"][: count // 4] = random.integers(0, 2**31, (count // 4, 2))
        frames["identifier"][-3] += 1
        frames["length"][-2] -= 1
        parts.append(rows)
    return np.concatenate(parts)


def device_inputs(rows: Rows) -> np.ndarray:
    """Return the signals of the whole device; records without a field if the unit reads none."""
    around = rows["direct"]
    return around["device_signals"] if "device_signals" in field_names(around) else around[[]]


def field_names(rows: np.ndarray) -> tuple[str, ...]:
    """Return the names of the fields of records."""
    return rows.dtype.names or ()


def closing_angles(state: Any, command: float) -> Values:
    """Return angles near the first equilibrium angles at which no leg leaves its first phase.

    They are the equilibrium angles if there are none. No load is measured then. ``command``: 1 to walk,
    0 to stand.
    """
    program, legs = state.program, state.legs
    joints = np.array(state.joints).reshape(len(legs), -1)
    device = [math.nan] + [command] * (len(DEVICE_SIGNALS) - 1)
    steps = product((0.0, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3), repeat=len(legs))
    for offsets in [*sorted(steps, key=np.linalg.norm), (0.0,) * len(legs)]:
        angles = [
            [joint.setpoints[leg.phase].equilibrium + offset * (joint is row[0]) for joint in row]
            for leg, row, offset in zip(legs, joints, offsets, strict=True)
        ]
        leg_signals = [[*chain(*((angle, 0.0) for angle in row)), math.nan, LONG] for row in angles]
        if not any(
            rule.source == leg.phase
            and evaluate_guard(
                program,
                rule.first_node,
                rule.end_node,
                [*leg_signals[k], *leg_signals[k - 1], *device],
                legs[k - 1].phase,
            )
            for k, leg in enumerate(legs)
            for rule in program.transitions[: program.n_transitions]
        ):
            break
    return np.ravel(angles)
