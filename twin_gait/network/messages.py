"""Messages between the nodes of the device and their signals, which a DBC file lays out.

The topology is the star of the thesis (2.1.2): central control unit, a board at each of the four motors,
battery and inertial unit, and the monitor (2.4) of the operator. The thesis prints neither bit rate nor
layout.
"""

from collections.abc import Mapping

from twin_gait.parameters.network import BOARDS

COUNTS = 4  # Number of values of the counter of a frame, which has two bits.

# Signals with their units, in the order in which the codec receives the numbers.
MEASUREMENT = {
    "angle": "rad",
    "velocity": "rad/s",  # The fast estimate.
    "current": "A",
    "foot_load": "bw",  # Sole load as a fraction of body weight; 0 from the board of a hip.
    "trip_cause": "",
    "counter": "",
}
_IMPEDANCE = {"stiffness": "Nm/rad", "damping": "Nms/rad", "equilibrium": "rad", "gain": "", "torque": "Nm"}
SETPOINT = _IMPEDANCE | {"state": "", "counter": ""}
COMMAND = _IMPEDANCE | {"control": "", "counter": ""}
BATTERY = {"voltage": "V", "power": "W"}
IMU = {"pitch": "rad", "pitch_rate": "rad/s"}
GAIT_STATE = {"left_phase": "", "right_phase": "", "safety_state": "", "trip_cause": "", "time": "s"}

MESSAGES: Mapping[str, Mapping[str, str]] = {
    **{f"{board}_setpoint": SETPOINT for board in BOARDS},
    **{f"{board}_measurement": MEASUREMENT for board in BOARDS},
    "battery": BATTERY,
    "imu": IMU,
    "gait_state": GAIT_STATE,
    **{f"{board}_command": COMMAND for board in BOARDS},
}
ON_DEMAND = "_command"  # Suffix of the names of messages that have no cycle.
# Codes that programs on both ends of the bus share.
CODES: Mapping[str, tuple[str, ...]] = {
    "state": ("off", "hold", "run"),
    "control": ("walk", "friction_control", "torque_control", "impedance_control"),
}
