"""Firmware project of an experiment: the C of all units, and the units in Python to compare it with."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin_gait.control.joint_board import JointSetpoint, Limits, Measurement
from twin_gait.core.elementary import sine_cosine
from twin_gait.exceptions import FirmwareError, MissingOptionalDependency
from twin_gait.experiment.bus import bus_messages
from twin_gait.experiment.experiment import Experiment
from twin_gait.firmware import units
from twin_gait.firmware.can_codec import (
    CanCodec,
    CanCodecInputs,
    CanCodecOutputs,
    CanFrame,
    CanMessage,
    can_codec_step,
    can_messages,
    can_pack,
    can_unpack,
)
from twin_gait.firmware.cross import UnitSources
from twin_gait.firmware.exoskeleton_unit import ExoskeletonUnit, build_exoskeleton_unit
from twin_gait.firmware.printer import Program, TranslationUnit, print_units
from twin_gait.firmware.python_unit import PythonUnit, UnitSample
from twin_gait.gait.program import DEVICE_BITS, compile_guards
from twin_gait.network.dbc import Message
from twin_gait.parameters.network import ImpedanceLocation, NetworkParameters
from twin_gait.simulation.initial_state import build_limits
from twin_gait.simulation.simulation_setup import SimulationSetup, build_setup
from twin_gait.templates import make_template_environment

UNITS = "joint_board", "gait_controller", "exoskeleton", "can_codec"
JOINT_BOARD, GAIT_CONTROLLER, EXOSKELETON, CAN_CODEC = UNITS
CODEC_STEP = "can_codec_step.h"
_INCLUDE = make_template_environment(Path(__file__).with_name("include"), keep_trailing_newline=True)


@dataclass(frozen=True)
class Project:
    """Firmware of an experiment."""

    setup: SimulationSetup  # Simulation setup of the experiment.
    exoskeleton: ExoskeletonUnit  # Gait controller and boards as one unit.
    messages: Mapping[str, Message]  # Messages of the CAN network by name; empty without cantools.
    program: Program  # All units in C.
    samples: Sequence[UnitSample]  # Boards, gait controller, exoskeleton and codec at tick 0.

    @property
    def joints(self) -> list[str]:
        """Joints in the order of the units, such as ``left_hip``."""
        return [f"{item.side}_{item.joint}" for item in self.setup.joints]

    def manifest(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """Return the sources of the C, with the provenance of a document, and the RAM of its records."""
        return {
            "experiment": self.setup.experiment.name,
            "table": self.setup.table.name,
            "source_sha256": self.program.source_hash,
            "provenance": document["provenance"],
            "can_codec": bool(self.messages),
            "record_bytes": self.record_bytes,
        }

    @property
    def record_bytes(self) -> dict[str, int]:
        """RAM in bytes that the records of the units need on a Cortex-M, by unit."""
        records = (units.JointBoard, units.GaitController, units.Exoskeleton)
        sizes = [self.program.records.dtype(item, "f4").itemsize for item in records]
        return dict(zip((JOINT_BOARD, GAIT_CONTROLLER, EXOSKELETON), sizes, strict=True))

    def write_sources(self, folder: Path) -> UnitSources:
        """Write only the C of all units into an existing folder, and return the linked unit in it."""
        for name, text in self.program.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        return UnitSources(EXOSKELETON, folder)

    def dtypes(
        self, *, double: bool, sample: UnitSample | None = None
    ) -> tuple[np.dtype[Any], np.dtype[Any]]:
        """Return the layouts in C of inputs and outputs of a unit, by default of the linked one.

        ``double``: whether numbers have double instead of single precision.
        """
        real = "f8" if double else "f4"
        sample = sample or next(item for item in self.samples if item.name == EXOSKELETON)
        if sample.name == CAN_CODEC:  # Its records are those of the test, and no unit uses them.
            values = ("values", real, len(sample.inputs.values))
            frame = ("frame", self.program.records.dtype(CanFrame, real))
            layouts = [("message", "i4"), values, frame], [frame, ("known", "?"), values]
            given, taken = (np.dtype(layout, align=True) for layout in layouts)
            return given, taken
        return (
            self.program.records.dtype(type(sample.inputs), real),
            self.program.records.dtype(type(sample.outputs), real),
        )

    def python_unit(self, sample: UnitSample) -> PythonUnit:
        """Return a unit in Python that is bound to the same names as in the simulation."""
        return PythonUnit(sample, self.exoskeleton.build_flags, self.exoskeleton.kernel)


def print_project(experiment: Experiment) -> Project:
    """Print the firmware of an experiment.

    Raises FirmwareError, with key, value and remedy, if it uses a function that the firmware does not have,
    GaitTableError if its table has more phases or conditions than an integer of the device has bits.
    """
    require_printable(experiment)
    setup = build_setup(experiment)
    compile_guards(setup.table, DEVICE_BITS)
    if experiment.modes is not None:
        compile_guards(experiment.modes, DEVICE_BITS)
    linked, messages = build_exoskeleton_unit(setup), _messages(experiment)
    files, shapes = list(_units(setup, linked)), _shapes(linked)
    records = {JOINT_BOARD: shapes[2:4], GAIT_CONTROLLER: shapes[4:6], EXOSKELETON: shapes[:2]}
    samples = [
        UnitSample(unit.name, init, unit.entries[0], record, *records[unit.name])
        for unit in files
        for init, record in unit.samples.items()
    ]
    if messages:
        codec = can_messages(messages)
        files.append(TranslationUnit(CAN_CODEC, [can_pack, can_unpack], codec))
        shapes.append(CanFrame())
        samples.append(_codec_sample(list(codec.values())))
    program = print_units(files, {**linked.build_flags, "sine_cosine": sine_cosine}, linked.kernel, shapes)
    if messages:
        step = _INCLUDE.get_template(CODEC_STEP).render(messages=codec, width=len(samples[-1].inputs.values))
        program.files[CODEC_STEP] = step
    return Project(setup, linked, messages, program, samples)


def require_printable(experiment: Experiment) -> None:
    """Raise FirmwareError, with key, value and remedy, for functions that only the simulation has."""
    control, network = experiment.control, experiment.network
    if experiment.controller is not None:
        raise FirmwareError(
            f"controller: {experiment.controller.name} is a controller of your own, which the firmware does "
            "not have; set controller=null to use control.mode"
        )
    unprinted = control.controller().unprinted_reason
    if unprinted:
        raise FirmwareError(unprinted)
    if control.delay_ticks > 0:
        raise FirmwareError(
            f"control.delay_ms: {control.delay_ticks} is the delay of the simulated drive, but the firmware "
            "answers within the tick; set 0"
        )
    if network is not None and network.impedance is ImpedanceLocation.CCU:
        problem = "ccu is not available in the firmware, which has the springs on the boards; set board"
        raise FirmwareError(f"network.impedance: {problem}")


def _units(setup: SimulationSetup, linked: ExoskeletonUnit) -> Iterator[TranslationUnit]:
    whole = linked.record
    apart = replace(whole.settings, limits=networked_limits(setup))
    boards = {
        f"{JOINT_BOARD}_{joint.side}_{joint.joint}": units.JointBoard(apart, board)
        for joint, board in zip(setup.joints, whole.boards, strict=True)
    }
    central = units.GaitController(apart, whole.controller)
    yield TranslationUnit(JOINT_BOARD, [units.joint_board_step], boards)
    yield TranslationUnit(GAIT_CONTROLLER, [units.gait_controller_step], {GAIT_CONTROLLER: central})
    yield TranslationUnit(EXOSKELETON, [units.exoskeleton_step], {EXOSKELETON: whole})


def networked_limits(setup: SimulationSetup) -> Limits:
    """Return the limits of separate units, which have timeouts even if the simulation has no bus."""
    return build_limits(setup, setup.experiment.network or NetworkParameters())


def _shapes(linked: ExoskeletonUnit) -> list[Any]:
    joints, legs = len(linked.record.boards), len(linked.record.controller.legs)
    measurements, setpoints = [Measurement() for _ in range(joints)], [JointSetpoint() for _ in range(joints)]
    return [
        linked.inputs,
        linked.outputs,
        units.JointBoardInputs(),
        units.JointBoardOutputs(),
        units.GaitControllerInputs(linked.inputs.direct, measurements, [False] * joints),
        units.GaitControllerOutputs(units.Decision([0] * legs, [0] * legs), setpoints),
    ]


def _codec_sample(messages: list[CanMessage]) -> UnitSample:
    """Return the codec as a unit for the test."""
    nothing = [0.0] * len(messages[0].signals)
    inputs, outputs = CanCodecInputs(0, nothing), CanCodecOutputs(CanFrame(), False, nothing)
    return UnitSample(CAN_CODEC, CAN_CODEC, can_codec_step, CanCodec(messages), inputs, outputs)


def _messages(experiment: Experiment) -> dict[str, Message]:
    try:
        return bus_messages(experiment)
    except MissingOptionalDependency:
        return {}
