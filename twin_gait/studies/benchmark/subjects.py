"""What the benchmark steps through: three worlds, each with the methods and steps it is timed at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from twin_gait.configuration import load_experiment
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import Engine, Experiment, Integration, IntegrationMethod
from twin_gait.gait.table import TICK
from twin_gait.leg_model import LegModel
from twin_gait.parameters import AnkleParameters, FrictionParameters, StopParameters, SupportParameters
from twin_gait.scenario import TreadmillScenario, World
from twin_gait.vocabulary import JointName

EULER_1_MS = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=1e-3)
EULER_QUARTER_MS = Integration(method=IntegrationMethod.SEMI_IMPLICIT_EULER, step=0.25e-3)
RK4_1_MS = Integration(method=IntegrationMethod.RK4, step=1e-3)
RK4_TENTH_MS = Integration(method=IntegrationMethod.RK4, step=0.1e-3)


@dataclass(frozen=True, kw_only=True)
class HangingScenario(TreadmillScenario):
    """Both legs stepping in the air: the wearer hangs in the support and nothing is below."""

    support: SupportParameters = field(default_factory=lambda: SupportParameters(share=1.0))

    def build(
        self,
        model: LegModel,
        *,
        friction: Mapping[JointName, FrictionParameters],
        load_friction: Mapping[JointName, float],
        stops: StopParameters,
        ankle: AnkleParameters,
        gravity: float,
    ) -> World:
        """Put a model on the treadmill and take the treadmill away.

        Args:
            model: Both legs with a vertical pelvis.
            friction: True friction of hip and knee.
            load_friction: Share of the motor torque that becomes friction, at hip and knee.
            stops: Mechanical stops.
            ankle: The orthosis.
            gravity: In [m] / [s²].

        Returns:
            The world, without ground and without a height that counts as a fall.
        """
        world = super().build(
            model,
            friction=friction,
            load_friction=load_friction,
            stops=stops,
            ankle=ankle,
            gravity=gravity,
        )
        return replace(world, contact=None, contact_frames={}, fall_height=None, belt_speed=0.0)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A subject with a method and a step.

    Attributes:
        subject: Key of ``SUBJECTS``.
        experiment: The closed loop; sensors are ideal, so that every contestant can step the same thing.
        compared_ticks: Ticks over which angles are compared with the reference.
    """

    subject: str
    experiment: Experiment
    compared_ticks: int

    @property
    def integration(self) -> Integration:
        """Integrator and step."""
        return self.experiment.stepping

    @property
    def stepping(self) -> str:
        """Method and step in a few letters, for tables."""
        method = "RK4" if self.integration.method is IntegrationMethod.RK4 else "Euler"
        return f"{method} {self.integration.step * 1e3:g} ms"

    def lasting(self, ticks: int) -> Experiment:
        """The experiment over a number of ticks."""
        return replace(self.experiment, duration=ticks * TICK)


def _bench_leg() -> Experiment:
    return load_experiment("bench_leg").experiment


def _treadmill() -> Experiment:
    return load_experiment("treadmill").experiment


def _hanging_biped() -> Experiment:
    return replace(
        _treadmill(), name="contact_free_biped", scenario=HangingScenario(), table=_bench_leg().table
    )


SUBJECTS = {
    "bench_leg": (_bench_leg, (EULER_1_MS, RK4_1_MS), 2000),
    "contact_free_biped": (_hanging_biped, (EULER_1_MS, RK4_1_MS), 1000),
    "treadmill": (_treadmill, (EULER_QUARTER_MS, RK4_TENTH_MS), 500),
}


def cases_of(only: str | None = None) -> list[Case]:
    """The cases of the benchmark.

    Args:
        only: One subject; None for all.

    Returns:
        Subjects in order, each with its methods.

    Raises:
        ParameterError: If there is no such subject.
    """
    if only is not None and only not in SUBJECTS:
        raise ParameterError(f"no subject {only!r}; there are {', '.join(SUBJECTS)}")
    cases = []
    for name, (build, integrations, compared_ticks) in SUBJECTS.items():
        if only in (None, name):
            experiment = _timed(build())
            cases += [
                Case(
                    subject=name,
                    experiment=replace(experiment, integration=integration),
                    compared_ticks=compared_ticks,
                )
                for integration in integrations
            ]
    return cases


def _timed(experiment: Experiment) -> Experiment:
    return replace(
        experiment, engine=Engine.COMPILED, sensors=replace(experiment.sensors, ideal=True, angle_noise=0.0)
    )
