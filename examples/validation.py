"""Is this installation correct, and how much does it differ from MuJoCo and closed-form solutions?

The script compares rigid bodies, integrators, engines and a complete run with MuJoCo, a double pendulum in
closed form and conservation of energy, and prints every figure with its limit; then it measures the error of
several integration steps. It takes a minute, and exits with 1 if a check fails.
"""

# %%
import importlib.util

import numpy as np
import pandas as pd
from crosscheck import checks
from gallery import read_options

from twin_gait import load_experiment, simulate

form = read_options("validation")
mujoco = importlib.util.find_spec("mujoco") is not None
rows = []


def check(name: str, reference: str, figure: float, limit: float, unit: str = "") -> None:
    figure += 0.0  # removes the minus of a zero
    passed = figure <= limit  # False for NaN
    found, bound = f"{figure:.1e} {unit}".strip(), f"{limit:g} {unit}".strip()
    answer = "yes" if passed else "**no**"
    rows.append(
        {"check": name, "compared with": reference, "figure": found, "limit": bound, "passed": answer}
    )
    print(f"{name:35} {reference:29} {found:12} {bound:10} {'passed' if passed else 'FAILED'}")


# %% [markdown]
# Rigid bodies at 100 random states. Rounding of 2e-16 is magnified by the condition of the mass matrix, 7e3
# for the worn device (a pelvis of 60 kg and a foot of 0.01 kg·m²); the rest is a margin for other processors.

# %%
ROUNDING = 1e-10
if mujoco:
    for preset, described in (("bench_leg", "bench leg"), ("treadmill_guided", "worn device")):
        for quantity, error in checks.dynamics_errors(load_experiment(preset).experiment).items():
            check(f"{quantity} of the {described}", "MuJoCo", error, ROUNDING)
check("accelerations of the bench leg", "Lagrange's equations by hand", checks.pendulum_error(), ROUNDING)

# %% [markdown]
# Integrators: one second of a falling leg without friction and motors, with steps of 1, 0.5 and 0.25 ms. The
# next term of the error is smaller by the ratio of the step to the time scale of the motion.

# %%
run, error = checks.free_leg("rk4", 0.25)
check("free motion, RK4 at 0.25 ms", "scipy DOP853, by hand", error, 1e-10, "rad")
check("its energy", "conservation of energy", checks.energy_drift(run), 1e-10)
for method, order, limit in (("semi_implicit_euler", 1, 0.01), ("rk4", 4, 0.05)):
    difference = abs(checks.integrator_order(method) - order)
    check(f"order {order} of {method}", "scipy DOP853, by hand", difference, limit)

# %% [markdown]
# The same laws with another order of additions: a switch of phase one tick later would change an angle by
# 1e-4 rad or more.

# %%
SAME_MOTION = 1e-9
check("bench leg, 5 s", "Pinocchio engine", checks.engine_difference("bench_leg", 5.0), SAME_MOTION, "rad")
check(
    "treadmill_guided, 2 s",
    "Pinocchio engine",
    checks.engine_difference("treadmill_guided", 2.0),
    SAME_MOTION,
    "rad",
)
stepping = "integration={method: semi_implicit_euler, step_ms: 1}"
run = simulate(load_experiment("bench_leg", ["duration_s=5", stepping]).experiment)
if mujoco:
    error = checks.replay_difference(run)
    check("bench leg, 5 s, torques of the log", "MuJoCo as the plant", error, SAME_MOTION, "rad")
    run = simulate(load_experiment("bench_leg", ["duration_s=5", stepping, *checks.LOSSY]).experiment)
    error = checks.replay_difference(run)
    check("the same with losses of the gears", "MuJoCo as the plant", error, SAME_MOTION, "rad")

# %% [markdown]
# Energy and passivity on the treadmill. The error of Runge-Kutta is (λh)⁴/120, where λ, the slope of friction
# near rest over the inertia of a drive, is the fastest rate: 5e-9 at 1 ms, less at the 0.25 ms of the preset.

