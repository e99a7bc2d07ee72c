"""The controller as a shared library for the compiled-controller interface of the library opensourceleg."""

from pathlib import Path
from typing import NamedTuple

import twin_gait
from twin_gait.control.safety import TripCause
from twin_gait.exceptions import MissingToolError
from twin_gait.firmware.cross import compile_library
from twin_gait.firmware.project import Project, networked_limits
from twin_gait.gait.table import TICK
from twin_gait.templates import make_template_environment

PREFIX = "twin_gait_osl"  # Prefix of the functions, and name of the library without its ending.
_FILES = make_template_environment(Path(__file__).with_name("osl_files"), keep_trailing_newline=True)


class Field(NamedTuple):
    """A number in the inputs or outputs of the library."""

    name: str  # Name, for example ``left_knee_angle``.
    meaning: str  # Meaning with its unit, for the comment.
    whole: bool = False  # Whether it is an integer of 32 bits instead of a double number.


def input_fields(project: Project) -> list[Field]:
    """Return the inputs of a step, in their order."""
    experiment = project.setup.experiment
    found = [Field("ticks", "ticks of 1 ms since the last call; 0 leaves the outputs as they are", True)]
    for joint in project.joints:
        found += [
            Field(f"{joint}_angle", "angle in [rad]; flexion and dorsiflexion are positive"),
            Field(f"{joint}_voltage", "voltage of the winding in [V]"),
            Field(f"{joint}_current", "measured current in [A]"),
            Field(f"{joint}_current_deviation", "measured minus expected current in [A]"),
        ]
    found += [Field(f"{side}_load", "load of the foot over body weight") for side in experiment.sides]
    found += [
        Field("bus_voltage", "voltage of the battery in [V]"),
        Field("trunk_pitch", "pitch of the trunk from upright in [rad], positive forward"),
    ]
    if experiment.modes is not None:
        return [*found, Field("request", "request to the supervisor, counted from 1; 0 for none", True)]
    return [*found, Field("walk", "1 to walk, 0 to stand"), Field("step", "1 to take a step, 0 to wait")]


def output_fields(project: Project) -> list[Field]:
    """Return the outputs of a step, in their order."""
    experiment = project.setup.experiment
    found = []
    for joint in project.joints:
        found += [
            Field(f"{joint}_current", "target current of the drive in [A], within all limits"),
            Field(f"{joint}_torque", "torque of the command before its limits in [N·m]"),
            Field(f"{joint}_stiffness", "stiffness k of the setpoint in [N·m/rad]"),
            Field(f"{joint}_damping", "damping b of the setpoint in [N·m·s/rad]"),
            Field(f"{joint}_equilibrium", "equilibrium angle of the setpoint in [rad]"),
            Field(f"{joint}_held", "1 if the joint is braked and lowered after a trip", True),
        ]
    found += [Field(f"{side}_phase", "phase of the leg", True) for side in experiment.sides]
    if experiment.modes is not None:
        found.append(Field("mode", "operating mode", True))
    return [*found, Field("trip_cause", "cause of the trip of the monitor, 0 for none", True)]


def write_osl(project: Project, folder: Path) -> Path | None:
    """Write the folder ``osl`` next to the C of a project: sources, Makefile, library, and loader in Python.

    Returns the library for this machine, in double numbers; None without gcc, for which the Makefile remains.
    """
    made = folder / "osl"
    made.mkdir()
    content = {
        "project": project,
        "experiment": project.setup.experiment,
        "prefix": PREFIX,
        "version": twin_gait.__version__,
        "tick": TICK,
        "longest_step": networked_limits(project.setup).controller_timeout,
        "phases": list(project.setup.table.phases),
        "causes": [str(cause) for cause in TripCause],
        "inputs": input_fields(project),
        "outputs": output_fields(project),
    }
    for name in _FILES.list_templates():
        text = _FILES.get_template(name).render(content)
        (made / name.removesuffix(".jinja")).write_text(text, encoding="utf-8")
    sources = made / "osl.c", folder / "exoskeleton.c"
    try:
        library = compile_library(sources, flags=["-DREAL_DOUBLE", f"-I{folder}"])
    except MissingToolError:
        return None
    return library.rename(made / f"{PREFIX}.so")
