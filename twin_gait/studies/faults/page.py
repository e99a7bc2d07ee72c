"""The page of the documentation on faults: table, picture and text, made again at will.

``twin-gait faults --count 1000 --out docs/faults.csv`` writes the table,
``python -m twin_gait.studies.faults.page docs/faults.csv`` page and picture beside it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin_gait.configuration import load_experiment
from twin_gait.control import TripCause
from twin_gait.exceptions import ParameterError
from twin_gait.files import write_atomically
from twin_gait.gait.table import TICK
from twin_gait.palette import BLACK, BLUE, GREY, ORANGE, SIDE_COLOURS, SKY_BLUE, VERMILLION
from twin_gait.parameters import SafetyParameters
from twin_gait.report.canvas import picture_bytes
from twin_gait.scenario import TreadmillScenario
from twin_gait.scenario.faults import FaultKind
from twin_gait.simulation import Run, RunStatus, simulate
from twin_gait.studies.faults.audit import stated_reaction
from twin_gait.studies.faults.faults import FaultCampaign, limit_lines, outcome_table
from twin_gait.vocabulary import Outcome

EXAMPLE = "encoder_freeze:left_knee@4.2s"
_SHOWN = (3.4, 6.4)  # [s]
_TEXTS = ("side", "joint", "cause", "trip_place")
_COLOURS = {
    Outcome.WALKED: GREY,
    Outcome.HELD: BLUE,
    Outcome.STALLED: SKY_BLUE,
    Outcome.HUNG: BLACK,
    Outcome.FELL: ORANGE,
    Outcome.DIVERGED: VERMILLION,
}
_WORDS = {
    TripCause.ENCODER_MISSING: "the encoder gives no number",
    TripCause.ENCODER_JUMP: "its angle changes by more than {angle_step:g} rad in a tick",
    TripCause.ENCODER_FROZEN: "it stands still to the last bit while the drive infers more than "
    "{frozen_speed:g} rad/s from voltage and current",
    TripCause.ENCODER_MODEL: "it runs away from that inferred speed by {model_deviation:g} rad, forgotten "
    "with {model_time_constant:g} s",
    TripCause.JOINT_SPEED: "faster than the URDF's velocity limit",
    TripCause.JOINT_RANGE: "braked with {stopping_deceleration:g} rad/s² from now on, the joint would come "
    "to rest beyond its range in the URDF",
    TripCause.COMMAND: "the command is no number or above {highest_command:g} N m",
    TripCause.TORQUE: "the command is above the torque limit",
    TripCause.CURRENT: "measured current {current_share:g} times its limit",
    TripCause.WINDING_HEAT: "I²t: the winding is as warm as at its continuous current in the long run "
    "(time constant {thermal_time_constant:g} s)",
    TripCause.DRIVE: "current {drive_deviation:g} A off from what target, bus voltage and speed allow; this "
    "drive is cut off",
    TripCause.PHASE_TIME_OUT: "a phase lasts longer than that (not in transparent mode)",
    TripCause.FOOT_LOAD_FROZEN: "the load of a loaded foot stands still while the hip turns",
    TripCause.SUPPLY: "bus voltage below {least_voltage_share:g} of the battery's",
}

_TEXT = """# Safety monitor and faults

![Outcomes]({name}.png)

A monitor stands between controller and motor. After a trip both legs are in a hold that damps every joint
({damping:g} N m s/rad, on the speed that the drive infers, so that no encoder is needed) and carries the
leg's weight, fading out over {lowering:g} s: the leg is lowered. The hold never ends by itself. Cause, place
and time are in the summary and in the log (`safety_state`, `trip_cause`).

A trip, or the operator's Stop, also stops the treadmill. The belt comes to rest in {ramp:g} s
(`scenario.stop_ramp_s`), without a jump of its speed or acceleration. The harness locks at the present
height of the pelvis: beside the {share:g} % of the weight that the support always carries, it carries what
sinks below, as a spring that only pulls upwards. Its stiffness (`scenario.support.catch_stiffness_N_per_m`,
{stiffness:g} kN/m) is that of a metre of rope that stretches by 5 % under 100 kg, the most that EN 1891
allows a low-stretch rope; its dissipation (`catch_dissipation_s_per_m`, {dissipation:g} s/m) is an
assumption. The force is part of `support_force_N`, the work of `stop_work_J`. `stop_ramp_s: null` is a belt
that runs on, a stiffness of 0 a harness that does not lock; with both, a Stop ends in a fall within seconds.

