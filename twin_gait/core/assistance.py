"""Following a predetermined path, and helping only as much as is needed."""

from dataclasses import dataclass


def cycle_place(progress: float, samples: int) -> tuple[int, float]:
    """Where an instant of the gait cycle falls among evenly spaced samples of a path that closes.

    Whole cycles of the progress do not matter; the last sample is the first of the next cycle. Returns the
    number of the sample before the instant, and the share of the next one.
    """
    place = (progress - int(progress)) * (samples - 1)
    before = min(int(place), samples - 2)
    return before, place - before


@dataclass(slots=True)
class Adaptation:
    """How the assistance level follows the tracking error."""

    forgetting: float  # f, from 0 to 1.
    gain: float  # g in 1 / [rad].
    allowance: float  # e_0 in [rad].
    least: float  # α_min.


def adapted_assistance(adaptation: Adaptation, assistance: float, error: float) -> float:
    r"""Assistance level for the next stride, after the tracking error of the last one.

    :math:`\alpha_{n+1} = f\,\alpha_n + g\,\max(0, e_n - e_0), \qquad \alpha_{min} \le \alpha \le 1`

    with the mean absolute error e_n in [rad]. Assistance decays by the factor f and comes back where tracking
    is worse than the allowance, after J. L. Emken, J. E. Bobrow, D. J. Reinkensmeyer: Robotic movement
    training as an optimization problem, IEEE ICORR (2005) 307-312.
    """
    excess = max(0.0, error - adaptation.allowance)
    wanted = adaptation.forgetting * assistance + adaptation.gain * excess
    return min(1.0, max(adaptation.least, wanted))
