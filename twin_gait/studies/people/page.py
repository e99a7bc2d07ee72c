"""The page of the documentation on people: what a wearer does, and whether each of them walks.

``python -m twin_gait.studies.people.page docs`` takes two minutes and writes ``people.md`` there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from twin_gait.configuration.device_sections import interface_document
from twin_gait.configuration.people import people
from twin_gait.files import write_atomically
from twin_gait.measures.reference import KILOMETRES_PER_HOUR
from twin_gait.parameters import HEAVIEST_WEARER, BraceParameters
from twin_gait.scenario import TreadmillScenario
from twin_gait.studies.batch import Flat
from twin_gait.studies.people.cohort import SIZES
from twin_gait.studies.people.trials import (
    MASS_ALONE,
    PASSIVE_ALONE,
    BraceTrial,
    Trial,
    brace_trial,
    experiment_of,
    trial,
)
from twin_gait.vocabulary import JointName, Outcome, Sex, Side

NAME = "people"
DURATION = 30.0  # [s]
SUPPORTS = (0.6, 0.4)

BRACE_FACTORS, BRACE_DURATION = (0.3, 0.5, 1.0, 3.0, 10.0), 20.0
_BRACE_HEADINGS = (
    "times as stiff",
    "the walk",
    "stride [s]",
    "RMS torque, hip, knee [Nm]",
    "most relative motion, hip, knee [°]",
    "at the pelvis [mm]",
)
_FURTHER = ("further_contacts", "scuffs")

_LAWS = (
    ("key", "meaning", "law"),
    (
        "`passive`",
        "share of the passive elastic moment",
        "Riener and Edrich (1999), mean of ten healthy men; muscles over two joints and the ankle included",
    ),
    (
        "`contracture_deg`",
        "by which the joint resists as a sound one would, further extended",
        "the same law, shifted: stiff sooner in extension, and later in flexion; needs `passive`",
    ),
    (
        "`stretch_reflex_threshold_deg_per_s`, `stretch_reflex_gain_Nms_per_rad`",
        "spasticity",
        "no torque up to the speed, then gain times the excess, against the motion",
    ),
    (
        "`effort`",
        "share of the normative moment that the wearer wants to give",
        "Winter (1991), slow cadence, per body mass, at the present phase and hip angle",
    ),
    (
        "`strength`",
        "share of that which his muscles can give",
        "effort times strength, late by the delay, with the noise",
    ),
)
_HEADINGS = (
    "who",
    *(f"{share:.0%} support" for share in SUPPORTS),
    "stride [s]",
    "swing [%]",
    "knee RMSE [°]",
    "further contacts, scuffs",
    "peak of his torque, hip, knee [Nm]",
    "his mean power, hips, knees [W]",
)

_TEXT = """# People

A wearer is more than a mass. At hips and knees he resists (passive moments, contracture, spasticity) and
helps (voluntary effort), per joint and side:

```yaml
patient:
  mass_kg: 70
  height_m: 1.75
  sex: male                      # female or male: segment masses of de Leva (1996)
  segment_model: de_leva         # or winter: segments of Winter (2009), the same for both sexes
  effort_delay_ms: 100           # from phase and posture to the torque
  effort_noise: 0.1              # standard deviation from tick to tick, as a share of the effort
  both:
    hip: {{passive: 1, effort: 0.5}}
    knee: {{passive: 1.2, stretch_reflex_threshold_deg_per_s: 60, stretch_reflex_gain_Nms_per_rad: 2}}
  left:                          # laid over both, key by key
    hip: {{contracture_deg: 5, strength: 0.5}}
```

{laws}

`segment_model: winter` takes masses, centres of mass and radii of gyration of thigh, shank and foot from
Winter (2009, table 4.1, after Dempster): a leg has 16.1 % of the body's mass, where de Leva gives 19.9 % to
a man's and 20.9 % to a woman's. That foot is measured from ankle to second metatarsal, which is taken to lie
at 72 % of the foot's length (an assumption).

A phase of the device stands for a span of the healthy cycle (Perry 1992); within it, the wearer gives the
moment of the instant whose hip angle is nearest to his own, on the reference of Koopman et al. (2014) at
his height and the belt's speed. Moments of the stance phases are scaled by the share of the weight that the
support leaves; a leg on its stand carries nothing and makes none.

What the model leaves out: reflexes other than the catch, balance, the will to do something else than the
normative gait, fatigue, arms, and the passive moment of the ankle, which the orthosis holds. Winter's slow
walkers go about twice as fast as the belt, so their moments are high for it. They are net moments and
contain the passive ones: `passive: 1` with `effort: 1` is somewhat more than a healthy leg does.