`twin-gait simulate --fault {example}` strikes one fault; the campaign below is
`twin-gait faults --count {count} --out docs/{name}.csv`: seeded faults over kind, joint, time and
magnitude on the default walk.

{table}

- **held**: the run ended in the hold, without a fall.
- **walked**: no trip to the end of the run. These are faults that are too small or too short for the
  bounds below, or that the gait does not feel, such as a load sensor stuck at zero.
- **fell**: the pelvis sank below the height that counts as a fall. A controller that bends one knee slowly
  stays inside every bound until the leg gives way; the harness locks where a trip finds the pelvis.{falls}
- Detection is the time from the fault to the trip. A frozen encoder on a joint that stands still, or a dead
  motor that has nothing to do, is noticed when it matters.

What held:

{limits}

Torque is limited to {torque:g} N m, current to {current:g} A. Reaction times are measured from the log
alone, by laying the bounds over its columns, not from the monitor's own counters.

## Bounds

| cause | trips when | reaction at most |
| --- | --- | --: |
{bounds}

The reaction counts from the first tick outside the bound to the hold on every joint; where it is longer than
1 ms, the bound may be broken for that long. All bounds are
parameters (`control.safety`), as is the monitor itself (`control.safety.enabled`). The time constant of the
winding is that of the maxon EC 90 flat data sheet; range and speed are the URDF's; the other bounds are
assumptions, chosen so that the shipped walks, with noise and with one thing changed at a time, stay away
from them.

## What the model leaves out

That belt and support stop with the device is an assumption: all three are on one stop circuit. The harness
has no slack, and the wearer does nothing to save themselves. Where the drive of a knee is cut off in swing,
nothing brakes the shank: this foot may land a second later and slide, with some 50 N on it, while it is put
down. A drop of the supply leaves the bus at the highest back-EMF of the motors, because nothing but its
capacitors takes what they feed back. An encoder that drifts more slowly than {drift:.0f}°/s, or a load
sensor that is stuck at zero, is not told from a healthy one. Not a medical device.
"""


def read_campaign(path: Path) -> FaultCampaign:
    """Read the table that ``twin-gait faults --out`` wrote.

    Args:
        path: The file.

    Returns:
        The campaign.

    Raises:
        ParameterError: If it cannot be read.
    """
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise ParameterError(f"{path}: cannot be read ({error})") from error
    return FaultCampaign(table.fillna({name: "" for name in _TEXTS}), RunStatus.COMPLETED)


def write_page(campaign: FaultCampaign, folder: Path, name: str = "faults") -> None:
    """Write page and picture of a campaign.

    Args:
        campaign: On the default walk.
        folder: An existing folder.
        name: Of the files.
    """
    write_atomically(folder / f"{name}.md", page_text(campaign, name))
    example = simulate(load_experiment("treadmill", ["duration_s=8", f"faults=[{EXAMPLE!r}]"]).experiment)
    write_atomically(folder / f"{name}.png", picture_bytes(picture(campaign.table, example)))


def page_text(campaign: FaultCampaign, name: str) -> str:
    """Text of the page."""
    experiment = load_experiment("treadmill").experiment
    settings, limits = experiment.control.safety, experiment.control.limits
    scenario = experiment.scenario
    assert isinstance(scenario, TreadmillScenario)  # the default walk
    return _TEXT.format(
        name=name,
        example=EXAMPLE,
        count=len(campaign.table),
        damping=settings.hold_damping,
        ramp=scenario.stop_ramp,
        share=100.0 * scenario.support.share,
        stiffness=scenario.support.catch_stiffness * 1e-3,
        dissipation=scenario.support.catch_dissipation,
        lowering=settings.lowering_time,
        table=outcome_table(campaign.table),
        falls=_falls(campaign.table),
        limits="\n".join(f"- {line}" for line in limit_lines(campaign)),
        torque=limits.torque,
        current=limits.current,
        bounds="\n".join(bound_lines(settings)),
        drift=np.degrees(settings.model_deviation / settings.model_time_constant),
    )


def _falls(table: pd.DataFrame) -> str:
    """Which faults ended in a fall, and when they were noticed."""
    lines = ""
    for row in table[table["outcome"] == Outcome.FELL].to_dict("records"):
        noticed = f"{row['cause']} after {row['detection_s']:.3f} s" if row["cause"] else "no trip"
        lines += f"\n  - `{row['fault']}`: {noticed}"
    return lines


def bound_lines(settings: SafetyParameters) -> list[str]:
    """One line of a table for each cause."""
    values = {name: getattr(settings, name) for name in SafetyParameters.__dataclass_fields__}
    return [
        f"| {cause} | {words.format(**values)} | {stated_reaction(cause, settings) * 1e3:g} ms |"
        for cause, words in _WORDS.items()
    ]


def picture(table: pd.DataFrame, example: Run) -> Figure:
    """Outcomes and detection times by kind, and one trip."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=[2.2, 1.0, 1.0])
    kinds = [kind for kind in FaultKind if (table["kind"] == kind).any()]
    outcomes, detection = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    _draw_outcomes(outcomes, table, kinds)
    _draw_detection(detection, table, kinds)
    knee = figure.add_subplot(grid[1, :])
    _draw_trip(knee, example, "angle_rad", float(np.degrees(1.0)), "knee [°]")
    torque = figure.add_subplot(grid[2, :], sharex=knee)
    _draw_trip(torque, example, "motor_torque_Nm", 1.0, "motor torque [N m]")
    torque.set_xlabel("time [s]")
    knee.tick_params(labelbottom=False)
    knee.legend(loc="upper right", ncols=3, frameon=False)
    assert example.trip is not None  # the example is one that trips
    title = f"{EXAMPLE}: {example.trip.cause.replace('_', ' ')} trips after "
    knee.set_title(
        f"{title}{1e3 * (example.trip.time - example.experiment.faults[0].time):.0f} ms", loc="left"
    )
    return figure


