"""Free trunk of the second loop (:mod:`oracle`): harness, arms and crutches, and their use.

Arms have polar coordinates: an axial force does work as the strut lengthens, a moment as it turns.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from twin_gait.gait.table import TICK
from twin_gait.simulation.simulation_setup import SimulationSetup
from twin_gait.worlds.overground import Overground

SHOULDER = 0.288  # height of the shoulders above the hips over body height: Winter (2009), figure 4.1
NormalForceLaw = Callable[[float, float], float]


class UpperBody:
    """Trunk, harness, and two arms with their crutches; coordinates of the tips follow all others."""

    def __init__(self, problem: SimulationSetup, normal_force: NormalForceLaw) -> None:
        """Read the parameters and plant both crutches; ``normal_force``: law of the ground's normal force."""
        scenario, patient = problem.experiment.scenario, problem.experiment.patient
        assert isinstance(scenario, Overground) and scenario.crutches is not None and patient is not None
        self.habit, self.limits, self.pressed = scenario.arms, scenario.crutches, normal_force
        model, self.harness, self.tall = problem.world.model, scenario.harness, patient.height
        self.weight = model.total_mass * problem.experiment.plant.gravity
        self.rubbing = scenario.contact.friction_coefficient
        self.longest = self.limits.length * self.tall
        self.body = [model.forward_index, model.pelvis_index, model.pitch_index]
        self.gravity, self.last = problem.experiment.plant.gravity, np.zeros(model.nv)
        self.hips = [model.index(side, "hip") for side in model.sides]
        self.turn: int | None = None  # crutch of the present or next step
        self.moved: int | None = None  # crutch that has been lifted for it
        self.announces = True  # whether the device may step
        q, self.tick, self.still, self.felt = problem.world.start_q, 0, 0, []
        self.first_lean = float(q[self.body[2]])
        self.arms = []
        for tip in (model.nv, model.nv + 2):
            arm = SimpleNamespace(
                tip=[tip, tip + 1], load=0.0, off=0.0, push=self.habit.axial_force * self.weight, turn=0.0
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
            arm.growing, arm.turning = growing, turning
            push = arm.push + arm.k * (arm.held - arm.length) - arm.b * (growing @ v)
            arm.off = arm.held * np.sin(arm.held_angle - angle)
            moment = arm.turn + arm.length * (arm.kt * arm.off - arm.bt * arm.length * (turning @ v))
            stretched = limits.straight_stiffness * max(arm.length - self.longest, 0.0)
            pulled = np.clip(push, -limits.pull_limit, limits.push_limit) - stretched
            found += max(pulled, -limits.tension_limit) * growing
            found += np.clip(moment, -limits.moment_limit, limits.moment_limit) * turning
            arm.load = self.pressed(q[arm.tip[1]], v[arm.tip[1]])
            sheared = limits.tip_stiffness * (q[arm.tip[0]] - arm.stuck) + limits.tip_damping * v[arm.tip[0]]
            most = self.rubbing * arm.load
            found[arm.tip] += -np.clip(sheared, -most, most), arm.load
        return found

    def _rod(self, q: np.ndarray, v: np.ndarray, arm: SimpleNamespace) -> tuple[np.ndarray, np.ndarray]:
        """Return mass matrix, and forces of gravity and motion, of a rod for the body and its tip."""
        at, c, m = [*self.body, *arm.tip], self.limits.centre_of_mass, self.limits.mass
        shoulder = SHOULDER * self.tall * np.exp(1j * (0.5 * np.pi - q[self.body[2]]))
        away = complex(*q[arm.tip]) - complex(*q[self.body[:2]]) - shoulder
        e = away / arm.length
        turning = arm.turning[at] - np.array([0.0, 0.0, 1.0, 0.0, 0.0])
        centre = np.array([0.0, 0.0, 0.0, 1.0, 1j]) - 1j * c * e * turning
        mass = m * (centre[:, None] * centre.conj()).real + self.limits.inertia * np.outer(turning, turning)
        spin, pitching = turning @ v[at], v[self.body[2]]
        spun = (
            (-1j * e.conjugate() * shoulder).real * pitching**2 - 2.0 * spin * (arm.growing @ v)
        ) / arm.length
        moved = -c * e * (1j * spun - spin**2) + 1j * self.gravity
        return mass, -m * (centre.conj() * moved).real - self.limits.inertia * spun * turning

    def react(self, q: np.ndarray, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Return the reactions of the rods on the body for its last accelerations, shape ``(nv,)``."""
        found = np.zeros(len(self.last))
        for arm in self.arms:
            mass, forces = self._rod(q, v, arm)
            body = self.last[self.body]
            tip = np.linalg.solve(mass[3:, 3:], torque[arm.tip] + forces[3:] - mass[3:, :3] @ body)
            found[self.body] += forces[:3] - mass[:3] @ np.array([*body, *tip])
        return found

    def accelerate(self, q: np.ndarray, v: np.ndarray, torque: np.ndarray, body: np.ndarray) -> list[float]:
        """Return the accelerations of the tips for those of the body."""
        found, self.last = list[float](), body
        for arm in self.arms:
            mass, forces = self._rod(q, v, arm)
            right = torque[arm.tip] + forces[3:] - mass[3:, :3] @ body[self.body]
            found += [*np.linalg.solve(mass[3:, 3:], right)]
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
        arm.kt, arm.bt = habit.transverse_stiffness, habit.transverse_damping

    def decide(self, q: np.ndarray, v: np.ndarray, swinging: list[bool]) -> None:
        """Decide on the arms in a tick from the sensations of the person before the delay."""
        ahead = swinging[1] if any(swinging) else q[self.hips[0]] > q[self.hips[1]]
        turn = 0 if ahead else 1  # the crutch opposite to the leg of the step
        aheads, loads = [self._ahead(q, arm) for arm in self.arms], [arm.load for arm in self.arms]
        self.felt.append((q[self.body[2]], v[self.body[2]], any(swinging), aheads, loads, turn))
        late = self.tick - round(self.habit.delay / TICK)
        nothing = (self.first_lean, 0.0, False, self.first_ahead, [0.0, 0.0], None)
        lean, rate, steps, aheads, loads, self.turn = self.felt[late] if late >= 0 else nothing
        self.tick += 1
        self.still = 0 if steps else self.still + 1
        for arm, other, ahead, load in zip(self.arms, self.arms[::-1], aheads, loads, strict=True):
            arm.since += 1
            getattr(self, f"_{arm.doing}")(arm, other, lean, rate, steps, ahead, load)
        if self.habit.pattern != "as_needed" and self.turn is not None:
            if steps == (self.habit.pattern == "four_point"):
                self.moved = None
            planted = all(arm.doing == "planted" for arm in self.arms)
            prepared = self.habit.pattern == "two_point" or self.moved == self.turn
            self.announces = not steps and planted and prepared and min(loads) > self.habit.announce_load

    def _planted(self, arm, other, lean, rate, swinging, ahead, load):  # type: ignore[no-untyped-def]
        habit, rest = self.habit, round(self.habit.planted / TICK)
        wanted = (
            habit.axial_force
            + habit.axial_force_per_lean * (lean - habit.lean)
            + habit.axial_force_per_lean_rate * rate
        )
        arm.push, arm.turn = (
            np.clip(wanted * self.weight, habit.min_axial_force * self.weight, self.limits.push_limit),
            -habit.shoulder_moment,
        )
        share = 1.0 - np.exp(-TICK / habit.yielding)
        arm.held += share * (arm.length - arm.held)
        arm.held_angle -= share * arm.off / arm.length
        stand = min(arm.since, other.since) > rest and other.doing == "planted"
        if habit.pattern != "as_needed" and self.turn is not None:
            mine = self.arms.index(arm) == self.turn != self.moved
            if load < habit.touch:
                arm.reach = arm.held_angle - lean
                self._lower(arm)
            elif stand and mine and swinging == (habit.pattern == "two_point"):
                self.moved = self.turn
                self._lift(arm, lean, habit.reach)
            return
        comes, away = ahead < habit.lift_ahead, abs(ahead - self.longest * np.sin(habit.stand_reach))
        still = min(self.still, arm.since, other.since) > habit.still / TICK
        replaces = still and away > habit.stand_slack
        if stand and not swinging and (comes or replaces):
            self._lift(arm, lean, habit.reach if comes else habit.stand_reach)

    def _lift(self, arm: SimpleNamespace, lean: float, reach: float) -> None:
        habit = self.habit
        arm.doing, arm.since, arm.begin, arm.reach = "swung", 0, arm.held_angle - lean, reach
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
        self._lower(arm)
        if load > self.habit.touch:
            self._plant(arm)

    def _lower(self, arm: SimpleNamespace) -> None:
        if arm.held < self.longest:
            arm.held = min(arm.held + self.habit.lowering * TICK, self.longest)
        else:
            arm.held_angle -= np.sign(arm.reach) * self.habit.lowering * TICK / self.longest
