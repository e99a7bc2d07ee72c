"""Inputs that excite every constant of a unit: bounds of the monitor, guards, time-outs, silence, heat.

A walk stays inside its bounds and takes few of the transitions of its table. Here each bound is met from both
sides, and each signal of a guard is put just below and just above the thresholds that it is compared with.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from twin_gait.control.gait_controller import PER_JOINT, PER_LEG
from twin_gait.control.joint_board import Limits
from twin_gait.core.guards import GuardProgram
from twin_gait.core.safety import SPEED_TRIP, Bounds
from twin_gait.firmware.python_unit import PythonUnit

Rows = np.ndarray  # Inputs of a unit, shape ``(ticks,)``, from its tick 0 on.
BESIDE = 0.003  # Distance from a bound or a threshold, as a share of it.
HEAT = 8.0  # Heat to which the winding tends while the heat model is excited; the monitor trips at 1.
HOLDS = 900  # Combinations of signals beside their thresholds.
LONGEST_RAMPS = 400  # Ticks of the gait controller's inputs that the exoskeleton follows by ramps.
SEED = 48


def board_episodes(unit: Any, dtype: np.dtype[Any]) -> Iterator[Rows]:
    """Yield inputs of a joint board that excite its bounds, its limits and its friction model."""
    settings, bounds = unit.settings, unit.state.bounds
    rows = _Board(bounds, settings.rates.period, dtype)
    yield from rows.monitored()
    yield from rows.heated()
    limits: Limits = settings.limits
    for side in (1.0 - BESIDE, 1.0 + BESIDE):
        yield rows.held(bounds.torque_ticks + 3, target=side * bounds.highest_torque)
        yield rows.held(3, target=-side * bounds.highest_command)
        yield rows.held(3, target=side * limits.torque)
    silent = rows.held(limits.controller_silence + limits.lowering_ticks + 9, speed=0.1)
    silent["demand"]["gravity"], silent["heard"][4:] = 5.0, False
    yield silent
    held = rows.held(9, speed=0.2)
    held["demand"]["held"], held["demand"]["damping"] = True, 40.0
    yield held
    yield rows.wandering(np.random.default_rng(SEED))


class _Board:
    """Inputs of a board whose drive and encoder agree."""

    def __init__(
        self, bounds: Bounds, period: float, dtype: np.dtype[Any], middle: float | None = None
    ) -> None:
        self.bounds, self.period, self.dtype = bounds, period, dtype
        self.middle = 0.5 * (bounds.lower + bounds.upper) if middle is None else middle

    def moving(self, angles: np.ndarray, current: float = 0.0) -> Rows:
        """Return rows with angles in [rad], and the voltage of a motor that turns with them."""
        rows = np.zeros(len(angles), self.dtype)
        speed = np.diff(angles, prepend=angles[:1]) / self.period
        rows["angle"], rows["current"], rows["heard"] = angles, current, True
        rows["voltage"] = self.bounds.emf_constant * speed + self.bounds.model_resistance * current
        return rows

    def held(
        self, ticks: int, *, speed: float = 0.0, current: float = 0.0, deviation: float = 0.0,
        target: float = 0.0,
    ) -> Rows:  # fmt: skip
        """Return rows with a joint that stands, and a motor with a speed, a current and a demand."""
        rows = self.moving(np.full(ticks + 2, self.middle))
        rows["current"][2:], rows["current_deviation"][2:] = current, deviation
        rows["voltage"][2:] = self.bounds.emf_constant * speed + self.bounds.model_resistance * current
        rows["demand"]["target"][2:] = target
        return rows

    def travelling(self, speed: float, end: float, ticks: int = 120) -> Rows:
        """Return rows with a joint that moves at a speed in [rad] / [s] to an angle in [rad]."""
        return self.moving(end + speed * self.period * np.minimum(np.arange(-ticks, 4), 0))

    def monitored(self) -> Iterator[Rows]:
        """Yield rows on both sides of each bound of the monitor that the drive or the encoder can meet."""
        bounds = self.bounds
        for side in (1.0 - BESIDE, 1.0 + BESIDE):
            yield self.travelling(side * bounds.highest_speed, self.middle)
            jump = np.full(4, self.middle)
            jump[2:] += side * bounds.angle_step
            yield self.moving(jump)
            yield self.held(bounds.frozen_ticks + 3, speed=side * bounds.frozen_speed)
            yield self.held(3, current=side * bounds.highest_current)
            yield self.held(bounds.drive_ticks + 3, deviation=-side * bounds.drive_deviation)
            speed = 0.8 * bounds.highest_speed
            stop = (1.0 - 0.1 * (side - 1.0)) * bounds.stop_distance_factor * speed * speed
            yield self.travelling(speed, bounds.upper - stop)
            yield self.travelling(-speed, bounds.lower + stop)
        residual = 1.1 * bounds.model_deviation * bounds.model_gain / self.period
        yield self.held(900, speed=min(residual, 0.95 * bounds.frozen_speed))
        missing = np.full(4, self.middle)
        missing[2:] = math.nan
        yield self.moving(missing)

    def heated(self) -> Iterator[Rows]:
        """Yield rows with a current that heats the winding until the monitor trips, if there is one."""
        bounds = self.bounds
        current = min(math.sqrt(HEAT * bounds.cooling / bounds.heating), 0.99 * bounds.highest_current)
        final = bounds.heating * current * current / bounds.cooling
        if final > 1.02:
            yield self.held(
                3 + math.ceil(math.log(1.0 - 1.0 / final) / math.log(1.0 - bounds.cooling)), current=current
            )

    def wandering(self, random: np.random.Generator, ticks: int = 1500) -> Rows:
        """Return rows with smooth motions of all speeds, and demands that change."""
        times, bounds = np.arange(ticks) * self.period, self.bounds
        angles = np.full(ticks, self.middle)
        for part in (0.3, 0.15, 0.05):
            speed = part * bounds.highest_speed
            angles += speed * np.sin((rate := random.uniform(3.0, 12.0)) * times) / rate
        rows = self.moving(angles, 1.5)
        for name, most in (
            ("stiffness", 50.0),
            ("damping", 5.0),
            ("gain", 1.0),
            ("gravity", 9.0),
            ("inertia", 9.0),
        ):
            rows["demand"][name] = np.repeat(random.uniform(0.0, most, ticks // 50), 50)
        rows["demand"]["equilibrium"] = self.middle
        return rows


def controller_episodes(unit: Any, dtype: np.dtype[Any], requests: int) -> Iterator[Rows]:
    """Yield inputs of the gait controller; ``requests``: number of requests of the operating modes."""
    settings, state = unit.settings, unit.state
    limits, supply, per_leg = settings.limits, state.supply, len(state.joints) // len(state.legs)

    def standing(ticks: int) -> Rows:
        rows = np.zeros(ticks, dtype)
        around = rows["surroundings"]
        around["bus_voltage"], around["loads"], rows["heard"] = supply.voltage, 0.4, True
        for number, joint in enumerate(state.joints):
            phase = state.legs[number // per_leg].phase
            rows["measurements"]["angle"][:, number] = joint.setpoints[phase].equilibrium
        for name in ("walk", "step"):
            if name in _names(_device(rows)):
                _device(rows)[name] = 1.0
        return rows

    def signals(rows: Rows, leg: int, joint: int, name: str, value: np.ndarray) -> None:
        rows["measurements"][name][:, leg * per_leg + joint] = value

    for side in (1.0 - BESIDE, 1.0 + BESIDE):
        low = standing(supply.low_ticks + 4)
        low["surroundings"]["bus_voltage"][2:] = supply.least_voltage * side
        yield low
        for number, leg in enumerate(state.legs):
            frozen = standing(limits.frozen_load_ticks + 6)
            frozen["surroundings"]["loads"][:, number] = 0.5
            signals(frozen, number, 0, "motor_speed", np.full(len(frozen), leg.frozen_speed * side))
            yield frozen
    for number in range(len(state.joints)):
        silent = standing(limits.board_silence + 6)
        silent["heard"][2:, number] = False
        yield silent
    tripped = standing(limits.lowering_ticks + 50)
    tripped["measurements"]["cause"][40:, 0] = SPEED_TRIP
    tripped["measurements"]["angle"] = tripped["measurements"]["last_angle"] = 0.3
    yield tripped
    yield standing(2 * limits.phase_ticks + 3)
    values = _Thresholds(state.program, per_leg)
    random = np.random.default_rng(SEED)
    for _ in range(6):
        yield values.held(standing, random, requests, signals)


class _Thresholds:
    """Values of the signals of the guards, just below and just above their thresholds."""

    def __init__(self, program: GuardProgram, per_leg: int) -> None:
        self.per_leg, self.block = per_leg, PER_JOINT * per_leg + PER_LEG
        self.comparisons = program.comparisons[:]
        self.beside: dict[int, list[float]] = {}
        for item in self.comparisons:
            place = item.signal_a if item.signal_a >= 2 * self.block else item.signal_a % self.block
            if item.factor_b == 0.0:
                middle, gap = item.threshold * item.factor_a, BESIDE * abs(item.threshold) + 1e-6
                self.beside.setdefault(place, []).extend([middle - gap, middle + gap])

    def held(
        self, standing: Callable[[int], Rows], random: np.random.Generator, requests: int,
        put: Callable[[Rows, int, int, str, np.ndarray], None],
    ) -> Rows:  # fmt: skip
        """Return rows with combinations of such values, each for some ticks; two last until a time-out."""
        lengths = random.choice([3, 8, 20, 100], HOLDS // 6, p=[0.3, 0.4, 0.25, 0.05])
        lengths[random.integers(0, len(lengths), 2)] = 1300
        rows, legs = standing(int(lengths.sum())), standing(1)["surroundings"]["loads"].shape[1]
        found = np.zeros((len(lengths), legs * self.block))
        for column in range(found.shape[1]):
            near = self.beside.get(column % self.block, [-0.1, 0.0, 0.1])
            found[:, column] = random.choice(near, len(lengths))
        for hold, leg in enumerate(
            random.integers(0, legs, len(lengths))
        ):  # Of two signals the first follows.
            pairs = [item for item in self.comparisons if item.factor_b != 0.0]
            for item in pairs[:: 1 if random.random() < 0.5 else -1]:
                a, b = (
                    (leg * self.block + place) % found.shape[1] for place in (item.signal_a, item.signal_b)
                )
                gap = BESIDE * abs(item.threshold) * random.choice([-1.0, 1.0])
                found[hold, a] = (item.threshold + gap - item.factor_b * found[hold, b]) / item.factor_a
        ticks = np.repeat(found, lengths, axis=0)
        for leg in range(legs):
            for joint in range(self.per_leg):
                first = leg * self.block + PER_JOINT * joint
                put(rows, leg, joint, "angle", ticks[:, first])
                put(rows, leg, joint, "last_angle", ticks[:, first])
                put(rows, leg, joint, "velocity", ticks[:, first + 1])
            load = np.abs(ticks[:, (leg + 1) * self.block - PER_LEG])
            rows["surroundings"]["loads"][:, leg] = load
        device = _device(rows)
        for place, name in enumerate(("trunk_pitch", "walk", "step")):
            if name in _names(device):
                near = self.beside.get(2 * self.block + place, [0.0, 1.0])
                device[name] = np.repeat(random.choice(near, len(lengths)), lengths)
        if requests and "request" in _names(rows["surroundings"]):
            now = np.cumsum(lengths)[:-1]
            rows["surroundings"]["request"][now] = random.integers(0, requests + 1, len(now))
        return rows


def _device(rows: Rows) -> np.ndarray:
    """Return the signals of the whole device; records without a field if the unit reads none."""
    around = rows["surroundings"]
    return around["common"] if "common" in _names(around) else around[[]]


def _names(rows: np.ndarray) -> tuple[str, ...]:
    """Return the names of the fields of records."""
    return rows.dtype.names or ()


def exoskeleton_episodes(
    sample: Any, dtype: np.dtype[Any], controller: list[Rows], unit: PythonUnit
) -> Iterator[Rows]:
    """Yield inputs of all boards and the gait controller in one unit.

    ``sample``: the unit at tick 0. ``controller``: inputs of the gait controller, whose angles the joints
    reach by ramps. ``unit``: the unit in Python, whose equilibrium angles the joints follow while one is
    heated.
    """
    legs, joints, boards = sample.controller.legs, sample.controller.joints, list[_Board]()
    for number, (board, joint) in enumerate(zip(sample.boards, joints, strict=True)):
        middle = joint.setpoints[legs[number * len(legs) // len(joints)].phase].equilibrium
        boards.append(_Board(board.bounds, sample.settings.rates.period, dtype["boards"].base, middle))
    around, seen = controller[0]["surroundings"][:2], list[Bounds]()
    for number, own in enumerate(boards):
        if own.bounds in seen:  # Equal bounds are printed as one table.
            continue
        seen.append(own.bounds)
        for one in own.monitored():
            rows = np.zeros(len(one), dtype)
            for place, other in enumerate(boards):
                rows["boards"][:, place] = one if place == number else other.held(len(one) - 2)
            rows["surroundings"] = np.resize(around, len(rows))
            yield rows
        for one in own.heated():
            rows = np.zeros(len(one), dtype)
            rows["surroundings"] = np.resize(around, len(rows))
            rows["surroundings"]["loads"][::2] *= 1.0 + 1e-6  # A constant load at a moving hip is a cause.
            yield _followed(rows, boards, one["current"], number, unit)
    for given in controller:
        yield _reached(given[:LONGEST_RAMPS], boards, dtype)


def _followed(rows: Rows, boards: list[_Board], current: np.ndarray, heated: int, unit: PythonUnit) -> Rows:
    """Fill in rows in which every joint follows its equilibrium angle, and a current heats one of them."""
    period, angles = boards[0].period, np.array([board.middle for board in boards])
    most = np.array([0.15 * board.bounds.highest_speed * period for board in boards])
    emf, resistance = (
        np.array([getattr(board.bounds, name) for board in boards])
        for name in ("emf_constant", "model_resistance")
    )
    lowest = np.array([board.bounds.lower + 0.1 for board in boards])
    highest = np.array([board.bounds.upper - 0.1 for board in boards])
    change = np.zeros(len(boards))
    with unit:
        for tick in range(len(rows)):
            own = rows["boards"][tick]
            own["angle"], own["current"][heated] = angles, current[tick]
            own["voltage"] = emf * change / period + resistance * own["current"]
            wanted = unit.exchange(rows[tick : tick + 1])["demands"]["equilibrium"][0]
            change = np.clip(0.02 * (np.clip(wanted, lowest, highest) - angles), -most, most)
            angles = angles + change
    return rows


def _reached(given: Rows, boards: list[_Board], dtype: np.dtype[Any]) -> Rows:
    """Return inputs of the exoskeleton that reach the angles of those of the gait controller by ramps."""
    lowest = np.array([board.bounds.lower + 0.2 for board in boards])
    highest = np.array([board.bounds.upper - 0.2 for board in boards])
    most = np.array([0.6 * board.bounds.highest_speed * board.period for board in boards])
    angles = np.clip(given["measurements"]["angle"], lowest, highest)
    changes = np.any(np.diff(angles, axis=0) != 0.0, axis=1)
    starts = np.flatnonzero(np.r_[True, changes]).tolist()
    path, places, present = list[np.ndarray](), list[int](), angles[0]
    for first, end in zip(starts, [*starts[1:], len(angles)], strict=True):
        goal = angles[first]
        ticks = max(1, int(np.ceil(np.max(np.abs(goal - present) / most))))
        path += [present + (goal - present) * (k / ticks) for k in range(1, ticks)] + [goal] * (end - first)
        places += [first, first + 1] * (ticks // 2) + [first] * ((ticks - 1) % 2)
        places = places[: len(path) - (end - first)] + list(range(first, end))
        present = goal
    rows = np.zeros(len(path), dtype)
    for place, board in enumerate(boards):
        rows["boards"][:, place] = board.moving(np.array(path)[:, place])
    rows["surroundings"] = given["surroundings"][np.minimum(places, len(given) - 1)]
    rows["surroundings"]["loads"][::2] *= 1.0 + 1e-6  # A constant load at a moving hip is a cause to trip.
    return rows
