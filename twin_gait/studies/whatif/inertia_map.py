"""The linear loop of an inertia compensation over one tick, as a matrix.

The joint is linear: motor and link, rigid or with a compliant gear, viscous friction, a hand that holds the
link or none. In a tick the firmware estimates the acceleration, answers with a torque and holds it while the
joint moves on, exactly. The matrix is what this does to each unit of the state.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.linalg import expm

from twin_gait.core.estimation import first_order_gain
from twin_gait.gait.table import TICK

_DOUBLINGS = 20  # 2^20 ticks: a quarter of an hour


class Source(StrEnum):
    """What the acceleration is taken from."""

    ENCODER = "encoder"  # on the motor, differentiated twice
    GYROSCOPE = "gyroscope"  # on the link, differentiated once
    ACCELEROMETER = "accelerometer"  # on the link


@dataclass(frozen=True, kw_only=True)
class InertiaLoop:
    """A joint with inertia compensation.

    Attributes:
        source: Of the acceleration.
        share: Of the inertia that is compensated.
        delay: Ticks between a sample of the inertial unit and its use; nothing to the encoder.
        time_constant: Of the filters behind differences and samples in [s]; the encoder has two.
        motor_inertia: In [kg m²].
        link_inertia: In [kg m²].
        friction: Viscous, on the motor, in [N m s] / [rad].
        hand_stiffness: In [N m] / [rad].
        hand_damping: In [N m s] / [rad].
        gear_stiffness: In [N m] / [rad]; 0 for a rigid gear.
        gear_damping: In [N m s] / [rad].
    """

    source: Source
    share: float
    delay: int
    time_constant: float
    motor_inertia: float
    link_inertia: float
    friction: float
    hand_stiffness: float = 0.0
    hand_damping: float = 0.0
    gear_stiffness: float = 0.0
    gear_damping: float = 0.0

    @property
    def filter_gain(self) -> float:
        """Of the first-order filters."""
        return first_order_gain(TICK, self.time_constant)

    @property
    def command(self) -> float:
        """Torque per estimated acceleration in [kg m²]."""
        return self.share * (self.motor_inertia + self.link_inertia)


def mean_delay(loop: InertiaLoop) -> float:
    r"""Mean delay of the estimated acceleration in [s], without the tick over which a torque is held.

    Half a tick for each difference, :math:`(1-\alpha)/\alpha` ticks for each filter of gain :math:`\alpha`,
    and what the samples are under way. It is the slope of the phase at low frequencies.

    Args:
        loop: The loop.

    Returns:
        The delay.
    """
    gain = loop.filter_gain
    filtering = (1.0 - gain) / gain
    ticks = {
        Source.ENCODER: 1.0 + 2.0 * filtering,
        Source.GYROSCOPE: 0.5 + filtering + loop.delay,
        Source.ACCELEROMETER: filtering + loop.delay,
    }
    return ticks[loop.source] * TICK


def rates(loop: InertiaLoop) -> np.ndarray:
    r"""Matrix of the joint under a torque that is held: :math:`\dot x = A x` with the torque in x.

    Args:
        loop: The loop.

    Returns:
        Rates of angles, velocities and the torque, which stays: shape ``(3, 3)`` for a rigid gear, else
        ``(5, 5)`` with motor before link.
    """
    if loop.gear_stiffness == 0.0:
        mass = loop.motor_inertia + loop.link_inertia
        stiffness, damping = loop.hand_stiffness / mass, (loop.hand_damping + loop.friction) / mass
        return np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0 / mass], [0.0, 0.0, 0.0]])
    masses = np.array([[loop.motor_inertia], [loop.link_inertia]])
    between = np.array([[1.0, -1.0], [-1.0, 1.0]])
    whole = np.zeros((5, 5))
    whole[:2, 2:4] = np.eye(2)
    whole[2:4, :2] = -(loop.gear_stiffness * between + np.diag([0.0, loop.hand_stiffness])) / masses
    whole[2:4, 2:4] = -(loop.gear_damping * between + np.diag([loop.friction, loop.hand_damping])) / masses
    whole[2, 4] = 1.0 / loop.motor_inertia
    return whole


class TickMap:
    """What a tick does to the state of a loop, and what noise adds.

    The state: angles, velocities and torque of :func:`rates`; the last angle, the fast velocity and the
    estimated acceleration of the firmware; the samples of the unit, newest first.

    Attributes:
        loop: The loop.
        matrix: Of the state over a tick, shape ``(n, n)``.
        noise: What a unit of noise in the sensor adds, shape ``(n,)``.
    """

    def __init__(self, loop: InertiaLoop) -> None:
        """Find the matrix, column by column."""
        self.loop = loop
        self._rates = rates(loop)
        self._moves = expm(TICK * self._rates)
        self._joint = len(self._rates)
        size = self._joint + 3 + loop.delay + 2
        self.matrix = np.array([self._tick(unit, 0.0) for unit in np.eye(size)]).T
        self.noise = self._tick(np.zeros(size), 1.0)

    @property
    def estimate(self) -> int:
        """Place of the estimated acceleration in the state."""
        return self._joint + 2

    def _tick(self, state: np.ndarray, noise: float) -> np.ndarray:
        joint = self._joint
        moving, (last, fast, estimate), samples = (
            state[:joint],
            state[joint : joint + 3],
            state[joint + 3 :],
        )
        gain = self.loop.filter_gain
        angle = moving[0] + (noise if self.loop.source is Source.ENCODER else 0.0)
        faster = fast + gain * ((angle - last) / TICK - fast)
        samples = np.concatenate([[self._sample(moving, noise)], samples[:-1]])
        late, later = samples[self.loop.delay], samples[self.loop.delay + 1]
        seen = {
            Source.ENCODER: (faster - fast) / TICK,
            Source.GYROSCOPE: (late - later) / TICK,
            Source.ACCELEROMETER: late,
        }[self.loop.source]
        estimate += gain * (seen - estimate)
        held = np.concatenate([moving[:-1], [self.loop.command * estimate]])
        return np.concatenate([self._moves @ held, [angle, faster, estimate], samples])

    def _sample(self, moving: np.ndarray, noise: float) -> float:
        """Velocity or acceleration of the link; the torque in it is that of the last tick."""
        link = self._joint // 2
        if self.loop.source is Source.ACCELEROMETER:
            return float(self._rates[2 * link - 1] @ moving + noise)
        return float(moving[2 * link - 1] + noise)


def growth(loop: InertiaLoop) -> float:
    """Rate of the fastest growing motion.

    Args:
        loop: The loop.

    Returns:
        In [1] / [s]; below 0 everything decays, a free joint has a mode at 0.
    """
    return float(np.log(np.abs(np.linalg.eigvals(TickMap(loop).matrix)).max()) / TICK)


def torque_noise(loop: InertiaLoop, deviation: float) -> float:
    r"""Standard deviation of the torque that white noise of a sensor makes in the closed loop.

    The covariance of the state solves :math:`P = A P A^T + \sigma^2 b b^T`.

    Args:
        loop: The loop, stable and held: a free joint would wander.
        deviation: σ of a sample: [rad], [rad] / [s] or [rad] / [s²], by the source.

    Returns:
        In [N m].
    """
    found = TickMap(loop)
    covariance = deviation * deviation * np.outer(found.noise, found.noise)
    passed = found.matrix
    # P = Σ A^k Q A^kᵀ, twice as many terms each time: the samples under way make a direct solution singular.
    for _ in range(_DOUBLINGS):
        covariance = covariance + passed @ covariance @ passed.T
        passed = passed @ passed
    return float(loop.command * np.sqrt(covariance[found.estimate, found.estimate]))


def felt_inertia(loop: InertiaLoop, frequency: float) -> float:
    r"""Inertia that a hand feels at a frequency, over the true one.

    With the response :math:`H` of the estimate to the true acceleration it is
    :math:`1 - \alpha\,\mathrm{Re}\,H(j\omega)`; for a rigid gear and frequencies at which the torque that is
    held for a tick is as good as a continuous one.

    Args:
        loop: The loop.
        frequency: In [Hz].

    Returns:
        A share; 1 without compensation.
    """
    pulsation = 2.0 * np.pi * frequency
    z = np.exp(1j * pulsation * TICK)
    gain = loop.filter_gain
    filtered = gain / (1.0 - (1.0 - gain) / z)
    difference = (1.0 - 1.0 / z) / (1j * pulsation * TICK)
    responses = {
        Source.ENCODER: difference**2 * filtered**2,
        Source.GYROSCOPE: difference * filtered * z**-loop.delay,
        Source.ACCELEROMETER: filtered * z**-loop.delay,
    }
    hold = (1.0 - 1.0 / z) / (1j * pulsation * TICK)
    return float(1.0 - loop.share * np.real(responses[loop.source] * hold))