## Braces

Without a word on it the wearer is one rigid body with the device (`interface: rigid`). With
`interface: brace` they are two: the links and rotors of the device, and the segments of the wearer on the
same joints, bound coordinate by coordinate by a spring and a damper. What the device does on him at a hip,
a knee, an ankle, and vertically at the pelvis, is then a number of its own,

    τ = K (q_device − q_wearer) + B (q̇_device − q̇_wearer),

and he does the opposite on the device.

```yaml
interface:
  kind: brace                    # interface: brace takes all sizes as they are here
{sizes_of_braces}
```

Motors, friction, stops, ankle orthosis, hands and pushes act on the device, whose joints the
sensors read. Passive moments, spasticity, effort, the support and the ground (the foot in its shoe) act on
the wearer. A log has his angles, the torques of the braces (`left_hip_wearer_angle_rad`,
`left_hip_brace_torque_Nm`, on him and positive towards flexion, `pelvis_brace_force_N`) and `brace_work_J`;
every other column of a joint or of the pelvis stays the device's, but for `patient_torque_Nm` and
`support_force_N`, which act on the wearer. `summary.json` has under `interaction` root mean square and peak
of each torque and the largest relative motion. The controller knows nothing of it: gravity, ζ and the
static checks reckon with one body.

The sizes are assumptions, no measurement of this device is known to us: cuffs of 10 kN/m at 0.25 m from the
hip and at 0.2 m from the knee, which give by some degrees at the torques of the motors, a foot strapped on
its plate, belts around the pelvis; about a third of critical damping for a wearer of 70 kg, at the foot
three quarters. The shipped walk of {first:.0%} support with the wearer who is mass alone,
{brace_duration:g} s, in braces of other stiffness (dampers by the root of it):

{braces}

Left out: that joints of wearer and device do not lie on one another, migration of cuffs, stiffening of
tissue under pressure and play of the straps, any motion off the sagittal plane, and forces along a limb. A
brace that is too stiff for the integrator's step is refused with the step that carries it.

## Who ships

`twin-gait presets` lists them, `twin-gait presets stroke_left` prints one with the source of every number,
or the word assumption. `--set patient=stroke_left`, and `patient: stroke_left`, `patient: my_file.yaml` or
`patient: {{preset: stroke_left, mass_kg: 80}}` in an experiment file, put one on; he takes the place of the
whole wearer before.

**The wearer of the shipped experiments stays mass alone**: the shipped table was tuned for him, and a run
without a word on what its wearer does is the run it was. Most sizes of effort, weakness and spasticity of
the people are assumptions: they are types to compare controllers with, not patients.

{who}

## Do they walk with the shipped table?

The shipped treadmill walk at {speed:.1f} km/h, {duration:g} s, with each of them as wearer:

{table}

Pairs of stride, swing and RMSE are left, right, all at {first:.0%} support. RMSE is
against Koopman's reference from foot contact. Power below 0 is energy that the wearer takes: the
muscles of a healthy knee brake the swing, those of the hip drive it. The passive laws of hip and knee are
regressions, not slopes of one potential, so that around a stride they give or take a little energy:
the row of the passive moments alone.

{verdict}

## A cohort

`twin_gait.studies.people.cohort.cohort(count, seed)` draws people: either sex with equal chance, stature and
mass correlated and lognormal, from the 5th to the 95th percentile of the sex, at most {heaviest:g} kg. Person
number i of a seed is the same in a cohort of any size.

{sizes}

Mean ± standard deviation after Heinz et al. (2003): 247 men and 260 women, young and physically active, so
lighter than most patients. The correlation of the men follows from their regression slope; the deviations
of mass and the women's correlation are assumptions. Another population can be handed in.

[Who of them walks](cohort.md), on another page.

