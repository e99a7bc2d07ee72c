"""The mode is there, the default wearer walks with it, and the springs have faded."""

from twin_gait import load_experiment, simulate

settings = ["control.mode=fading", "duration_s=12"]
run = simulate(load_experiment("treadmill_guided", settings).experiment)
assert run.verdict.outcome == "walked", run
first, last = (
    run.log["left_knee_stiffness_Nm_per_rad"].iloc[part].max() for part in (slice(1000), slice(-3000, None))
)
assert last < 0.85 * first
