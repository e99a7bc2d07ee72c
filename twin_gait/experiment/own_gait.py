"""Parameters of the wearer's own gait, which moves the joints that no drive moves."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from twin_gait.exceptions import ParameterError
from twin_gait.gait.table import TICK, GaitTable
from twin_gait.parameters import quantities
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName

LONGEST_DELAY = 0.5  # [s]
DELAYS = quantities.Range(0.0, LONGEST_DELAY, words=f"0 to {LONGEST_DELAY:g} s")
NOISES = quantities.Range(0.0, 0.2, reason="11 deg, more than a joint moves in a phase")
# Largest torques of the muscles of a man of 70 kg in [N·m], rounded: 2.2 N·m/kg of the hip, 2.8 N·m/kg of the
# extended knee, 1.9 N·m/kg of the ankle (isometric and slow isokinetic tests of adults, recalled).
PEAK_TORQUES = {JointName.HIP: 150.0, JointName.KNEE: 200.0, JointName.ANKLE: 130.0}


@dataclass(frozen=True, kw_only=True)
class OwnGait(quantities.Parameters):
    """A wearer's own gait: a gait table that moves the joints without a drive.

    Its impedances act as muscles do, without delay and in every stage of the integration; its guards read the
    true angles, velocities and loads of the wearer, late and with noise.

    Attributes:
        table: Gait table of the wearer, before scaling; its stiffness and damping are those of the body.
        delay: Delay of angles, velocities and loads in the guards in [s], rounded to whole ticks.
        angle_noise: Standard deviation of the angles in the guards, from tick to tick, in [rad].
        peak_torque: Largest torque of the muscles at each joint in [N·m]; the strength of a joint's condition
            multiplies it.
    """

    table: Annotated[GaitTable, quantities.CustomSerialized()]
    delay: Annotated[quantities.Time, DELAYS] = 0.02
    angle_noise: Annotated[quantities.Angle, NOISES] = 0.0
    peak_torque: Annotated[Mapping[JointName, quantities.Torque], quantities.NOT_NEGATIVE] = field(
        default_factory=PEAK_TORQUES.copy
    )

    def __post_init__(self) -> None:
        """Check the ranges, and that the table has parameters that muscles can have."""
        super().__post_init__()
        name, phases = self.table.name, [self.table.phases, *self.table.side_phases.values()]
        for phase_name, phase in (item for mapping in phases for item in mapping.items()):
            key = f"own_gait.table.phases.{phase_name}"
            if phase.gravity_compensation != 0.0:
                self._refuse(f"{key}.gravity_compensation", "0", phase.gravity_compensation, name)
            for joint, impedance in phase.joints.items():
                if impedance.friction_compensation_gain != 0.0:
                    gain = impedance.friction_compensation_gain
                    self._refuse(f"{key}.{joint}.friction_compensation_gain", "0", gain, name)
                if impedance.damping is None:
                    expected = "damping_Nms_per_rad, because a damping ratio depends on the drive"
                    self._refuse(f"{key}.{joint}", expected, "damping_ratio", name)
        for joint in self.joints:
            known = f"a torque of the {joint}"
            require(joint in self.peak_torque, "own_gait.peak_torque", known, dict(self.peak_torque))

    @staticmethod
    def _refuse(key: str, expected: str, value: Any, table: str) -> None:
        raise ParameterError(f"{key}: expected {expected}, got {value} (gait table {table!r})")

    @property
    def joints(self) -> tuple[JointName, ...]:
        """Joints of the table, from proximal to distal."""
        return tuple(JointName(name) for name in self.table.joints)

    @property
    def delay_ticks(self) -> int:
        """Delay in ticks."""
        return round(self.delay / TICK)
