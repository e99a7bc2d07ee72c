"""Messages on the CAN bus of a device: from its DBC file, or generated for its boards and limits."""

from collections.abc import Sequence
from functools import cache

from twin_gait.experiment.device import ControlParameters, PlantParameters
from twin_gait.experiment.experiment import Experiment
from twin_gait.leg_model.leg_model import LegModel
from twin_gait.network.dbc import Message, load_messages, parse_messages
from twin_gait.network.layout import Ranges, design_messages, write_dbc
from twin_gait.network.messages import MessageDesign
from twin_gait.parameters.drives import LARGEST_OFFSET
from twin_gait.parameters.network import NetworkParameters
from twin_gait.parameters.quantities import require
from twin_gait.vocabulary import JointName, PelvisGuide, Side
from twin_gait.worlds.world import LegSource

SPEED_MARGIN = 2.0  # range of the velocity over the speed limit of a joint (an assumption)
VOLTAGE_MARGIN = (
    1.5  # range of the voltage over that of the battery, because motors charge it (an assumption)
)


def device_boards(leg: LegSource, plant: PlantParameters) -> list[tuple[Side, JointName]]:
    """Return the joints of a device that have a drive, and therefore a board, leg by leg."""
    return [
        (side, joint)
        for side in leg.driven_sides or leg.legs
        for joint, _ in leg.legs[side].items()
        if joint in plant.actuators
    ]


def signal_ranges(leg: LegSource, plant: PlantParameters, control: ControlParameters) -> Ranges:
    r"""Return the ranges that the signals of a device must cover, in the units of the signals.

    For each board, with the limits of its joint: the torque limit; the current at which the monitor trips;
    the angles of the URDF and 10° on both sides for a badly calibrated encoder, also for the equilibrium
    angle; twice the velocity limit of the URDF, or twice the no-load speed :math:`U / (K_t\,\tau)` if the
    file states none; and the damping of the safe hold. For the battery: 1.5 times its voltage, and the power
    at which all drives draw their current limits.

    Args:
        leg: URDF and joints of the device.
        plant: Drives and battery.
        control: Limits and monitor.

    Returns:
        Lowest and highest number of each signal, by board and signal.

    Raises:
        ParameterError: If no joint of the device has a drive.
        ModelError: If the URDF cannot be used.
    """
    model = LegModel(leg.urdf, leg.legs, pelvis=PelvisGuide.FIXED, fit_device=False, up_axis=leg.up_axis)
    boards, voltage = device_boards(leg, plant), plant.battery.voltage
    require(
        bool(boards), "plant.actuators", "a drive for a joint of the legs, whose board is on the bus", "none"
    )
    found: dict[str, dict[str, tuple[float, float]]] = {}
    power = 0.0
    for side, joint in boards:
        limits, drive = control.limits[joint], plant.actuators[joint]
        lower, upper = model.position_limits(side, joint)
        angles = lower - LARGEST_OFFSET, upper + LARGEST_OFFSET
        speed = min(model.velocity_limit(side, joint), voltage / (drive.torque_constant * drive.gear_ratio))
        found[f"{side}_{joint}"] = {
            "torque": _both_ways(limits.torque),
            "current": _both_ways(control.safety.current_share * limits.current),
            "angle": angles,
            "equilibrium": angles,
            "velocity": _both_ways(SPEED_MARGIN * speed),
            "damping": (0.0, control.safety.hold_damping),
        }
        power += voltage * limits.current
    return {**found, "battery": {"voltage": (0.0, VOLTAGE_MARGIN * voltage), "power": _both_ways(power)}}


def _both_ways(most: float) -> tuple[float, float]:
    return -most, most


def device_messages(
    leg: LegSource, plant: PlantParameters, control: ControlParameters, phases: Sequence[str] = ()
) -> dict[str, MessageDesign]:
    """Return the generated messages of a device by name; raise the errors of :func:`signal_ranges`.

    ``phases``: phases of the gait table, which get codes in ``gait_state``.
    """
    return design_messages(signal_ranges(leg, plant, control), phases)


def bus_messages(experiment: Experiment) -> dict[str, Message]:
    """Return the messages on the bus of an experiment by name.

    They are those of the DBC file of its network. Without a file, or without a network, they are generated
    for boards and limits of the device and phases of the gait table. Raises ParameterFileError if the file
    lacks a message or cannot be used, MissingOptionalDependency if cantools is not installed.
    """
    leg, plant = experiment.leg, experiment.plant
    network = experiment.network or NetworkParameters()
    if network.dbc:
        return load_messages(network.dbc, [f"{side}_{joint}" for side, joint in device_boards(leg, plant)])
    messages = device_messages(leg, plant, experiment.control, experiment.table.phase_names)
    return _parsed(write_dbc(experiment.device.name, messages))


@cache
def _parsed(text: str) -> dict[str, Message]:
    """Parse a generated file once; the messages must not be changed."""
    return parse_messages(text, "generated DBC file")
