"""Friction that sticks: a knee with LuGre's bristles compared with the static law of the thesis. Seconds.

The bench leg has idle motors. A hand moves the knee back and forth by less than the presliding range, a weak
spring drags it, and it is released where its weight is less than its friction. Coulomb and viscous friction
are those of table 3.1; break-away torque, Stribeck velocity and bristles of TWIN have not been measured: they
are assumptions. Page: docs/background/model.md.
"""

# %% [markdown]
# ## Two laws
# Bristles slide after a tenth of a degree, and the break-away torque is 1.4 times the Coulomb friction.

# %%
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gallery import read_options
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from twin_gait import Experiment, GaitPhase, JointName, Run, load_experiment, simulate
from twin_gait.configuration.bench_device import BENCH_FRICTION
from twin_gait.core.friction import friction_torque, steady_deflection
from twin_gait.palette import BLUE, GREY, ORANGE
from twin_gait.parameters.friction import FrictionLaw, FrictionParameters, LuGreFriction
from twin_gait.report.canvas import put_legend, save, style_panel

SLIDES_AFTER = math.radians(0.1)  # [rad], deflection of the bristles under Coulomb friction; an assumption
BREAKAWAY_RATIO, STRIBECK_VELOCITY = 1.4, 0.05  # assumptions
DAMPING = 0.03  # [s], σ1 / σ0; an assumption
TABLE = {joint: law.normalised() for joint, law in BENCH_FRICTION.items()}
STATIC, LUGRE = "static law (3.1)", "LuGre"
COLOURS = {STATIC: ORANGE, LUGRE: BLUE}
DEGREE = math.pi / 180.0


def bristles(law: FrictionParameters) -> LuGreFriction:
    """Return LuGre's law with the Coulomb and viscous friction of a static law."""
    stiffness = law.coulomb_friction / SLIDES_AFTER
    return LuGreFriction(
        coulomb_friction=law.coulomb_friction,
        breakaway_torque=BREAKAWAY_RATIO * law.coulomb_friction,
        stribeck_velocity=STRIBECK_VELOCITY,
        viscous_friction_forward=law.viscous_friction,
        viscous_friction_backward=law.viscous_friction,
        bristle_stiffness=stiffness,
        bristle_damping=DAMPING * stiffness,
    )


LAWS: dict[str, Mapping[JointName, FrictionLaw]] = {
    STATIC: TABLE,
    LUGRE: {joint: bristles(law) for joint, law in TABLE.items()},
}


def idle_leg(law: str, *settings: str) -> Experiment:
    """Return the bench leg with idle motors and the complete friction of a law."""
    gains = [
        f"table.phases.{phase}.{joint}.friction_compensation_gain=0" for phase in GaitPhase for joint in TABLE
    ]
    common = ("control.mode=transparent", "control.safety.enabled=false", "integration.step_ms=0.25")
    idle = [f"control.target_torque_Nm.{joint}=0" for joint in TABLE]
    phases = [f"table.phases.{phase}.gravity_compensation=0" for phase in GaitPhase]
    experiment = load_experiment("bench_leg", [*common, *idle, *gains, *phases, *settings]).experiment
    plant = replace(experiment.plant, friction=LAWS[law], friction_ratio=dict.fromkeys(TABLE, 1.0))
    return replace(experiment, plant=plant)


