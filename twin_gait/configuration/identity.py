"""Names of the parts of an experiment that distinguish two runs: wearer, table, device, controller.

The label of a part that differs from the shipped one of its name, or has no shipped one, also has the
beginning of the hash of its values, so that two versions of the part have different labels.
"""

from dataclasses import MISSING, dataclass, replace
from functools import cache
from typing import Any

from twin_gait.configuration.custom_sections import user_controller_document
from twin_gait.configuration.device_file import PARTS as DEVICE_PARTS
from twin_gait.configuration.device_file import device_sections, load_device
from twin_gait.configuration.documents import content_hash, table_document
from twin_gait.configuration.experiments import read_patient
from twin_gait.configuration.gait_table_file import load_gait_table
from twin_gait.configuration.sections import to_yaml
from twin_gait.configuration.validation import packaged
from twin_gait.experiment.device import ControlParameters
from twin_gait.experiment.experiment import Experiment
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.parameters.quantities import declarations
from twin_gait.parameters.wearer import Patient

_DIGITS = 6  # digits of the hash in a label
_LONGEST = 40  # characters of a name in a label


@dataclass(frozen=True)
class ExperimentPart:
    """Part of an experiment."""

    name: str  # name; empty for a wearer without a name who is defined by mass and height only
    changed: bool | None  # whether it differs from the shipped part of its name; None if there is none
    sha256: str  # hash of its values

    @property
    def label(self) -> str:
        """Name on one line, and the beginning of the hash unless the part ships."""
        name = "".join(sign if sign.isprintable() else "\N{REPLACEMENT CHARACTER}" for sign in self.name)
        name = name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…"
        changes = " with changes" if self.changed else ""
        return name if self.changed is False else f"{name}{changes} ({self.sha256[:_DIGITS]})"


def identify_parts(experiment: Experiment) -> dict[str, ExperimentPart]:
    """Return table, device and controller by their keys in ``summary.json``."""
    return {
        "table": _table(experiment),
        "device": _device(experiment),
        "controller": _controller(experiment),
    }


def identify_wearer(patient: Patient) -> ExperimentPart:
    """Return the part of a wearer; one without a name who is defined by mass and height counts as shipped."""
    digest = _hash(to_yaml(patient))
    if patient.name is None:
        is_mass_alone = replace(Patient(), mass=patient.mass, height=patient.height) == patient
        return (
            ExperimentPart("", False, digest) if is_mass_alone else ExperimentPart("own wearer", None, digest)
        )
    ships = patient.name in packaged("patients")
    return ExperimentPart(patient.name, _shipped_person(patient.name) != patient if ships else None, digest)


def _table(experiment: Experiment) -> ExperimentPart:
    name, digest = experiment.table.name, _hash(table_document(experiment.table))
    shipped = _shipped_table(name) if name in packaged("tables") else None
    return ExperimentPart(name, None if shipped is None else digest != shipped, digest)


def _device(experiment: Experiment) -> ExperimentPart:
    """Return the device by its name, and whether its numbers are those of the shipped device of that name."""
    name, digest = experiment.device.name, _hash(_comparable(device_sections(experiment)))
    shipped = _shipped_device(name) if name in packaged("devices") else None
    return ExperimentPart(name, None if shipped is None else digest != shipped, digest)


def _controller(experiment: Experiment) -> ExperimentPart:
    """Return the name of the controller, and whether its settings are the defaults."""
    controller, settings = experiment.controller, _control_hash(experiment.control)
    if controller is not None:
        return ExperimentPart(controller.name, None, _hash([user_controller_document(controller), settings]))
    usual = {item.name: item.default for item in declarations(ControlParameters)}
    usual = {name: value for name, value in usual.items() if value is not MISSING}
    shipped = settings == _control_hash(replace(experiment.control, **usual))
    name = str(experiment.control.mode)
    return ExperimentPart(name, not shipped, _hash([name, settings]))


def _hash(values: Any) -> str:
    return content_hash({"values": values})


def _comparable(sections: dict[str, Any]) -> dict[str, Any]:
    """Return the sections of a device without its sensors, with the hash of its URDF instead of the path."""
    leg = {**sections["leg"], "urdf": urdf_hash(find_urdf(sections["leg"]["urdf"]))}
    return {"leg": leg, "plant": sections["plant"], "control": sections["control"]}


def _control_hash(control: ControlParameters) -> str:
    """Return the hash of the controller's settings without its name and without the parts of the device."""
    others = ("mode", *DEVICE_PARTS["control"])
    return _hash({key: item for key, item in to_yaml(control).items() if key not in others})


@cache
def _shipped_device(name: str) -> str:
    return _hash(_comparable(load_device(name).document()))


@cache
def _shipped_person(name: str) -> Patient:
    return read_patient(packaged("patients")[name])


@cache
def _shipped_table(name: str) -> str:
    return _hash(table_document(load_gait_table(packaged("tables")[name])))
