"""The folder of a firmware project: C, test vectors, the resolved document and a manifest."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import twin_gait
from twin_gait.configuration.documents import dump_yaml
from twin_gait.control.safety import TripCause
from twin_gait.firmware.exoskeleton_unit import RunVectors
from twin_gait.firmware.project import Project, networked_limits
from twin_gait.firmware.unit_vectors import excitation_csv, excitations_of, runner_records
from twin_gait.templates import make_template_environment

MANIFEST = "manifest.json"
_FILES = make_template_environment(Path(__file__).with_name("project_files"), keep_trailing_newline=True)


def write_project(
    project: Project, folder: Path, vectors: RunVectors, document: Mapping[str, Any]
) -> dict[str, Any]:
    """Write C, vectors of a short walk, excitations, and the resolved document; return the manifest."""
    project.write_sources(folder)
    problem, experiment = project.setup, project.setup.experiment
    counts, legs = experiment.sensors.encoder_counts, project.exoskeleton.record.controller.legs
    angles = [2.0 * math.pi / (counts * problem.actuator(joint).gear_ratio) for joint in problem.joints]
    content = {
        "project": project,
        "experiment": experiment,
        "table": problem.table,
        "version": twin_gait.__version__,
        "angles": dict(zip(project.joints, angles, strict=True)),
        "limits": networked_limits(problem),
        "phases": list(problem.table.phases),
        "legs": dict(zip(experiment.sides, legs, strict=True)),
        "causes": TripCause,
        **runner_records(project),
    }
    texts = {name: _FILES.get_template(name).render(content) for name in _FILES.list_templates()}
    texts["experiment.yaml"] = dump_yaml(dict(document))
    manifest = project.manifest(document)
    texts[MANIFEST] = json.dumps(manifest, indent=2) + "\n"
    texts["vectors.csv"] = vectors.csv(project.joints)
    texts["excitation.csv"] = excitation_csv(excitations_of(project))
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return manifest
