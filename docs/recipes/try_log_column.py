"""The column is there, with its unit, and says what it should."""

import numpy as np

from twin_gait import load_experiment, simulate

log = simulate(load_experiment("bench_leg", ["duration_s=1"]).experiment).log
expected = log["right_knee_motor_torque_Nm"] * log["right_knee_velocity_rad_per_s"]
assert np.array_equal(log["right_knee_motor_power_W"], expected)
