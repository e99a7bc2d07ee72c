"""Loss of the supply: the descent of a wearer with shorted windings, which brake, and with open ones.

Three cases: a trunk that is held upright, so that only the legs decide; standing on the floor with two
crutches; and walking there, with a loss at times spread evenly over a stride. The runs continue to the ground
instead of the height of a fall. Two minutes; page: docs/reference/faults.md.
"""

# %% [markdown]
# The inductive time p τ L / R of shorted windings is 0.88 s: 12 pole pairs, 0.264 mH and 0.363 Ω with the
# inverter (maxon EC 90 flat, data sheet), and a gear of 100. The hip's winding has nearly the same L / R.

# %%
import numpy as np
import pandas as pd
from gallery import read_options
from injected_faults.descents import TRUNK_HELD
from injected_faults.figure import draw_descents

from twin_gait import Run, load_experiment, simulate
from twin_gait.report.canvas import save

FALL, GROUND = 0.75, 0.1  # shares of the height of the pelvis at the start
INDUCTIVE_TIME = 0.88  # [s]
WINDINGS = {
    "shorted": "supply_loss_shorted@{}s",
    "shorted, with inductance": f"supply_loss_shorted@{{}}s={INDUCTIVE_TIME}s",
    "open": "supply_loss_open@{}s",
}
# Preset, settings and times of the loss in [s]. Each run lasts 12 s from the loss on.
CASES = {
    "trunk held": (
        "treadmill_start_stop",
        TRUNK_HELD,
        (2.0,),
    ),
    "standing": ("overground", ("modes=walking", "scenario.fall_lean_deg=180"), (3.0,)),
    "walking": (
        "overground",
        ("scenario.fall_lean_deg=180",),
        tuple(np.round(5.0 + 0.18 * np.arange(12), 2)),
    ),
}
AFTER = 12.0  # [s]
# Torque constant in [N·m/A] times the gear ratio, and resistance of winding and inverter in [Ω], by joint.
DATA_SHEET = {"hip": (10.9, 0.84), "knee": (7.05, 0.363)}


# %%
def lose_supply(case: str, windings: str, time: float) -> Run:
    """Simulate a case with a loss of the supply at a time in [s]."""
    preset, settings, _ = CASES[case]
    fault = WINDINGS[windings].format(time)
    more = (f"faults=['{fault}']", f"scenario.fall_height_share={GROUND}", f"duration_s={time + AFTER}")
    return simulate(load_experiment(preset, [*settings, *more]).experiment)


def measure_descent(run: Run, time: float) -> dict:
    """Return the time to the height of a fall, and the highest speeds of sinking and torque of a motor."""
    log = run.log[run.log["time_s"] >= time]
    heights, speeds = log["pelvis_height_m"].to_numpy(), -log["pelvis_velocity_m_per_s"].to_numpy()
    fallen = np.flatnonzero(heights < FALL * run.log["pelvis_height_m"].iloc[0])
    end = fallen[0] if len(fallen) else len(log)
    return {
        "fallen_s": float(end) * 1e-3 if len(fallen) else np.nan,
        "first_second_m_per_s": float(speeds[:1000].max()),
        "until_fall_m_per_s": float(speeds[:end].max()),
        "to_end_m_per_s": float(speeds.max()),
        "torque_Nm": float(np.abs(log.filter(regex="motor_torque_Nm$").to_numpy()).max()),
    }


def summarise_case(case: str, windings: str, descents: list[dict]) -> dict:
    """Return a row of the table: the largest values over the times of the loss."""
    table = pd.DataFrame(descents)
    fallen = table["fallen_s"].dropna()
    return {
        "case": case,
        "windings": windings,
        "runs": len(table),
        f"below {FALL:.0%} of the height": len(fallen),
        "after [s]": f"{fallen.min():.1f} to {fallen.max():.1f}"
        if len(fallen) > 1
        else f"{fallen.min():.1f}",
        "sinking in the first second [m/s]": f"{table['first_second_m_per_s'].max():.2f}",
        "until there [m/s]": f"{table['until_fall_m_per_s'].max():.2f}",
        "to the end [m/s]": f"{table['to_end_m_per_s'].max():.2f}",
        "torque of a motor [N·m]": f"{table['torque_Nm'].max():.0f}",
    }


# %% [markdown]
# Independent check: the braking power is (K_t τ ω)² / R of each motor, from the constants of the data sheet
# and the velocities in the log. Its integral must be the work that the motors took from the bodies.


# %%
def balance_energy(run: Run, time: float) -> dict:
    """Return the energies in [J] of a descent with shorted windings; two of them must agree."""
    log = run.log[run.log["time_s"] >= time]
    change = {
        name: float(log[name].iloc[-1] - log[name].iloc[0])
        for name in log
        if name.endswith(("_work_J", "_energy_J"))
    }
    heat = 0.0
    for side in ("left", "right"):
        for joint, (constant, resistance) in DATA_SHEET.items():
            speed = log[f"{side}_{joint}_velocity_rad_per_s"].to_numpy()
            heat += float(np.trapezoid((constant * speed) ** 2 / resistance, dx=1e-3))
    released = -change["potential_energy_J"] - change["kinetic_energy_J"]
    return {
        "released_J": released,
        "braking_J": -change["motor_work_J"],
        "braking_by_data_sheet_J": heat,
        "friction_J": -change["friction_work_J"],
        "others_J": -sum(change[f"{name}_work_J"] for name in ("stop", "spring", "contact", "external")),
    }


# %%
if __name__ == "__main__":
    form = read_options("supply_loss")
    rows, drawn = [], {}
    for case, (_, _, times) in CASES.items():
        if form.quick and case != "trunk held":
            continue
        for windings in WINDINGS:
            runs = {time: lose_supply(case, windings, time) for time in times}
            rows.append(
                summarise_case(case, windings, [measure_descent(run, time) for time, run in runs.items()])
            )
            print(*rows[-1].values(), sep=" | ", flush=True)
            if case != "walking":
                drawn[case, windings] = (times[0], runs[times[0]].log)
    save(draw_descents(drawn), form.out / "descent.png")
    start = CASES["trunk held"][2][0]
    energy = balance_energy(lose_supply("trunk held", "shorted", start), start)
    braked, opened = (
        measure_descent(lose_supply("trunk held", name, start), start) for name in ("shorted", "open")
    )
    speeds = {"braked_m_per_s": braked["to_end_m_per_s"], "open_m_per_s": opened["to_end_m_per_s"]}
    form.write_results(
        {"descents": rows, "speeds": speeds, "inductive_time_s": INDUCTIVE_TIME, "energy": energy}
    )
