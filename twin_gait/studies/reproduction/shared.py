"""What the recipes of friction share: campaigns and fits, each made once whichever recipe comes first."""

from __future__ import annotations

import fcntl
import io
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from twin_gait.core.friction import rotational_friction_torque
from twin_gait.files import write_atomically
from twin_gait.identification import (
    BenchSetup,
    FitOptions,
    FrictionTest,
    IdentificationOptions,
    LogColumns,
    Loss,
    Processing,
    ProcessingOptions,
    bootstrap,
    identify_tests,
    process_log,
    read_log,
)
from twin_gait.identification.statistics import Goodness
from twin_gait.scenario.bench_joint import BENCH_ACTUATORS, BENCH_FRICTION
from twin_gait.studies.campaign import Campaign, Protocol, run_campaign
from twin_gait.vocabulary import JointName

# Parameters of equation (3.1) by the thesis's letters: name in an identification, unit.
LETTERS: Mapping[str, tuple[str, str]] = {
    "a": ("breakaway_torque_Nm", "N m"),
    "b": ("coulomb_friction_Nm", "N m"),
    "c": ("breakaway_velocity_rad_per_s", "rad/s"),
    "d": ("viscous_friction_Nms_per_rad", "N m s/rad"),
}
LEVEL = 0.999  # of the intervals in bands: so few of the claims may fail by chance
_LAW = "rotational"


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Keep other processes out."""
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def campaign_logs(folder: Path, joint: JointName, protocol: Protocol, seed: int) -> list[Path]:
    """Log files of a campaign, simulated by the first recipe that asks for it.

    Args:
        folder: Shared by the recipes of one reproduction.
        joint: Knee or hip.
        protocol: Falls, or motor-driven.
        seed: Of the campaign.

    Returns:
        One file a test, ``campaign.json`` beside them.
    """
    directory = folder / f"{joint}_{protocol}_{seed}"
    with _alone(folder / f"{directory.name}.lock"):
        if not directory.exists():
            run_campaign(Campaign(joint=joint, protocol=protocol, seed=seed), directory)
    return sorted(directory.glob("*.log"))


@dataclass(frozen=True, eq=False)
class LawFit:
    """Equation (3.1) fitted to a campaign by least squares.

    Attributes:
        values: a, b, c and d in SI units.
        intervals: 95 % intervals, by letter.
        blocks: Tests that the intervals rest on.
        goodness: Of the fit.
        velocity: Of the samples in [rad] / [s], shape ``(n,)``.
        torque: Friction torque in [N m], shape ``(n,)``.
        residuals: Measured less predicted torque in [N m], shape ``(n,)``.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    blocks: int
    goodness: Goodness
    velocity: np.ndarray
    torque: np.ndarray
    residuals: np.ndarray

    def half_width(self, letter: str, level: float) -> float:
        """Half the width of an interval of a parameter.

        Args:
            letter: a, b, c or d.
            level: Confidence, for example 0.999.

        Returns:
            In the unit of the parameter: Student's quantile times the bootstrap's standard error.
        """
        low, high = self.intervals[letter]
        wider = student.ppf(0.5 + level / 2.0, self.blocks - 1) / student.ppf(
            0.5 + bootstrap.LEVEL / 2.0, self.blocks - 1
        )
        return float(0.5 * (high - low) * wider)


def kept(folder: Path, name: str, make: Callable[[], LawFit]) -> LawFit:
    """A fit that recipes share: made by the first that asks, while the others wait for it.

    Args:
        folder: Shared by the recipes of one reproduction.
        name: Of the fit; says everything that it depends on.
        make: Makes it.

    Returns:
        The fit, as numbers that were kept: nothing that a file holds is run.
    """
    path = folder / f"{name}.npz"
    with _alone(folder / f"{name}.lock"):
        if not path.exists():
            write_atomically(path, _packed(make()))
    with np.load(path, allow_pickle=False) as arrays:
        known = json.loads(str(arrays["numbers"]))
        intervals = {letter: (low, high) for letter, (low, high) in known["intervals"].items()}
        goodness = Goodness(**known["goodness"])
        return LawFit(
            known["values"], intervals, known["blocks"], goodness, *(arrays[name] for name in _SAMPLES)
        )


