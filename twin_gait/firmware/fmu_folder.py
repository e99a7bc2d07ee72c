"""The folder of the FMUs of an experiment: archives, the resolved document and a manifest."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin_gait.configuration.documents import dump_yaml
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.fmu import write_fmu
from twin_gait.firmware.fmu_controller import controller_fmu
from twin_gait.firmware.project_folder import MANIFEST


def write_fmus(experiment: Experiment, folder: Path, document: Mapping[str, Any]) -> dict[str, Any]:
    """Write the FMUs of an experiment, and its resolved document, into a folder; return the manifest.

    Raises FirmwareError, with key, value and remedy, for functions that only the simulation has, and
    MissingToolError without gcc.
    """
    yaml = dump_yaml(dict(document))
    counts = {}
    for unit, variables in (controller_fmu(experiment),):
        name = f"{unit.name}.fmu"
        files = {"resources/experiment.yaml": yaml}
        write_fmu(unit, variables, folder / name, files, experiment.duration)
        found = [item.causality for item in variables]
        counts[name] = {f"{item}s": found.count(item) for item in ("input", "output", "parameter")}
    manifest = {
        "experiment": experiment.name,
        "table": experiment.table.name,
        "provenance": document["provenance"],
        "fmus": counts,
    }
    (folder / "experiment.yaml").write_text(yaml, encoding="utf-8")
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return manifest
