"""The folder of the FMUs of an experiment: archives, the resolved document and a manifest."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from twin_gait.configuration.documents import dump_yaml
from twin_gait.exceptions import FirmwareError
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.fmu import write_fmu
from twin_gait.firmware.fmu_controller import controller_fmu
from twin_gait.firmware.fmu_plant import plant_fmu
from twin_gait.firmware.project_folder import MANIFEST


def write_fmus(experiment: Experiment, folder: Path, document: Mapping[str, Any]) -> dict[str, Any]:
    """Write ``controller.fmu`` and ``plant.fmu``, and the resolved document; return the manifest.

    An experiment whose plant has functions that only the simulation has gets the controller alone, and
    the reason in the manifest. Raises FirmwareError if this holds for the controller, MissingToolError
    without gcc.
    """
    yaml = dump_yaml(dict(document))
    manifest: dict[str, Any] = {
        "experiment": experiment.name,
        "table": experiment.table.name,
        "provenance": document["provenance"],
        "fmus": {},
        "missing": {},
    }
    for make in (controller_fmu, plant_fmu):
        try:
            unit, variables = make(experiment)
        except FirmwareError as error:
            if make is controller_fmu:
                raise
            manifest["missing"]["plant.fmu"] = str(error)
            continue
        name, found = f"{unit.name}.fmu", [item.causality for item in variables]
        write_fmu(unit, variables, folder / name, {"resources/experiment.yaml": yaml}, experiment.duration)
        manifest["fmus"][name] = {f"{item}s": found.count(item) for item in ("input", "output", "parameter")}
    (folder / "experiment.yaml").write_text(yaml, encoding="utf-8")
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return manifest
