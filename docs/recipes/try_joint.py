"""The ankle is driven, and follows its phases."""

from twin_gait import load_experiment, simulate

run = simulate(load_experiment("bench_leg_ankle", ["duration_s=6"]).experiment)
ankle = run.log.groupby("right_phase", observed=True)["right_ankle_angle_rad"].mean()
assert ankle["swing_extension"] > ankle["late_stance"]
assert "right_ankle_motor_torque_Nm" in run.log
