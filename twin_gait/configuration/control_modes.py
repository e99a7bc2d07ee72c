"""How the controller drives the legs, as YAML: the share of help, and the path of position tracking."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin_gait.configuration.validation import DEGREE, Number, Strict, one_of
from twin_gait.exceptions import ParameterError
from twin_gait.experiment import AssistanceParameters, PathParameters
from twin_gait.vocabulary import JointName


class AssistanceEntry(Strict):
    """How much of the impedance the legs are given."""

    hip: Number = 1.0
    knee: Number = 1.0
    adaptive: bool = AssistanceParameters.adaptive
    forgetting: Number = AssistanceParameters.forgetting
    gain_per_rad: Number = AssistanceParameters.gain
    allowance_deg: Number | None = None
    allowance_rad: Number | None = None
    least: Number = AssistanceParameters.least

    def convert(self) -> AssistanceParameters:
        """Convert to SI."""
        return AssistanceParameters(
            share={JointName.HIP: self.hip, JointName.KNEE: self.knee},
            adaptive=self.adaptive,
            forgetting=self.forgetting,
            gain=self.gain_per_rad,
            allowance=one_of(
                self, {"allowance_deg": DEGREE, "allowance_rad": 1.0}, AssistanceParameters.allowance
            ),
            least=self.least,
        )


class JointStiffness(Strict):
    """A stiffness for the hip and one for the knee."""

    hip: Number
    knee: Number

    def convert(self, factor: float) -> dict[JointName, float]:
        """Convert to SI.

        Args:
            factor: One unit of the file in [N m] / [rad].
        """
        return {JointName.HIP: factor * self.hip, JointName.KNEE: factor * self.knee}


class PathEntry(Strict):
    """Spring and damper that follow the predetermined path."""

    stiffness_Nm_per_deg: JointStiffness | None = None
    stiffness_Nm_per_rad: JointStiffness | None = None
    damping_ratio: Number = PathParameters.damping_ratio
    friction_compensation_gain: Number = PathParameters.friction_compensation_gain
    gravity_compensation: Number = PathParameters.gravity_compensation

    def convert(self) -> PathParameters:
        """Convert to SI."""
        return PathParameters(
            stiffness=self._stiffness(),
            damping_ratio=self.damping_ratio,
            friction_compensation_gain=self.friction_compensation_gain,
            gravity_compensation=self.gravity_compensation,
        )

    def _stiffness(self) -> Mapping[JointName, float]:
        if self.stiffness_Nm_per_deg is not None and self.stiffness_Nm_per_rad is not None:
            raise ParameterError(
                "path: expected stiffness_Nm_per_deg or stiffness_Nm_per_rad, got both; leave one out"
            )
        if self.stiffness_Nm_per_deg is not None:
            return self.stiffness_Nm_per_deg.convert(1.0 / DEGREE)
        if self.stiffness_Nm_per_rad is not None:
            return self.stiffness_Nm_per_rad.convert(1.0)
        return PathParameters().stiffness


def assistance_document(assistance: AssistanceParameters) -> dict[str, Any]:
    """The help as the mapping of a file, in SI."""
    return {
        **{str(joint): share for joint, share in assistance.share.items()},
        "adaptive": assistance.adaptive,
        "forgetting": assistance.forgetting,
        "gain_per_rad": assistance.gain,
        "allowance_rad": assistance.allowance,
        "least": assistance.least,
    }


def path_document(path: PathParameters) -> dict[str, Any]:
    """The spring that follows the path as the mapping of a file, in SI."""
    return {
        "stiffness_Nm_per_rad": {str(joint): value for joint, value in path.stiffness.items()},
        "damping_ratio": path.damping_ratio,
        "friction_compensation_gain": path.friction_compensation_gain,
        "gravity_compensation": path.gravity_compensation,
    }
