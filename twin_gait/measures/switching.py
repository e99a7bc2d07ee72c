r"""Effects of a switch of phase on the torque, the energy of the virtual spring and the motion.

The virtual spring of a joint stores :math:`E = \tfrac12 k (\theta - \theta_0)^2`, which changes as

.. math::

    \dot E = \left[\tfrac12 \dot k (\theta - \theta_0)^2 - k (\theta - \theta_0)\,\dot\theta_0\right]
        + k (\theta - \theta_0)\,\dot\theta

The bracket is the power of the switching: the controller puts this energy into the spring by changing its
parameters, positive if the spring gains. The other term is the power of the motion: the torque on the joint
is :math:`-k(\theta - \theta_0)`, so that the leg receives this work with the other sign.
"""

import math

import numpy as np

JERK_CUT_OFF = 50.0  # [Hz]
# A Gaussian is below 4e-4 of its peak beyond this number of standard deviations.
_KERNEL_REACH = 4.0


# ---------------------------------------------------------------------- torque


def blend_windows(switches: np.ndarray, blending_ticks: np.ndarray | int, length: int) -> np.ndarray:
    """Find the ticks in which the parameters of a leg change: from each switch to the end of its blend.

    A switch during a blend ends it, because the next blend begins from the current parameters. ``switches``:
    first ticks of new phases of one leg, ascending, each below ``length``, shape ``(m,)``;
    ``blending_ticks``: length of each blend, or one length for all; 0 without blending; ``length``: number
    of ticks of the record. Returns the first tick of each window and the first tick after it, integers, shape
    ``(m, 2)``.
    """
    starts = np.asarray(switches, dtype=int)
    following = np.append(starts[1:], length)[: len(starts)]
    return np.column_stack((starts, np.minimum(starts + blending_ticks + 1, following)))


def torque_jumps(torque: np.ndarray, windows: np.ndarray) -> np.ndarray:
    """Compute the largest change of a torque from one tick to the next in each window.

    ``torque`` in [N·m], shape ``(n,)``; ``windows`` from :func:`blend_windows`, none beginning at tick 0.
    Returns magnitudes in [N·m], shape ``(m,)``.
    """
    steps = np.abs(np.diff(torque))
    return np.array([steps[start - 1 : end - 1].max() for start, end in windows])


# ---------------------------------------------------------------------- energy


def spring_energy(angle: np.ndarray, stiffness: np.ndarray, equilibrium_angle: np.ndarray) -> np.ndarray:
    r"""Compute the energy in the virtual spring, :math:`\tfrac12 k (\theta - \theta_0)^2`.

    ``angle``: θ in [rad]; ``stiffness``: k in [N·m/rad]; ``equilibrium_angle``: θ0 in [rad]. Returns
    energy in [J], in the shape of the arguments.
    """
    deflection = angle - equilibrium_angle
    return np.asarray(0.5 * stiffness * deflection * deflection)


def switching_energy(angle: np.ndarray, stiffness: np.ndarray, equilibrium_angle: np.ndarray) -> np.ndarray:
    r"""Compute the energy that the controller puts into the virtual spring in each tick by changing k and θ0.

    The firmware holds its parameters within a tick and changes them at its start, with the joint at the
    measured angle. The integral of the switching part over such a step is the difference of two energies,

    .. math::

        \Delta_i = \tfrac12 k_i (\theta_i - \theta_{0,i})^2 - \tfrac12 k_{i-1} (\theta_i - \theta_{0,i-1})^2,

    exact for a step of any size, where the midpoint rule would leave :math:`\Delta k\,\Delta\theta_0^2 / 8`.
    For parameters that change continuously it converges to the integral with the first power of the tick.

    ``angle``: measured angle in [rad], one value a tick, shape ``(n,)``; ``stiffness``: k in force from each
    tick on in [N·m/rad], shape ``(n,)``; ``equilibrium_angle``: θ0 in force from each tick on in [rad],
    shape ``(n,)``. Returns energy in [J], positive into the spring, 0 in the first tick; shape ``(n,)``.
    """
    injected = np.zeros(len(angle))
    before = spring_energy(angle[1:], stiffness[:-1], equilibrium_angle[:-1])
    injected[1:] = spring_energy(angle[1:], stiffness[1:], equilibrium_angle[1:]) - before
    return injected


# ---------------------------------------------------------------------- jerk


def low_pass(signal: np.ndarray, tick: float, cut_off: float) -> np.ndarray:
    r"""Smooth a signal with a Gaussian, without delay.

    A sine of frequency f passes with the gain :math:`2^{-(f/f_c)^2/2}`, which is -3 dB at the cut-off. The
    ends of the record are continued by their first and last value. ``signal``: one value a tick, n at least
    1; ``cut_off``: :math:`f_c` in [Hz]. Returns the smoothed signal.
    """
    deviation = math.sqrt(math.log(2.0)) / (2.0 * math.pi * cut_off * tick)  # [ticks]
    reach = math.ceil(_KERNEL_REACH * deviation)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    return np.convolve(np.pad(signal, reach, mode="edge"), kernel / kernel.sum(), mode="valid")


def joint_jerk(velocity: np.ndarray, tick: float) -> np.ndarray:
    r"""Compute the jerk of a joint, :math:`d^2\omega/dt^2`, by differences of the low-passed velocity.

    A torque that steps gives a jerk that is not bounded: without a filter its root mean square would grow as
    the tick shrinks. The differences are central. The cut-off frequency lets the 25 ms of a short blend pass.
    ``velocity`` in [rad/s], one value a tick. Returns the jerk in [rad/s³], 0 in the first and the
    last tick.
    """
    jerk = np.zeros(len(velocity))
    if len(velocity) > 2:
        jerk[1:-1] = np.diff(low_pass(velocity, tick, JERK_CUT_OFF), n=2) / (tick * tick)
    return jerk


def dimensionless_jerk(velocity: np.ndarray, jerk: np.ndarray, spans: np.ndarray, tick: float) -> np.ndarray:
    r"""Compute the jerk of each stride, made dimensionless: independent of the stride's length and size.

    .. math::

        \frac{D^3}{\omega_{peak}^2} \int_0^D \left(\frac{d^2\omega}{dt^2}\right)^2 dt

    after Hogan and Sternad (2009, doi:10.3200/35-09-004-RC) and Balasubramanian et al. (2015,
    doi:10.1186/s12984-015-0090-9), who give it a minus sign. A sine has :math:`(2\pi)^4/2 = 779`.

    ``velocity`` in [rad/s]; ``jerk`` from :func:`joint_jerk`; ``spans``: first tick of each stride and of
    the next one, shape ``(m, 2)``. Returns one number a stride; NaN for a joint at rest. Shape ``(m,)``.
    """
    values = np.full(len(spans), np.nan)
    for number, (start, end) in enumerate(spans):
        peak = float(np.abs(velocity[start:end]).max())
        if peak > 0.0:
            duration = (end - start) * tick
            squared = float(np.sum(jerk[start:end] ** 2)) * tick
            values[number] = duration**3 * squared / (peak * peak)
    return values