def knee(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time [s], knee angle from its start [°], and friction [N·m] with the sign of the velocity."""
    angle = run.log["right_knee_angle_rad"].to_numpy()
    friction = -run.log["right_knee_friction_torque_Nm"].to_numpy()
    return run.log["time_s"].to_numpy(), (angle - angle[0]) / DEGREE, friction


# %% [markdown]
# ## Back and forth, dragged, released
# The hand grips firmly and moves with a given amplitude; the spring is weak and its other end moves slowly.

# %%
HAND_AMPLITUDES = (0.1, 0.3, 1.0)  # [°], from end to end
HAND_FREQUENCY = 0.5  # [Hz]
SPRING, DRAG_AMPLITUDE, DRAG_FREQUENCY = 15.0, 90.0, 0.02  # [N·m/rad], [°], [Hz]


def led(law: str, amplitude: float, frequency: float, stiffness: float, damping: float, time: float) -> Run:
    """Simulate a run without gravity in which spring and damper guide the knee along a cosine path."""
    motion = (
        f"scenario.imposed_motion={{joint: knee, amplitude_deg: {amplitude}, frequency_Hz: {frequency}, "
        f"stiffness_Nm_per_rad: {stiffness}, damping_Nms_per_rad: {damping}}}"
    )
    start = "scenario.start={hip_deg: 20, knee_deg: 20}"
    return simulate(idle_leg(law, motion, start, "plant.gravity_m_per_s2=0", f"duration_s={time}"))


def swayed(law: str, amplitude: float) -> Run:
    """Simulate two periods of a hand's motion, with a grip that is much stiffer than the bristles."""
    return led(law, amplitude, HAND_FREQUENCY, 2e4, 200.0, 2.0 / HAND_FREQUENCY)


def dragged(law: str) -> Run:
    """Simulate half a period of the path of the weak spring."""
    return led(law, DRAG_AMPLITUDE, DRAG_FREQUENCY, SPRING, 0.0, 0.5 / DRAG_FREQUENCY)


def let_go(law: str, time: float) -> Run:
    """Simulate the release of the flexed leg under its own weight."""
    return simulate(idle_leg(law, "scenario.start={hip_deg: 5, knee_deg: 30}", f"duration_s={time}"))


def path_of(time: np.ndarray) -> np.ndarray:
    """Return the displacement of the other end of the weak spring in [°]."""
    return 0.5 * DRAG_AMPLITUDE * (1.0 - np.cos(2.0 * math.pi * DRAG_FREQUENCY * time))


# %% [markdown]
# ## Numbers


# %%
def loop_energy(run: Run) -> float:
    """Compute the energy that friction dissipates in the second period in [mJ]."""
    _, way, friction = knee(run)
    last = slice(len(way) // 2, None)
    angle, torque = way[last] * DEGREE, friction[last]
    return float(1e3 * np.sum(0.5 * (torque[1:] + torque[:-1]) * np.diff(angle)))


def numbers_of(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the numbers of the page."""
    found: dict[str, Any] = {
        "breakaway_ratio": BREAKAWAY_RATIO,
        "stribeck_velocity_rad_per_s": STRIBECK_VELOCITY,
        "slides_after_deg": SLIDES_AFTER / DEGREE,
        "breakaway_torque_Nm": BREAKAWAY_RATIO * TABLE[JointName.KNEE].coulomb_friction,
    }
    for name, key in ((STATIC, "static"), (LUGRE, "lugre")):
        run_by_name = runs[name]
        velocity = run_by_name["dragged"].log["right_knee_velocity_rad_per_s"].to_numpy()
        slips = velocity > 5.0 * DEGREE
        fell = knee(run_by_name["let_go"])[1]
        found[key] = {
            "loop_energies_mJ": [loop_energy(run) for run in run_by_name["swayed"]],
            "largest_friction_Nm": float(knee(run_by_name["dragged"])[2].max()),
            "slips": int(np.sum(slips[1:] & ~slips[:-1])),
            "let_go_s": float(run_by_name["let_go"].log["time_s"].iloc[-1]),
            "let_go_way_deg": float(np.abs(fell).max()),
            "let_go_way_in_the_second_half_deg": float(np.ptp(fell[len(fell) // 2 :])),
        }
    return found


# %% [markdown]
# ## Figure


# %%
def draw(runs: Mapping[str, Mapping[str, Any]]) -> Figure:
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    steady, loops, drag, hang = figure.subplots(2, 2).ravel()
    for name, run_by_name in runs.items():
        look = {"color": COLOURS[name], "linewidth": 1.4}
        draw_steady(steady, LAWS[name][JointName.KNEE], look)
        for run in run_by_name["swayed"]:
            _, way, friction = knee(run)
            loops.plot(way, friction, **look)
        time, way, _ = knee(run_by_name["dragged"])
        drag.plot(time, way, **look)
        time, way, _ = knee(run_by_name["let_go"])
        hang.plot(time, way, **look)
    drag.plot(
        time_of := knee(runs[LUGRE]["dragged"])[0],
        path_of(time_of),
        color=GREY,
        linestyle="--",
        linewidth=1.0,
    )
    style_panel(steady, "steady sliding", "friction [N·m]")
    steady.set(xlabel="velocity [rad/s]", ylim=(0.0, None))
    style_panel(loops, "a hand moves the knee to and fro: by 0.1, 0.3 and 1°", "friction [N·m]")
    loops.set(xlabel="way of the knee [°]")
    style_panel(drag, "a weak spring drags the knee along", "way of the knee [°]")
    drag.set(xlabel="time [s]")
    style_panel(hang, "let go where its weight is less than its friction", "way of the knee [°]")
    hang.set(xlabel="time [s]")
    handles = [Line2D([], [], color=COLOURS[name], linewidth=2, label=name) for name in runs]
    end = Line2D([], [], color=GREY, linestyle="--", linewidth=1.0, label="other end of the spring")
    put_legend(figure, [*handles, end])
    return figure


def draw_steady(axes: Axes, law: FrictionLaw, look: Mapping[str, Any]) -> None:
    """Draw friction over a steady velocity."""
    friction = law.to_plant_friction()
    speeds = np.geomspace(1e-4, 0.6, 600).tolist()
    torques = [friction_torque(friction, w, steady_deflection(friction, w)) for w in speeds]
    axes.plot(speeds, torques, **look)


# %%
if __name__ == "__main__":
    form = read_options("friction_presliding")
    rest = 2.0 if form.quick else 20.0
    runs = {
        name: {
            "swayed": [swayed(name, amplitude) for amplitude in HAND_AMPLITUDES],
            "dragged": dragged(name),
            "let_go": let_go(name, rest),
        }
        for name in LAWS
    }
    save(draw(runs), form.out / "friction_presliding.png", resolution=80)
    numbers = numbers_of(runs)
    print(numbers)
    form.write_results(numbers)