def _draw_outcomes(axes: Axes, table: pd.DataFrame, kinds: Sequence[FaultKind]) -> None:
    left = np.zeros(len(kinds))
    for outcome, colour in _COLOURS.items():
        share = [float((table.loc[table["kind"] == kind, "outcome"] == outcome).mean()) for kind in kinds]
        if any(share):
            axes.barh(range(len(kinds)), share, left=left, color=colour, label=str(outcome), height=0.75)
        left += share
    _name_kinds(axes, kinds)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of the runs")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)


def _draw_detection(axes: Axes, table: pd.DataFrame, kinds: Sequence[FaultKind]) -> None:
    generator = np.random.default_rng(0)
    for position, kind in enumerate(kinds):
        found = table.loc[(table["kind"] == kind) & (table["cause"] != ""), "detection_s"].to_numpy()
        spread = position + generator.uniform(-0.28, 0.28, len(found))
        # What is noticed in the very tick stands at one tick: the axis is logarithmic.
        axes.plot(np.maximum(found, TICK), spread, ".", color=BLUE, markersize=4, alpha=0.6)
    axes.set_xscale("log")
    _name_kinds(axes, kinds)
    axes.set_yticklabels([])
    axes.set_xlabel("time from fault to trip [s]")
    axes.grid(axis="x", color=GREY, alpha=0.3)


def _name_kinds(axes: Axes, kinds: Sequence[FaultKind]) -> None:
    axes.set_yticks(range(len(kinds)), [kind.replace("_", " ") for kind in kinds])
    axes.set_ylim(len(kinds) - 0.4, -0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_trip(axes: Axes, run: Run, column: str, factor: float, label: str) -> None:
    assert run.trip is not None  # the example is one that trips
    shown = run.log[(run.log["time_s"] >= _SHOWN[0]) & (run.log["time_s"] <= _SHOWN[1])]
    time = shown["time_s"].to_numpy()
    for side in run.sides:
        axes.plot(
            time, factor * shown[f"{side}_knee_{column}"], color=SIDE_COLOURS[side], label=f"{side} knee"
        )
    if column == "angle_rad":
        reading = factor * shown["left_knee_measured_angle_rad"]
        axes.plot(time, reading, color=BLACK, linestyle=":", label="left encoder")
    axes.axvspan(run.trip.time, _SHOWN[1], color=GREY, alpha=0.15, linewidth=0)
    if column == "angle_rad":
        axes.text(run.trip.time, 0.85, " hold", transform=axes.get_xaxis_transform(), color=BLACK)
    axes.set_xlim(*_SHOWN)
    axes.set_ylabel(label)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    source = Path(sys.argv[1])
    write_page(read_campaign(source), source.parent, source.stem)