# %%
walk = simulate(load_experiment("treadmill_guided", ["duration_s=5"]).experiment)
check("energy of 5 s of treadmill_guided", "conservation of energy", checks.energy_residual(walk), 1e-8)
check("power that friction gives", "passivity", checks.largest_friction_power(walk), 0.0, "W")
pull = -float(walk.log.filter(like="foot_normal_force_N").min().min())
check("pull of the ground at a foot", "unilateral contact", pull, 0.0, "N")

# %% [markdown]
# Steps: the largest error of an angle over 10 s, against a tenth of the default step of each preset.

# %%
WALKS = ("treadmill_guided", "treadmill_40", "treadmill_start_stop", "treadmill_ankle")
PRESETS = (
    ("treadmill_guided",)
    if form.quick
    else (*WALKS, "overground", "sit_to_stand", "stand_to_sit", "bench_leg")
)
steps = [row for preset in PRESETS for row in checks.step_rows(preset, 1.0 if form.quick else 10.0)]
print(*(" ".join(f"{cell:24}" for cell in row.values()) for row in steps), sep="\n")

# %% [markdown]
# Stability: near rest the friction of a loaded foot is a damper, and Runge-Kutta is stable for steps below
# 2.785 times its time constant. Random wearers at 0.25 ms show that the energy balance finds the unstable
# walks; at the default step, which the program chooses by the same limit, none is unstable.

# %%
COARSE = "integration={method: rk4, step_ms: 0.25}"
WEARERS = 4 if form.quick else 64
generator, coarse = np.random.default_rng(5), []
for _ in range(WEARERS):
    state = generator.bit_generator.state
    run = checks.random_walk(generator, COARSE)
    generator.bit_generator.state = state
    chosen = checks.random_walk(generator)
    rate = checks.foot_friction_rate(chosen)
    coarse.append(
        {
            "rate_per_s": rate,
            "default_step_s": chosen.experiment.resolved_integration.step,
            "coarse_residual": checks.energy_residual(run),
            "default_residual": checks.energy_residual(chosen),
            "difference_deg": checks.largest_difference(run, chosen),
        }
    )
walks = pd.DataFrame(coarse)
unstable = walks["coarse_residual"] > checks.RESIDUAL_LIMIT
beyond = 0.25e-3 * walks["rate_per_s"] > checks.STEP_LIMIT
stability = {
    "wearers": WEARERS,
    "unstable": int(unstable.sum()),
    "both": int((unstable & beyond).sum()),
    "beyond_the_limit": int(beyond.sum()),
    "largest_stable_residual": f"{walks.loc[~unstable, 'coarse_residual'].max():.0e}",
    "smallest_unstable_residual": f"{walks.loc[unstable, 'coarse_residual'].min():.0e}",
    "largest_stable_difference": f"{walks.loc[~unstable, 'difference_deg'].max():.0e}",
    "largest_unstable_difference": f"{walks.loc[unstable, 'difference_deg'].max():.1f}",
    "largest_residual_at_default": f"{walks['default_residual'].max():.0e}",
    "largest_step_times_rate": f"{(walks['rate_per_s'] * walks['default_step_s']).max():.2f}",
}
check(
    "friction of the feet at the default step",
    "limit of Runge-Kutta",
    float(stability["largest_step_times_rate"]),
    checks.STEP_LIMIT,
)
check(
    "energy of these walks",
    "conservation of energy",
    walks["default_residual"].max(),
    checks.RESIDUAL_LIMIT,
)
print(", ".join(f"{name} {value}" for name, value in stability.items()))

# %%
if not mujoco:
    print("without MuJoCo, which pip install 'twin-gait[test]' brings: its checks are left out")
failed = sum(row["passed"] != "yes" for row in rows)
with_mujoco = sum(row["compared with"].startswith("MuJoCo") for row in rows)
form.write_results(
    {
        "checks": rows,
        "steps": steps,
        "stability": stability,
        "count": len(rows),
        "with_mujoco": with_mujoco,
        "failed": failed,
        "mujoco": mujoco,
    }
)
print(f"{len(rows) - failed} passed, {failed} failed")
if failed:
    raise SystemExit(1)