_SAMPLES = ("velocity", "torque", "residuals")


def _packed(fit: LawFit) -> bytes:
    numbers = {
        "values": dict(fit.values),
        "intervals": dict(fit.intervals),
        "blocks": fit.blocks,
        "goodness": asdict(fit.goodness),
    }
    buffer = io.BytesIO()
    np.savez(buffer, numbers=json.dumps(numbers), **{name: getattr(fit, name) for name in _SAMPLES})
    return buffer.getvalue()


def fit_campaign(
    folder: Path,
    joint: JointName,
    protocol: Protocol,
    processing: Processing,
    seed: int,
    *,
    forward: bool = False,
    mass_as_printed: bool = False,
) -> LawFit:
    """Fit equation (3.1) to a campaign, by ordinary least squares as the thesis's toolbox does.

    Args:
        folder: Shared by the recipes of one reproduction.
        joint: Knee or hip.
        protocol: Falls, or motor-driven.
        processing: Of the logs.
        seed: Of the campaign.
        forward: Whether only samples that move along the fall are fitted, as figures 3.2 and 3.3 show.
        mass_as_printed: Whether J_mass is m b.

    Returns:
        The fit.
    """
    name = f"{joint}_{protocol}_{processing}_{seed}_{forward:d}{mass_as_printed:d}"
    bench = BenchSetup(actuator=BENCH_ACTUATORS[joint], mass_as_printed=mass_as_printed)

    def make() -> LawFit:
        options = ProcessingOptions(processing=processing)
        paths = campaign_logs(folder, joint, protocol, seed)
        tests = [process_log(read_log(path, LogColumns()), bench, options) for path in paths]
        return _fit([_forward(test) for test in tests] if forward else tests, bench, seed)

    return kept(folder, name, make)


def _forward(test: FrictionTest) -> FrictionTest:
    return replace(test, used=test.used & (test.velocity > 0.0))


def _fit(tests: list[FrictionTest], bench: BenchSetup, seed: int) -> LawFit:
    options = IdentificationOptions(
        bench=bench, fit=FitOptions(loss=Loss.LINEAR, seed=seed), models=(_LAW,), cross_validation=False
    )
    result = identify_tests(tests, options)
    found, samples = result.models[0], result.samples.used_only()
    values = found.fit.model.parameters(found.fit.x)
    return LawFit(
        values={letter: values[name] for letter, (name, _) in LETTERS.items()},
        intervals={letter: found.uncertainty.intervals[name] for letter, (name, _) in LETTERS.items()},
        blocks=found.uncertainty.blocks,
        goodness=found.goodness,
        velocity=samples.velocity,
        torque=samples.torque,
        residuals=found.residuals,
    )


def table_values(joint: JointName) -> dict[str, float]:
    """Table 3.1 of the thesis in the sign-normal form: a, b and c positive.

    Args:
        joint: Knee or hip.

    Returns:
        a, b, c and d in SI units.
    """
    law = BENCH_FRICTION[joint].normalised()
    return {
        "a": law.breakaway_torque,
        "b": law.coulomb_friction,
        "c": law.breakaway_velocity,
        "d": law.viscous_friction,
    }


def law_torque(values: Mapping[str, float], velocity: np.ndarray) -> np.ndarray:
    """Equation (3.1) over speeds, also with parameters that no joint could have.

    Args:
        values: a, b, c and d in SI units.
        velocity: In [rad] / [s], shape ``(n,)``.

    Returns:
        Friction torque in [N m], shape ``(n,)``.
    """
    a, b, c, d = (values[letter] for letter in LETTERS)
    return np.array([rotational_friction_torque(float(speed), a, b, c, d) for speed in velocity])
