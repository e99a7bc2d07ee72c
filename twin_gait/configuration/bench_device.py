"""Joint bench of a device: motor, gear, friction, battery, encoder and limits of a joint from its file."""

from dataclasses import replace

from twin_gait.configuration.device_file import load_device
from twin_gait.exceptions import ParameterError
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName
from twin_gait.worlds.bench_joint import BenchFriction, BenchJoint, DriveParameters

# TWIN without losses of the gears under load, because the friction measured on the bench contains them.
BENCH_DEVICE = "twin_leg"
_PARAMETERS = load_device(BENCH_DEVICE).parameters()
BENCH_ACTUATORS = dict(_PARAMETERS["plant"].actuators)  # drives of its joints
BENCH_FRICTION = dict(_PARAMETERS["plant"].friction)  # friction of its joints, table 3.1 of the thesis
BENCH_SENSORS = replace(_PARAMETERS["sensors"], ideal=False)  # encoder and velocity estimates


def bench_joint(joint: JointName, device: str = BENCH_DEVICE, **changes: object) -> BenchJoint:
    """Return the bench with the motor and friction of a joint of a device.

    Args:
        joint: Joint with a drive.
        device: Name of a shipped device, or path of a file.
        changes: Attributes of :class:`BenchJoint` that differ. Without ``control`` the winding is open.

    Returns:
        The bench, with encoders that are not ideal.

    Raises:
        ParameterError: If the joint has no drive, if its inductance is not known, or if a value is out of its
            range.
    """
    found = load_device(device).parameters()
    plant, sensors = found["plant"], found["sensors"]
    known = f"one of {', '.join(plant.actuators)}, the joints with a drive in device {device}"
    require(joint in plant.actuators, "joint", known, str(joint))
    actuator = plant.actuators[joint]
    if "drive" not in changes:
        if actuator.inductance is None:
            key = f"device {device}: plant.actuators.{joint}.inductance_H"
            raise ParameterError(f"{key}: is missing, but the bench simulates the current loop; state it")
        changes["drive"] = DriveParameters(inductance=actuator.inductance)
    usual = {
        "actuator": actuator,
        "friction": BenchFriction(law=plant.friction[joint]),
        "control": None,
        "battery": plant.battery,
        "sensors": replace(sensors, ideal=False, offset={}),
        "limits": found["control"].limits[joint],
    }
    return BenchJoint(**(usual | changes))
