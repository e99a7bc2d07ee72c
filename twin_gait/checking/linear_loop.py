"""The linear loop of firmware and leg over one frame, as a matrix.

A frame is the time between two samples of the slow velocity: ten ticks of 1 ms. In each tick the firmware
measures (:func:`twin_gait.core.control_tick.measure_joint`), computes a torque
(:func:`twin_gait.control.joint_board.compute_torque`) and holds it while the leg moves. Linearised, each of
these steps is a matrix; their product over the ticks of a frame is exact, without averaging.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from twin_gait.gait.table import TICK

# Blocks of the state with n joints each: angle, velocity, fast velocity, last angle, angle of the last slow
# sample. They are followed by the ring buffer of slow samples and the delayed torques, both newest first.
ANGLE, VELOCITY, FAST, LAST, DECIMATED, RING = range(6)

# Poles whose real part is five times the one of the slowest pole contribute little to the response (Ogata,
# Modern Control Engineering, from memory).
DOMINANCE = 5.0
_SERIES = 14  # terms of the exponential: 0.5^15 / 15! is 2e-17
_GONE = 1e-6  # a mode with a smaller eigenvalue has decayed after one frame
_STILL = 1e-4  # [1 / s]; rate of a mode that is zero but for rounding


class LegMotion(NamedTuple):
    """Motion of a leg over one tick under constant torques."""

    free: np.ndarray  # transition matrix of angles and velocities, shape ``(2 n, 2 n)``
    driven: np.ndarray  # input matrix of the torques, shape ``(2 n, n)``


def leg_motion(mass: np.ndarray, stiffness: np.ndarray, damping: np.ndarray) -> LegMotion:
    r"""Compute the motion of a linearised leg over one tick by one matrix exponential.

    The zero-order hold of :math:`M \ddot q = -K q - D \dot q + \tau`.

    ``mass``: M in [kg·m²], armature included, shape ``(n, n)``. ``stiffness``: K, the slope of the leg's own
    torques over the angles, in [N·m/rad], shape ``(n, n)``. ``damping``: diagonal of D, the slope of the
    friction over the velocity, in [N·m·s/rad], shape ``(n,)``. Returns the motion.
    """
    n = len(damping)
    inverse = np.linalg.inv(mass)
    rates = np.zeros((3 * n, 3 * n))
    rates[:n, n : 2 * n] = np.eye(n)
    rates[n : 2 * n, :n] = -inverse @ stiffness
    rates[n : 2 * n, n : 2 * n] = -inverse @ np.diag(damping)
    rates[n : 2 * n, 2 * n :] = inverse
    moved = exponential(TICK * rates)
    return LegMotion(moved[: 2 * n, : 2 * n], moved[: 2 * n, 2 * n :])


def exponential(matrix: np.ndarray) -> np.ndarray:
    """Compute the exponential of a square matrix by scaling and squaring.

    The matrix is halved until its norm is below one half; its power series is then squared as often. This is
    method 3 of C. Moler, C. Van Loan: Nineteen dubious ways to compute the exponential of a matrix,
    twenty-five years later, SIAM Review 45 (2003) 3-49. The first omitted term is below 3e-17. The method is
    written out because importing scipy.linalg takes longer than checking a gait table.
    """
    halvings = max(0, math.ceil(math.log2(max(float(np.abs(matrix).sum(axis=0).max()), 1e-300))) + 1)
    part = matrix / 2.0**halvings
    found = term = np.eye(len(matrix))
    for order in range(1, _SERIES + 1):
        term = term @ part / order
        found = found + term
    return np.asarray(np.linalg.matrix_power(found, 2**halvings))


@dataclass(frozen=True, kw_only=True)
class LinearLoop:
    """Leg and firmware, linearised at a posture and a velocity, for n coupled joints."""

    motion: LegMotion  # motion of the leg in a tick
    stiffness: np.ndarray  # k in [N·m/rad], shape ``(n,)``
    damping: np.ndarray  # b in [N·m·s/rad], applied to the fast velocity, shape ``(n,)``
    gain: np.ndarray  # G, applied to the slow velocity, shape ``(n,)``
    # slope of the compensator's friction model in [N·m·s/rad], shape ``(n,)``
    modelled_friction: np.ndarray
    # slope of the gravity compensation over the angles in [N·m/rad], shape ``(n, n)``
    feed_forward: np.ndarray
    fast_gain: float  # gain of the first-order filter of the fast velocity
    decimation: int  # ticks between two slow samples
    window: int  # slow samples that are averaged
    delay: int = 0  # ticks from a measurement to the torque computed from it

    @property
    def frame(self) -> float:
        """Length of a frame in [s]."""
        return self.decimation * TICK


def _rows(loop: LinearLoop) -> int:
    return RING + loop.window + loop.delay


def _measurement(loop: LinearLoop, decimates: bool) -> np.ndarray:
    """Return the matrix by which the sensors change the state in one tick; angle and velocity stay."""
    n, rows = len(loop.stiffness), _rows(loop)
    eye = np.eye(n)
    measures = np.eye(rows * n).reshape(rows, n, rows, n)  # identity, reshaped into blocks
    measures[FAST, :, FAST] = (1.0 - loop.fast_gain) * eye
    measures[FAST, :, ANGLE] = loop.fast_gain / TICK * eye
    measures[FAST, :, LAST] = -loop.fast_gain / TICK * eye
    measures[LAST] = measures[ANGLE]
    if decimates:
        measures[RING + 1 : RING + loop.window] = measures[RING : RING + loop.window - 1].copy()
        measures[RING] = 0.0
        measures[RING, :, ANGLE] = eye / loop.frame
        measures[RING, :, DECIMATED] = -eye / loop.frame
        measures[DECIMATED] = measures[ANGLE]
    return measures.reshape(rows * n, rows * n)


def _response(loop: LinearLoop) -> np.ndarray:
    """Return the matrix from the measured state to the torque of the controller, shape ``(n, n_states)``."""
    n, rows = len(loop.stiffness), _rows(loop)
    response = np.zeros((n, rows, n))
    response[:, LAST] = loop.feed_forward - np.diag(loop.stiffness)
    response[:, FAST] = -np.diag(loop.damping)
    for sample in range(RING, RING + loop.window):
        response[:, sample] = np.diag(loop.gain * loop.modelled_friction) / loop.window
    return response.reshape(n, rows * n)


def transition_matrix(loop: LinearLoop) -> np.ndarray:
    """Compute the matrix from the state before one slow sample to the state before the next.

    It has ``(5 + window + delay) n`` states. The first tick of the frame takes a slow sample, the others do
    not.
    """
    n = len(loop.stiffness)
    leg, on_the_way = np.eye(_rows(loop) * n), RING + loop.window
    torques = np.vstack((_response(loop), leg[on_the_way * n :]))  # newest first
    leg[on_the_way * n :] = torques[: loop.delay * n]
    leg[: 2 * n, : 2 * n] = loop.motion.free
    leg[: 2 * n] += loop.motion.driven @ torques[loop.delay * n :]
    plain = leg @ _measurement(loop, decimates=False)
    sampled = leg @ _measurement(loop, decimates=True)
    return np.asarray(np.linalg.matrix_power(plain, loop.decimation - 1) @ sampled)


def spectral_radius(matrix: np.ndarray) -> float:
    """Return the largest magnitude of the eigenvalues: the loop is stable below 1 and unstable above."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def effective_damping_ratio(matrix: np.ndarray, frame: float) -> float:
    r"""Compute the least damping ratio among the dominant oscillations.

    An eigenvalue :math:`\lambda` of the map over a frame :math:`T` is the mode
    :math:`s = \ln(\lambda) / T` of a continuous system, with the damping ratio
    :math:`\zeta = -\operatorname{Re}(s) / |s|`. A pair is dominant unless it decays ``DOMINANCE`` times as
    fast as the slowest mode; this excludes the modes of the filters.

    ``matrix``: from :func:`transition_matrix`. ``frame``: T in [s]. Returns the least ζ of the dominant
    pairs; negative if unstable, 1 if no dominant mode oscillates.
    """
    values = np.linalg.eigvals(matrix)
    modes = np.log(values[np.abs(values) > _GONE].astype(complex)) / frame
    # A joint without a spring remains at its angle: this mode neither decays nor oscillates.
    modes = modes[np.abs(modes) > _STILL]
    slowest = float(modes.real.max(initial=-np.inf))
    pairs = modes[(modes.imag > _STILL) & (modes.real >= min(DOMINANCE * slowest, 0.0))]
    return float((-pairs.real / np.abs(pairs)).min(initial=1.0))
