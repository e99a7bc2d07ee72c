"""The supervisor in C: over requests, postures and a trip it does what the simulation does, bit for bit."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from firmware_tools import require_tools

from twin_gait import load_experiment
from twin_gait.configuration.experiments import resolved_document
from twin_gait.firmware.exoskeleton_unit import record_vectors
from twin_gait.firmware.project import print_project
from twin_gait.firmware.project_folder import write_project

TABLE = Path(__file__).parents[1] / "tables" / "treadmill_modes.yaml"
REQUESTS = "walk@0.2s, sit@0.3s, step@0.4s, stop@1.6s, gravity@2.9s, stop@3.2s, twin_care@3.4s"


@pytest.mark.slow  # compiles an engine, and the C
def test_modes_in_c_equal_the_simulation(tmp_path):
    require_tools("gcc", "make")
    experiment = load_experiment(
        "treadmill_start_stop",
        [
            f"table={TABLE}",
            "modes=twin",
            "initial_mode=standing",
            f"requests=[{REQUESTS}]",
            "faults=[encoder_missing:left_knee@3.8s]",
            "duration_s=4",
        ],
    ).experiment
    project, vectors = print_project(experiment), record_vectors(experiment)
    assert experiment.modes is not None
    decision, names = vectors.outputs["decision"], np.array(experiment.modes.phase_names)
    entered = names[decision["mode"][np.flatnonzero(np.diff(decision["mode"])) + 1]].tolist()
    assert entered == [
        *("walk_manual", "manual_step", "walk_manual", "stopping", "standing"),
        *("gravity", "standing", "twin_care", "hold"),
    ]
    assert np.flatnonzero(decision["rejected"]).tolist() == [300]
    write_project(project, tmp_path, vectors, resolved_document(experiment, None, {}))
    built = subprocess.run(["make", "test"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "4000 ticks: 0 with other bits" in built.stdout


@pytest.mark.slow  # compiles an engine, and the C
def test_the_overground_walk_in_c_equals_the_simulation(tmp_path):
    require_tools("gcc", "make")
    requests = "requests=[walk@0.1s, step@0.2s, step@1.3s, stop@1.5s]"
    experiment = load_experiment("overground", ["modes=walking", requests, "duration_s=2"]).experiment
    vectors = record_vectors(experiment)
    write_project(print_project(experiment), tmp_path, vectors, resolved_document(experiment, None, {}))
    built = subprocess.run(["make", "test"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "2000 ticks: 0 with other bits" in built.stdout
