"""Inputs that excite the guards of a gait table, in the gait controller and in the exoskeleton as one unit.

A walk takes few of the transitions of its table. Here each signal of a guard is put just below and just above
the thresholds that it is compared with.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from twin_gait.control.gait_controller import PER_JOINT, PER_LEG
from twin_gait.core.guards import OP_COMPARE, CompiledComparison
from twin_gait.core.safety import Bounds
from twin_gait.firmware.excitation import (
    SEED,
    THRESHOLD_MARGIN,
    BoardInputs,
    Rows,
    Values,
    closing_angles,
    device_inputs,
    field_names,
    standing_rows,
)
from twin_gait.firmware.python_unit import PythonUnit
from twin_gait.gait.signals import DEVICE_SIGNALS

LONGEST_HOLD = 1300  # Ticks for which the signals of the guards stay the same.
CONTROLLER_TICKS, EXOSKELETON_TICKS = 9000, 5000  # Ticks in which guards are excited.


class Guards:
    """Inputs that put every comparison of a gait table just below and just above its threshold.

    The phases of the legs decide which transition is excited next, so that the unit runs along. Its joints
    follow by ramps if it is the exoskeleton, whose monitor allows no jump.
    """

    def __init__(
        self, unit: PythonUnit, state: Any, dtype: np.dtype[Any], boards: Sequence[BoardInputs]
    ) -> None:
        """Keep a unit, its gait controller at tick 0, the layout of its inputs, and boards if it has them."""
        self.unit, self.state, self.dtype, self.boards = unit, state, dtype, boards
        self.legs, self.per_leg = len(state.legs), len(state.joints) // len(state.legs)
        self.block, self.random = PER_JOINT * self.per_leg + PER_LEG, np.random.default_rng(SEED)
        self.uses: dict[tuple[int, int], float] = defaultdict(float)  # By transition and node.

    def episodes(self, ticks: int, requests: int) -> Iterator[tuple[Rows, Rows]]:
        """Yield inputs with outputs until there are ``ticks``; ``requests``: of the operating modes."""
        while ticks > 0:
            rows, outputs = list[Rows](), list[Rows]()
            self.angles = np.array([board.middle for board in self.boards])
            phases, tripped = [leg.phase for leg in self.state.legs], False
            with self.unit:
                while ticks > 0 and not tripped:
                    rows.append(self._hold(phases))
                    if requests and self.random.random() < 0.2:
                        rows[-1]["direct"]["request"][0] = self.random.integers(0, requests + 1)
                    outputs.append(self.unit.exchange(rows[-1]))
                    decision = outputs[-1]["decision"][-1]
                    phases, tripped = decision["phases"].tolist(), bool(decision["trip_cause"])
                    ticks -= len(rows[-1])
            yield np.concatenate(rows), np.concatenate(outputs)

    def _hold(self, phases: Sequence[int]) -> Rows:
        """Return rows that excite the least used comparison of a leg, below its threshold, then above."""
        low = self.random.uniform(-0.2, 0.6, self.legs * self.block + len(DEVICE_SIGNALS))
        low[self.legs * self.block + 1 :] = 1.0
        program, choices = self.state.program, list[tuple[float, int, int, int]]()
        for leg, phase in enumerate(phases):
            for index, rule in enumerate(program.transitions[: program.n_transitions]):
                if rule.source == phase:
                    nodes = range(rule.first_node, rule.end_node)
                    self._put(leg, nodes, -1.0, low)  # Closed, if it is not the chosen one.
                    choices += [(self.uses[index, k] + self.random.random(), leg, index, k) for k in nodes]
        if not choices:
            return self._rows(low, 9)
        _, leg, index, chosen = min(choices)
        rule = program.transitions[index]
        nodes = range(rule.first_node, rule.end_node)
        self._put(leg, nodes, 1.0, low)
        high, ticks = low.copy(), rule.debounce_ticks + 2
        self._put(leg, [chosen], -THRESHOLD_MARGIN, low)
        self._put(leg, [chosen], THRESHOLD_MARGIN, high)
        for item in self._comparisons(nodes):
            is_time_in_phase = item.factor_b == 0.0 and item.signal_a % self.block == self.block - 1
            if is_time_in_phase:
                ticks += round(1000.0 * abs(item.threshold))
        first = min(max(ticks, rule.timeout_ticks + 3), LONGEST_HOLD)
        self.uses[index, chosen] += 1.0 + first / 200.0
        last = self.random.choice([ticks, 150], p=[0.9, 0.1])  # Some last until parameters have faded.
        return np.concatenate([self._rows(low, first), self._rows(high, int(last))])

    def _comparisons(self, nodes: Iterable[int]) -> list[CompiledComparison]:
        program = self.state.program
        compared = (program.nodes[k] for k in nodes if program.nodes[k].operation == OP_COMPARE)
        return [program.comparisons[node.operand] for node in compared]

    def _put(self, leg: int, nodes: Iterable[int], side: float, values: Values) -> None:
        """Set first signals of comparisons above their thresholds, or below; clearly with a side of ±1."""
        for item in self._comparisons(nodes):
            gap = self.random.uniform(0.01, 0.2) if abs(side) == 1.0 else abs(item.threshold) + 1e-4
            value, indices = item.threshold + side * gap, list[int]()
            for signal in (item.signal_a, item.signal_b):
                device = signal - 2 * self.block  # Behind both legs; otherwise of this leg or the other one.
                index = (leg * self.block + signal) % (self.legs * self.block)
                indices.append(self.legs * self.block + device if device >= 0 else index)
            if item.factor_b != 0.0:
                value -= item.factor_b * values[indices[1]]
            values[indices[0]] = value / item.factor_a

    def _rows(self, values: Values, ticks: int) -> Rows:
        """Return rows with signals of all legs and of the device; behind a ramp for the exoskeleton."""
        joints, behind = PER_JOINT * self.per_leg, self.legs * self.block
        leg_rows = values[:behind].reshape(self.legs, self.block)
        angles = leg_rows[:, 0:joints:PER_JOINT].ravel()
        if self.boards:
            lowest, highest = (
                np.array([getattr(board.bounds, name) for board in self.boards])
                for name in ("lower", "upper")
            )
            most = np.array([0.6 * board.bounds.highest_speed * board.period for board in self.boards])
            start, self.angles = self.angles, np.clip(angles, lowest + 0.2, highest - 0.2)
            count = max(1, math.ceil(np.max(np.abs(self.angles - start) / most)))
            path = start + (self.angles - start) * np.minimum(np.arange(count + ticks) / count, 1.0)[:, None]
            rows = standing_rows(len(path) - 1, self.state, self.dtype)
            for index, board in enumerate(self.boards):
                rows["boards"][:, index] = board.rows_along(path[:, index])[1:]
        else:
            rows = standing_rows(ticks, self.state, self.dtype)
            measured = rows["measurements"]
            measured["angle"] = measured["last_angle"] = angles
            measured["velocity"] = leg_rows[:, 1:joints:PER_JOINT].ravel()
        rows["direct"]["loads"] *= np.abs(leg_rows[:, joints]) / 0.4
        for name, value in zip(("trunk_pitch", "walk", "step"), values[behind:], strict=True):
            if name in field_names(device_inputs(rows)):
                device_inputs(rows)[name] = value
        return rows


def exoskeleton_episodes(sample: Any, dtype: np.dtype[Any], unit: PythonUnit) -> Iterator[tuple[Rows, Rows]]:
    """Yield inputs of all boards and the gait controller in one unit, with its outputs."""
    state, boards, seen = sample.controller, list[BoardInputs](), list[Bounds]()
    for number, (board, joint) in enumerate(zip(sample.boards, state.joints, strict=True)):
        middle = joint.setpoints[state.legs[number * len(state.legs) // len(state.joints)].phase].equilibrium
        boards.append(BoardInputs(board.bounds, sample.settings.rates.period, dtype["boards"].base, middle))
    resting = [
        BoardInputs(board.bounds, board.period, board.dtype, angle)
        for board, angle in zip(boards, closing_angles(state, 0.0), strict=True)
    ]
    for number, moved in enumerate(boards):
        if moved.bounds in seen:  # Equal bounds are printed as one table.
            continue
        seen.append(moved.bounds)
        heating = resting[number].heating_rows()
        for used, episodes in ((boards, moved.monitor_bound_rows()), (resting, heating)):
            for one in episodes:
                rows = standing_rows(len(one), state, dtype)
                for index, other in enumerate(used):
                    rows["boards"][:, index] = one if index == number else other.rows_at_rest(len(one) - 2)
                if used is resting:
                    rows["direct"]["loads"] = math.nan
                    for name in field_names(device_inputs(rows)):
                        device_inputs(rows)[name] = 0.0
                with unit:
                    yield rows, unit.exchange(rows)
    for side in (1.0 - THRESHOLD_MARGIN, 1.0 + THRESHOLD_MARGIN):
        turning = boards[0].rows_at_speed(side * state.legs[0].frozen_speed, boards[0].middle)
        rows = standing_rows(len(turning), state, dtype)
        for index, other in enumerate(boards):
            rows["boards"][:, index] = turning if index == 0 else other.rows_at_rest(len(rows) - 2)
        rows["direct"]["loads"] = 0.4
        rows["direct"]["bus_voltage"][-state.supply.low_ticks :] = side * state.supply.least_voltage
        with unit:
            yield rows, unit.exchange(rows)
    yield from Guards(unit, state, dtype, boards).episodes(EXOSKELETON_TICKS, 0)
