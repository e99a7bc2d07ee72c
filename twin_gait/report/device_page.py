"""Page of a device: joints and drives, torque over speed, limits, masses, and the sources of its numbers."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from twin_gait.configuration.device_file import Device, is_number
from twin_gait.core.actuator import (
    Motor,
    current_to_torque,
    saturate,
    torque_to_current,
    voltage_limited_current,
)
from twin_gait.experiment.device import check_motion_limits
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.parameters.drives import ActuatorParameters, LimitParameters
from twin_gait.parameters.quantities import from_attributes
from twin_gait.vocabulary import PelvisGuide

SPEED_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # speeds of the torque curve over the no-load speed


def describe_device(device: Device) -> dict[str, Any]:
    """Return the properties of a device for its page and its JSON document.

    ``mass_kg`` is that of links and parts on the wearer's segments. ``joints`` has a row for each joint with
    its name in the URDF and its range; ``drives`` a row for each drive, with the limits of its joint, the
    ceiling of the torque limit, and the available torque in [N·m] at :data:`SPEED_SHARES` of the no-load
    speed; ``numbers`` a row for each number or list of numbers with its value in SI, the device that
    states it, and its source. Raises ModelError if the URDF cannot be used, and ParameterError if a limit
    exceeds that of the URDF.
    """
    parameters, document = device.parameters(), device.document()
    plant, control, leg = parameters["plant"], parameters["control"], parameters["leg"]
    model = LegModel(leg.urdf, leg.legs, pelvis=PelvisGuide.FIXED, fit_device=False, up_axis=leg.up_axis)
    driven_sides = leg.driven_sides or tuple(leg.legs)
    check_motion_limits(control, model, plant, driven_sides)
    joints = []
    for side, names in leg.legs.items():
        for joint, name in names.items():
            driven = joint in plant.actuators and side in driven_sides
            lower, upper = (
                control.joint_range(model, side, joint) if driven else model.position_limits(side, joint)
            )
            effort = model.effort_limit(side, joint)
            row = {
                "side": str(side),
                "joint": str(joint),
                "urdf_joint": name,
                "driven": driven,
            }
            joints.append({**row, "lower_rad": lower, "upper_rad": upper, "urdf_effort_Nm": effort})
    voltage, limits = plant.battery.voltage, control.limits
    for joint in {*document["control"]["limits"]} - {*plant.actuators}:
        del document["control"]["limits"][joint]  # a limit for all joints acts on those with a drive
    speeds = {
        joint: control.highest_speed(model, side, joint)
        for side, names in leg.legs.items()
        for joint, _ in names.items()
    }
    return {
        "name": device.name,
        "description": device.description,
        "path": str(device.path),
        "mass_kg": model.total_mass + sum(part.mass for part in leg.attachment.masses.values()),
        "joints": joints,
        "drives": [
            {
                "joint": str(joint),
                "gear_ratio": drive.gear_ratio,
                "armature_kgm2": drive.armature,
                "continuous_torque_Nm": drive.continuous_torque,
                "no_load_speed_rad_per_s": no_load_speed(drive, voltage),
                "torque_limit_Nm": limits[joint].torque,
                "torque_ceiling_Nm": drive.torque_ceiling(voltage),
                "current_limit_A": limits[joint].current,
                "speed_limit_rad_per_s": speeds[joint] if math.isfinite(speeds[joint]) else None,
                "torque_Nm": torque_curve(drive, voltage, limits[joint]),
            }
            for joint, drive in plant.actuators.items()
        ],
        "battery": document["plant"]["battery"],
        "numbers": list(_numbers(device, document)),
    }


def no_load_speed(drive: ActuatorParameters, voltage: float) -> float:
    r"""Compute the joint speed in [rad/s] at which the back-EMF is the voltage in [V].

    :math:`\omega_0 = U / (K_t\,\tau)`
    """
    return voltage / (drive.torque_constant * drive.gear_ratio)


def torque_curve(drive: ActuatorParameters, voltage: float, limits: LimitParameters) -> list[float]:
    """Compute the available torque of a drive at :data:`SPEED_SHARES` of its no-load speed.

    It is the torque limit, limited by current and voltage as in the simulation; without friction, losses of
    the gear, and the resistances of battery and inverter. ``voltage`` in [V]. Returns torques at the joint in
    [N·m].
    """
    motor, fastest = from_attributes(Motor, drive), no_load_speed(drive, voltage)
    wanted = torque_to_current(limits.torque, motor.torque_constant, motor.gear_ratio)
    currents = (
        voltage_limited_current(motor, saturate(wanted, limits.current), share * fastest, voltage)
        for share in SPEED_SHARES
    )
    return [
        max(0.0, current_to_torque(current, motor.torque_constant, motor.gear_ratio)) for current in currents
    ]


def _numbers(device: Device, document: Mapping[str, Any], below: str = "") -> Iterator[dict[str, Any]]:
    """Yield a row for each number of a device."""
    for key, value in document.items():
        path = f"{below}.{key}".removeprefix(".")
        if isinstance(value, Mapping):
            yield from _numbers(device, value, path)
        elif is_number(value) or (isinstance(value, list) and value and all(map(is_number, value))):
            row = {"key": path, "value": value}
            yield {**row, "stated_by": device.stated_by(path), "source": device.source_of(path)}
