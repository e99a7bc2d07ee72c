"""The knee of the bench leg with the new law: its friction is what the formula says."""

import numpy as np

from twin_gait import load_experiment, simulate

law = "law: churning, coulomb_friction_Nm: 3.2, transition_velocity_rad_per_s: 0.02, drag_Nm: 1.5"
settings = [
    f"plant.friction.knee={{{law}}}",
    "plant.friction_ratio={knee: 1}",
    "plant.actuators.knee.gear_efficiency=1",
    "duration_s=3",
]
log = simulate(load_experiment("bench_leg", settings).experiment).log

omega = log["right_knee_velocity_rad_per_s"].to_numpy()
expected = -(3.2 * np.tanh(omega / 0.02) + 1.5 * np.abs(omega) * omega)
assert np.abs(log["right_knee_friction_torque_Nm"] - expected).max() < 1e-6
assert np.abs(omega).max() > 1.0
