"""Functional mock-up units in FMPy: variables by name, and the loop of controller and plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware.fmu import write_fmu
from twin_gait.firmware.fmu_controller import controller_fmu
from twin_gait.firmware.fmu_plant import plant_fmu

STEP = 0.001  # [s]


def write_both(experiment: Experiment, folder: Path) -> tuple[Path, Path]:
    """Write the FMUs of controller and plant, extracted, and return their folders."""
    paths = []
    for make in (controller_fmu, plant_fmu):
        unit, variables = make(experiment)
        archive = folder / f"{unit.name}.fmu"
        write_fmu(unit, variables, archive, {}, experiment.duration)
        paths.append(extract(archive))
    return paths[0], paths[1]


def extract(archive: Path) -> Path:
    """Extract an FMU next to it, and return its folder."""
    return Path(fmpy.extract(str(archive), unzipdir=str(archive.with_suffix(""))))


class Instance:
    """Instance of an extracted FMU, initialized with some parameters."""

    def __init__(self, folder: Path, parameters: Mapping[str, float] = {}) -> None:
        description = fmpy.read_model_description(str(folder), validate=False)
        self.variables = {item.name: item for item in description.modelVariables}
        identifier = description.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=identifier,
            instanceName=identifier,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        for name, value in parameters.items():
            self[name] = value
        self.fmu.exitInitializationMode()
        self.time = 0.0

    def __getitem__(self, name: str) -> Any:
        variable = self.variables[name]
        return getattr(self.fmu, f"get{variable.type}")([variable.valueReference])[0]

    def __setitem__(self, name: str, value: Any) -> None:
        variable = self.variables[name]
        getattr(self.fmu, f"set{variable.type}")([variable.valueReference], [value])

    def step(self, size: float = STEP) -> None:
        self.fmu.doStep(self.time, size)
        self.time += size

    def names(self, causality: str) -> list[str]:
        return [name for name, item in self.variables.items() if item.causality == causality]


def send(source: Instance, target: Instance) -> None:
    """Copy the outputs of an FMU to the inputs of the same names."""
    for name in target.names("input"):
        if name in source.variables and source.variables[name].causality == "output":
            target[name] = source[name]


def run_loop(controller: Instance, plant: Instance, ticks: int, columns: Sequence[str]) -> np.ndarray:
    """Run controller and plant, and return outputs of either, shape ``(ticks, n_columns)``.

    The plant's are those before a step, as in the log.
    """
    rows = []
    for _ in range(ticks):
        before = {name: plant[name] for name in columns if name in plant.names("output")}
        send(plant, controller)
        controller.step()
        send(controller, plant)
        plant.step()
        rows.append([before[name] if name in before else controller[name] for name in columns])
    return np.array(rows, float)
