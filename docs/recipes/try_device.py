"""The device is listed with the sources of its numbers, and a wearer walks with it on the right leg."""

from twin_gait import load_experiment, simulate
from twin_gait.configuration.device_file import list_devices, load_device
from twin_gait.report.device_page import describe_device

assert "right_knee" in list_devices(), "another twin_gait is imported: pip install -e ."
assert all(number["source"] for number in describe_device(load_device("right_knee"))["numbers"])
run = simulate(load_experiment("knee_orthosis", ["device=right_knee", "duration_s=10"]).experiment)
assert run.verdict.outcome == "walked"
assert "right_knee_motor_torque_Nm" in run.log and "left_knee_motor_torque_Nm" not in run.log
