"""What the builds of an experiment's firmware give for the vectors of its runs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from twin_gait.firmware.cross import build_host, build_image, build_objects, sizes
from twin_gait.firmware.emulator import Emulator, HostUnit, UnitProcess
from twin_gait.firmware.linked import converted
from twin_gait.firmware.processor import walk_with
from twin_gait.firmware.project import Project
from twin_gait.firmware.vectors import Vectors
from twin_gait.simulation.run import Run


class Bench:
    """Builds of a project, and their outputs for vectors.

    Whatever needs a compiler or an emulator raises
    :class:`~twin_gait.exceptions.MissingToolError` without it.
    """

    def __init__(self, project: Project, vectors: Sequence[Vectors], folder: Path) -> None:
        """Write the C for vectors of some runs into a folder; nothing is built before it is asked for."""
        self.project, self.vectors, self.folder = project, vectors, folder
        self.unit = project.write_linked(folder)

    def host(self, *, double: bool) -> HostUnit:
        """The unit on this machine."""
        path = self.folder / ("double" if double else "single")
        return HostUnit(build_host(self.unit, path, flags=["-DREAL_DOUBLE"] if double else []))

    @cached_property
    def double(self) -> list[np.ndarray]:
        """Outputs on this machine in double numbers."""
        unit = self.host(double=True)
        return [self._run(unit, item, double=True) for item in self.vectors]

    @cached_property
    def single(self) -> list[np.ndarray]:
        """Outputs on this machine in float."""
        unit = self.host(double=False)
        return [self._run(unit, item) for item in self.vectors]

    @cached_property
    def image(self) -> Path:
        """For the Cortex-M4F."""
        return build_image(self.unit, self.folder / "image.elf")

    def _run(self, unit: UnitProcess, vectors: Vectors, *, double: bool = False) -> np.ndarray:
        given, taken = self.project.dtypes(double=double)
        with unit:
            return unit.exchange_many(converted(vectors.inputs, given)).view(taken)[:, 0]

    def on_target(self, vectors: Vectors) -> tuple[np.ndarray, Emulator]:
        """Outputs on the Cortex-M4F, and the emulator with what it has counted."""
        target = Emulator(self.image)
        return self._run(target, vectors), target

    def expected(self, *, double: bool) -> list[np.ndarray]:
        """Outputs of the simulation."""
        _, taken = self.project.dtypes(double=double)
        return [converted(item.outputs, taken) for item in self.vectors]

    def bytes_of(self, name: str) -> dict[str, int]:
        """Flash of a unit of the device, and RAM of its record."""
        unit = replace(self.unit, name=name, sources=(self.folder / f"{name}.c",))
        flash, variables = sizes(build_objects(unit, self.folder))
        return {"flash": flash, "ram": variables + self.project.record_bytes[name]}

    def walk(self, progress: Callable[[int, int], None] | None, on_compile: Callable[[], None] | None) -> Run:
        """The experiment with the Cortex-M4F as its controller."""
        with Emulator(self.image) as target:
            return walk_with(target, self.project, self.vectors[0].run.experiment, progress, on_compile)
