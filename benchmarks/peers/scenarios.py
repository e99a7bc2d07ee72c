"""Cases of the benchmark: three scenarios, each with two integrators and steps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from twin_gait import Experiment, LegModel, load_experiment
from twin_gait.core.belt import Belt
from twin_gait.experiment.experiment import Engine, Integration, IntegrationMethod
from twin_gait.gait.table import TICK
from twin_gait.parameters.environment import SupportParameters
from twin_gait.worlds.treadmill import Treadmill
from twin_gait.worlds.world import World

EULER, RK4 = IntegrationMethod.SEMI_IMPLICIT_EULER, IntegrationMethod.RK4


@dataclass(frozen=True, kw_only=True)
class HangingScenario(Treadmill):
    """Both legs stepping in the air: the wearer hangs in the support without ground."""

    support: SupportParameters = field(default_factory=lambda: SupportParameters(share=1.0))

    def build(self, model: LegModel, **parameters: Any) -> World:
        """Return the treadmill without ground and without a height that counts as a fall."""
        world = super().build(model, **parameters)
        return replace(world, contact=None, contact_frames={}, fall_height=-math.inf, belt=Belt())


@dataclass(frozen=True, kw_only=True)
class Case:
    """Scenario with an integrator and a step.

    Attributes:
        scenario: Name of the scenario.
        experiment: Closed loop with ideal sensors, so that all implementations simulate the same motion.
        compared_ticks: Ticks over which angles are compared with the reference.
    """

    scenario: str
    experiment: Experiment
    compared_ticks: int

    @property
    def integration(self) -> Integration:
        """Integrator and step."""
        return self.experiment.resolved_integration

    @property
    def evaluations(self) -> int:
        """Number of evaluations of the forward dynamics in a tick."""
        return self.integration.substeps * (4 if self.integration.method is RK4 else 1)

    @property
    def step(self) -> str:
        """Short name of integrator and step."""
        method = "RK4" if self.integration.method is RK4 else "Euler"
        return f"{method} {self.integration.step * 1e3:g} ms"

    def lasting(self, ticks: int) -> Experiment:
        """Return the experiment with a duration of a number of ticks."""
        return replace(self.experiment, duration=ticks * TICK)


def cases() -> list[Case]:
    """Return all scenarios, each with its two integrators."""
    bench, treadmill = (load_experiment(name).experiment for name in ("bench_leg", "treadmill_guided"))
    hanging = replace(treadmill, name="contact_free_biped", scenario=HangingScenario(), table=bench.table)
    scenarios = (
        ("bench_leg", bench, ((EULER, 1e-3), (RK4, 1e-3)), 2000),
        ("contact_free_biped", hanging, ((EULER, 1e-3), (RK4, 1e-3)), 1000),
        ("treadmill", treadmill, ((EULER, 0.25e-3), (RK4, 0.1e-3)), 500),
    )
    return [
        Case(scenario=name, experiment=_timed(experiment, method, step), compared_ticks=ticks)
        for name, experiment, integrations, ticks in scenarios
        for method, step in integrations
    ]


def _timed(experiment: Experiment, method: IntegrationMethod, step: float) -> Experiment:
    return replace(
        experiment,
        engine=Engine.COMPILED,
        integration=Integration(method=method, step=step),
        sensors=replace(experiment.sensors, ideal=True, angle_noise=0.0),
    )
