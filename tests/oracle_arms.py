"""Free trunk of the second loop (:mod:`oracle`): harness, arms and crutches, and their use.

Arms have polar coordinates: an axial force does work as the strut lengthens, a moment as it turns.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from twin_gait.gait.table import TICK
from twin_gait.simulation.problem import Problem
from twin_gait.worlds.overground import Overground

SHOULDER = 0.288  # height of the shoulders above the hips over body height: Winter (2009), figure 4.1
Pressed = Callable[[float, float], float]


class UpperBody:
    """Trunk, harness, and two arms with their crutches; coordinates of the tips follow all others."""

    def __init__(self, problem: Problem, pressed: Pressed) -> None:
        """Read the parameters and plant both crutches; ``pressed``: law of the normal force of the ground."""
        scenario, patient = problem.experiment.scenario, problem.experiment.patient
        assert isinstance(scenario, Overground) and scenario.crutches is not None and patient is not None
        self.habit, self.limits, self.pressed = scenario.arms, scenario.crutches, pressed
        model, self.harness, self.tall = problem.world.model, scenario.harness, patient.height
        self.weight = model.total_mass * problem.experiment.plant.gravity
        self.rubbing = scenario.contact.friction_coefficient
        self.longest = self.limits.length * self.tall
        self.body = [model.forward_index, model.pelvis_index, model.pitch_index]
        q, self.tick, self.still, self.felt = problem.world.start_q, 0, 0, []
        self.first_lean = float(q[self.body[2]])
        self.arms = []
        for tip in (model.nv, model.nv + 2):
            arm = SimpleNamespace(
                tip=[tip, tip + 1], load=0.0, off=0.0, push=self.habit.push * self.weight, turn=0.0
            )
            arm.length, arm.held_angle, *_ = self._strut(q, arm.tip)
            arm.stuck = q[tip]
            self._plant(arm)
            self.arms.append(arm)
        self.first_ahead = [self._ahead(q, arm) for arm in self.arms]

    def _strut(self, q: np.ndarray, tip: list[int]) -> tuple[float, float, np.ndarray, np.ndarray]:
        """Return length, angle to the trunk, and their gradients with respect to all coordinates."""
        forward, height, pitch = self.body
        shoulder = SHOULDER * self.tall * np.exp(1j * (0.5 * np.pi - q[pitch]))
        apart = complex(*q[tip]) - complex(q[forward], q[height]) - shoulder
        way = np.zeros(len(q), complex)
        way[[forward, height, pitch, *tip]] = [-1.0, -1j, 1j * shoulder, 1.0, 1j]
        change = way / apart
        turning = change.imag.copy()
        turning[pitch] += 1.0
        return abs(apart), float(np.angle(apart * 1j) + q[pitch]), abs(apart) * change.real, turning

    def _ahead(self, q: np.ndarray, arm: SimpleNamespace) -> float:
        forward, _, pitch = self.body
        return float(q[arm.tip[0]] - q[forward] - SHOULDER * self.tall * np.sin(q[pitch]))

    def torque(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Compute the torques of rope, arms, and the ground on the tips, shape ``(nv + 4,)``."""
        found, limits = np.zeros(len(q)), self.limits
        _, height, pitch = self.body
        above = self.harness.height * self.tall
        rising = v[height] - above * np.sin(q[pitch]) * v[pitch]
        pull = self.harness.share * self.weight - self.harness.damping * rising
        found[height] += pull
        found[pitch] -= above * np.sin(q[pitch]) * pull
        for arm in self.arms:
            arm.length, angle, growing, turning = self._strut(q, arm.tip)
            push = arm.push + arm.k * (arm.held - arm.length) - arm.b * (growing @ v)
            arm.off = arm.held * np.sin(arm.held_angle - angle)
            moment = arm.turn + arm.length * (arm.kt * arm.off - arm.bt * arm.length * (turning @ v))
            stretched = limits.straight_stiffness * max(arm.length - self.longest, 0.0)
            found += (np.clip(push, -limits.pull_limit, limits.push_limit) - stretched) * growing
            found += np.clip(moment, -limits.moment_limit, limits.moment_limit) * turning
            arm.load = self.pressed(q[arm.tip[1]], v[arm.tip[1]])
            sheared = limits.tip_stiffness * (q[arm.tip[0]] - arm.stuck) + limits.tip_damping * v[arm.tip[0]]
            most = self.rubbing * arm.load
            found[arm.tip] += -np.clip(sheared, -most, most), arm.load
        return found

    def settle(self, q: np.ndarray) -> None:
        """End a step: move the sticking point of a tip whose shear exceeds the limit of friction."""
        for arm in self.arms:
            beyond = q[arm.tip[0]] - arm.stuck
            reach = self.rubbing * arm.load / self.limits.tip_stiffness
            arm.stuck += np.sign(beyond) * max(abs(beyond) - reach, 0.0)

    def _plant(self, arm: SimpleNamespace) -> None:
        habit = self.habit
        arm.doing, arm.since, arm.held = "planted", 0, arm.length
        arm.held_angle -= arm.off / arm.length
        arm.k, arm.b = habit.stiffness, habit.damping
        arm.kt, arm.bt = habit.turning_stiffness, habit.turning_damping

    def decide(self, q: np.ndarray, v: np.ndarray, swinging: bool) -> None:
        """Decide on the arms in a tick from the sensations of the person before the delay."""
        aheads, loads = [self._ahead(q, arm) for arm in self.arms], [arm.load for arm in self.arms]
        self.felt.append((q[self.body[2]], v[self.body[2]], swinging, aheads, loads))
        late = self.tick - round(self.habit.delay / TICK)
        nothing = (self.first_lean, 0.0, False, self.first_ahead, [0.0, 0.0])
        lean, rate, swinging, aheads, loads = self.felt[late] if late >= 0 else nothing
        self.tick += 1
        self.still = 0 if swinging else self.still + 1
        for arm, other, ahead, load in zip(self.arms, self.arms[::-1], aheads, loads, strict=True):
            arm.since += 1
            getattr(self, f"_{arm.doing}")(arm, other, lean, rate, swinging, ahead, load)

    def _planted(self, arm, other, lean, rate, swinging, ahead, load):  # type: ignore[no-untyped-def]
        habit, rest = self.habit, round(self.habit.planted / TICK)
        wanted = habit.push + habit.push_per_lean * (lean - habit.lean) + habit.push_per_rate * rate
        arm.push, arm.turn = np.clip(wanted * self.weight, 0.0, self.limits.push_limit), -habit.turn
        share = 1.0 - np.exp(-TICK / habit.yielding)
        arm.held += share * (arm.length - arm.held)
        arm.held_angle -= share * arm.off / arm.length
        stand = min(arm.since, other.since) > rest and other.doing == "planted"
        comes, away = ahead < habit.lift_ahead, abs(ahead - self.longest * np.sin(habit.stand_reach))
        still = min(self.still, arm.since, other.since) > habit.still / TICK
        replaces = still and away > habit.stand_slack
        if stand and not swinging and (comes or replaces):
            arm.doing, arm.since, arm.begin = "swung", 0, arm.held_angle - lean
            arm.reach = habit.reach if comes else habit.stand_reach
            arm.push, arm.turn, arm.held = 0.0, 0.0, arm.length - habit.clearance
            arm.k = arm.kt = habit.swing_stiffness
            arm.b = arm.bt = habit.swing_damping

    def _swung(self, arm, other, lean, rate, swinging, ahead, load):  # type: ignore[no-untyped-def]
        s = min(arm.since * TICK / self.habit.swing, 1.0)
        share = 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5
        arm.held_angle = arm.begin + share * (arm.reach - arm.begin) + lean
        if s >= 1.0 - 1e-9:
            arm.doing, arm.since = "lowered", 0

    def _lowered(self, arm, other, lean, rate, swinging, ahead, load):  # type: ignore[no-untyped-def]
        if arm.held < self.longest:
            arm.held = min(arm.held + self.habit.lowering * TICK, self.longest)
        else:
            arm.held_angle -= np.sign(arm.reach) * self.habit.lowering * TICK / self.longest
        if load > self.habit.touch:
            self._plant(arm)
