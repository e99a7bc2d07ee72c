"""The list of signals in the record of every engine is laid out as it is declared."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from twin_gait import load_experiment, simulate
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.guards import AllOf, parse_guard
from twin_gait.gait.signals import all_signal_names
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.kernels.pinocchio_kernel import PinocchioKernel
from twin_gait.simulation.compiled_engine import CompiledEngine
from twin_gait.simulation.lane_engine import MIN_BLOCK_SIZE, LaneEngine
from twin_gait.simulation.reference_engine import ReferenceEngine
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup

TICKS = 20


def problem() -> SimulationSetup:
    experiment = load_experiment(
        "treadmill_guided", ["table=treadmill_start_stop", "duration_s=0.02"]
    ).experiment
    return build_setup(experiment)


def compiled(given: SimulationSetup) -> Any:
    engine = CompiledEngine(given)
    engine.run()
    return engine.store.view(np.recarray)[0].controller


def in_lanes(given: SimulationSetup) -> Any:
    engines = [CompiledEngine(given) for _ in range(MIN_BLOCK_SIZE)]
    LaneEngine(engines).run()
    return engines[0].store.view(np.recarray)[0].controller


def reference(given: SimulationSetup) -> Any:
    pitching: Mapping[str, Callable[..., Any]] = {
        **PinocchioKernel(given.world, given.control_model).functions,
        "trunk_pitch": lambda one: 0.25,
    }
    engine = ReferenceEngine(given, kernel=pitching)
    engine.run()
    return engine.episode.controller


@pytest.mark.parametrize("engine", [compiled, pytest.param(in_lanes, marks=pytest.mark.slow), reference])
def test_signals_have_their_declared_index(engine):
    """After a tick as the right leg, which is the last one, has read them."""
    given = problem()
    controller = engine(given)
    found = dict(zip(all_signal_names(given.table.joints), list(controller.signals), strict=True))
    expected = {
        "trunk.pitch_deg": 0.25 if engine is reference else 0.0,
        "walk": float(controller.device_signals.walk),
        "step": 1.0,
    }
    for front, leg in (("", 1), ("other.", 0)):
        for index, joint in enumerate(given.table.joints):
            measured = controller.joints[2 * leg + index].measurement
            expected[f"{front}{joint}.angle_deg"] = measured.angle
            expected[f"{front}{joint}.velocity_deg_per_s"] = measured.velocity
        expected[f"{front}foot.load_bw"] = controller.legs[leg].load
        expected[f"{front}time_in_phase_s"] = controller.legs[leg].ticks * TICK
    assert found.items() >= expected.items()
    assert len({*expected.values()}) > len(given.table.joints) * 4  # hardly any two are alike


def guarded(table: GaitTable, text: str) -> GaitTable:
    """A table whose guards all hold a further condition."""
    further = parse_guard(text)
    transitions = (
        item if item.is_timeout else replace(item, guard=AllOf(guards=(item.guard, further)))
        for item in table.transitions
    )
    return replace(table, transitions=tuple(transitions))


def walk(text: str, **changes: Any) -> Experiment:
    experiment = load_experiment("treadmill_guided", ["duration_s=1.2"]).experiment
    return replace(experiment, table=guarded(experiment.table, text), **changes)


@pytest.mark.slow
def test_a_guard_on_the_guided_trunk_is_read_by_the_engines():
    plain = simulate(load_experiment("treadmill_guided", ["duration_s=1.2"]).experiment)
    upright, bent = (simulate(walk(f"trunk.pitch_deg {text}")) for text in ("< 5", "> 5"))
    assert upright.log.equals(plain.log) and len(plain.switches) > 2
    assert [item.cause for item in bent.switches] == ["timeout"] * len(bent.switches)
