"""What computes an episode, and in which steps."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from twin_gait.gait.table import TICK
from twin_gait.parameters import require
from twin_gait.parameters.quantities import Parameters, Range, Time
from twin_gait.worlds.scenario import Scenario


class Engine(StrEnum):
    """What steps through the episode: the same laws, as Python on Pinocchio or compiled."""

    PINOCCHIO = "pinocchio"
    COMPILED = "compiled"


class IntegrationMethod(StrEnum):
    """Fixed-step integrator of the plant."""

    SEMI_IMPLICIT_EULER = "semi_implicit_euler"
    RK4 = "rk4"


# In [s]. Finer steps gain nothing: rounding outgrows the integrator's error, and a second takes minutes.
FINEST_STEP = 1e-7
STEPS = Range(FINEST_STEP, TICK, words=f"{FINEST_STEP:g} to {TICK:g} s")
_BRACED_STEP = 0.1e-3  # in [s] of the compiled engine


@dataclass(frozen=True, kw_only=True)
class Integration(Parameters):
    """Integrator and step.

    Attributes:
        method: The integrator.
        step: In [s]; a whole number of steps must fill a tick of 1 ms.
    """

    method: IntegrationMethod = IntegrationMethod.SEMI_IMPLICIT_EULER
    step: Annotated[Time, STEPS] = 0.25e-3

    def __post_init__(self) -> None:
        """Check that steps fill a tick."""
        super().__post_init__()
        ratio = TICK / self.step
        such = f"a whole number of steps in {TICK:g} s, such as {TICK / max(1, round(ratio)):g} s"
        require(abs(ratio - round(ratio)) < 1e-9 * ratio, "step", such, self.step)

    @property
    def substeps(self) -> int:
        """Steps in a tick."""
        return round(TICK / self.step)


def default_integration(engine: Engine, scenario: Scenario, *, braced: bool = False) -> Integration:
    """Integrator and step where none is asked for.

    The compiled engine can afford what the accuracy of the solution calls for: Runge-Kutta at 1 ms, and at
    0.1 ms where stiff contacts open and close or braces bind a light foot. The Pinocchio engine steps in
    Python and takes the largest step at which it still runs the contacts stably and faster than real time.
    """
    if engine is Engine.PINOCCHIO:
        return Integration()
    step = min(_BRACED_STEP, scenario.step) if braced else scenario.step
    return Integration(method=IntegrationMethod.RK4, step=step)
