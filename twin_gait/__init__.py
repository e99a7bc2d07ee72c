"""Gait simulation of the TWIN leg exoskeleton.

    >>> from twin_gait import load_experiment, simulate  # doctest: +SKIP
    >>> run = simulate(load_experiment("treadmill").experiment)  # doctest: +SKIP
    >>> run.log["left_knee_angle_rad"].max()  # doctest: +SKIP
    >>> run.save("runs/walk")  # doctest: +SKIP
    >>> run.plot("gait_cycle", width_mm=85, out="cycle.pdf")  # doctest: +SKIP

Not a medical device.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from twin_gait.configuration import load_experiment, load_gait_table, presets
    from twin_gait.exceptions import TwinGaitError
    from twin_gait.experiment import Experiment
    from twin_gait.gait import GaitStateMachine, GaitTable
    from twin_gait.leg_model import LegModel
    from twin_gait.parameters import Patient
    from twin_gait.runs.public import load_run, plot_run, save_run
    from twin_gait.runs.summary import summarise
    from twin_gait.simulation import Run, RunStatus, simulate
    from twin_gait.studies.batch import simulate_batch
    from twin_gait.vocabulary import GaitPhase, JointName, Side

__all__ = [
    "Experiment",
    "GaitPhase",
    "GaitStateMachine",
    "GaitTable",
    "JointName",
    "LegModel",
    "Patient",
    "Run",
    "RunStatus",
    "Side",
    "TwinGaitError",
    "__version__",
    "load_experiment",
    "load_gait_table",
    "load_run",
    "plot_run",
    "presets",
    "save_run",
    "simulate",
    "simulate_batch",
    "summarise",
]

_HOMES = {
    "Experiment": "experiment",
    "GaitPhase": "vocabulary",
    "GaitStateMachine": "gait",
    "GaitTable": "gait",
    "JointName": "vocabulary",
    "LegModel": "leg_model",
    "Patient": "parameters",
    "Run": "simulation",
    "RunStatus": "simulation",
    "Side": "vocabulary",
    "TwinGaitError": "exceptions",
    "load_experiment": "configuration",
    "load_gait_table": "configuration",
    "load_run": "runs.public",
    "plot_run": "runs.public",
    "presets": "configuration",
    "save_run": "runs.public",
    "simulate": "simulation",
    "simulate_batch": "studies.batch",
    "summarise": "runs.summary",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that ``twin-gait --help`` answers at once."""
    if name not in _HOMES:
        raise AttributeError(f"module 'twin_gait' has no attribute {name!r}")
    return getattr(import_module(f"twin_gait.{_HOMES[name]}"), name)