Made by `python -m twin_gait.studies.people.page docs`.
"""


def page(
    trials: Mapping[str, Sequence[Trial]],
    braced: Mapping[float, BraceTrial],
) -> str:
    """Text of the page.

    Args:
        trials: Of each person, one for each of ``SUPPORTS``.
        braced: In braces, by how much stiffer they were.

    Returns:
        Markdown.
    """
    scenario = experiment_of(MASS_ALONE, SUPPORTS[0], DURATION).scenario
    assert isinstance(scenario, TreadmillScenario)
    return _TEXT.format(
        laws=_table(_LAWS),
        sizes_of_braces=_brace_sizes(),
        brace_duration=BRACE_DURATION,
        braces=_table([_BRACE_HEADINGS, *(_brace_row(*item) for item in braced.items())]),
        who=_table([("who", "what"), *((f"`{name}`", text) for name, text in people().items())]),
        speed=KILOMETRES_PER_HOUR * scenario.belt_speed,
        duration=DURATION,
        first=SUPPORTS[0],
        table=_table([_HEADINGS, *(_row(name, results) for name, results in trials.items())]),
        verdict=_verdict(trials),
        heaviest=HEAVIEST_WEARER,
        sizes=_table([("sex", "stature [m]", "mass [kg]", "correlation"), *map(_size, Sex)]),
    )


def _table(rows: Iterable[Sequence[str]]) -> str:
    heading, *rest = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([heading, "|---" * (heading.count(" | ") + 1) + "|", *rest])


def _row(name: str, results: Sequence[Trial]) -> tuple[str, ...]:
    first = results[0]
    further = [sum(int(first.summary[f"{side}_{key}"] or 0) for side in Side) for key in _FURTHER]
    return (
        name,
        *(item.outcome for item in results),
        _pair(first.summary, "stride_time_mean_s", 1.0, "{:.2f}"),
        _pair(first.summary, "swing_share", 100.0, "{:.1f}"),
        _pair(first.summary, "rmse_knee_by_contact_deg", 1.0, "{:.1f}"),
        ", ".join(map(str, further)),
        ", ".join(f"{peak:.0f}" for peak in first.peaks),
        ", ".join(f"{power:.1f}" for power in first.powers),
    )


def _brace_sizes() -> str:
    document = interface_document(BraceParameters())
    lines = []
    for name, sizes in document.items():
        if isinstance(sizes, dict):
            inner = ", ".join(f"{key}: {value:g}" for key, value in sizes.items())
            lines.append(f"  {name}: {{{inner}}}")
    return "\n".join(lines)


def _brace_row(factor: float, result: BraceTrial) -> tuple[str, ...]:
    legs = [
        [result.interaction[f"{side}_{joint}"] for side in Side] for joint in (JointName.HIP, JointName.KNEE)
    ]
    torques = (max(item["torque_rms_Nm"] for item in items) for items in legs)
    motions = (max(item["motion_peak_deg"] for item in items) for items in legs)
    times = ("–" if value is None else f"{value:.2f}" for value in result.stride_times)
    return (
        f"{factor:g}",
        result.outcome,
        ", ".join(times),
        ", ".join(f"{torque:.1f}" for torque in torques),
        ", ".join(f"{motion:.1f}" for motion in motions),
        f"{result.interaction['pelvis']['motion_peak_mm']:.0f}",
    )


def _pair(flat: Flat, key: str, factor: float, form: str) -> str:
    values = [flat[f"{side}_{key}"] for side in Side]
    return ", ".join("–" if value is None else form.format(factor * float(value)) for value in values)


def _verdict(trials: Mapping[str, Sequence[Trial]]) -> str:
    failed = [
        f"{name} at {support:.0%} support {item.outcome} ({item.reason})"
        for name, results in trials.items()
        for support, item in zip(SUPPORTS, results, strict=True)
        if item.outcome != Outcome.WALKED
    ]
    if not failed:
        return f"All of them walk, at {' and at '.join(f'{support:.0%}' for support in SUPPORTS)} support."
    return "Not all of them walk:\n\n" + "\n".join(f"- {text}" for text in failed)


def _size(sex: Sex) -> tuple[str, ...]:
    size = SIZES[sex]
    stature = f"{size.stature_mean:.3f} ± {size.stature_deviation:.3f}"
    return str(sex), stature, f"{size.mass_mean:.1f} ± {size.mass_deviation:.1f}", f"{size.correlation:.2f}"


def write(folder: Path) -> None:
    """Run everything and write the page.

    Args:
        folder: Where to.

    Raises:
        RunDirectoryError: If the file cannot be written.
    """
    trials = {
        name: [trial(experiment_of(name, support, DURATION)) for support in SUPPORTS]
        for name in (MASS_ALONE, PASSIVE_ALONE, *people())
    }
    alone = experiment_of(MASS_ALONE, SUPPORTS[0], BRACE_DURATION)
    braced = {factor: brace_trial(alone, factor) for factor in BRACE_FACTORS}
    write_atomically(folder / f"{NAME}.md", page(trials, braced))


if __name__ == "__main__":
    write(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
