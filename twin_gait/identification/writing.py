"""Output of an identification in a folder: the document, parameter files and figures."""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from scipy.stats import binned_statistic

from twin_gait.configuration.custom_sections import section_of
from twin_gait.configuration.device_file import Device
from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.validation import packaged
from twin_gait.files import to_json_value, write_atomically, write_json
from twin_gait.identification.fitting import Loss
from twin_gait.identification.identify import Identification, IdentifiedModel
from twin_gait.identification.models import Samples
from twin_gait.identification.processing import BenchSetup
from twin_gait.palette import BLACK, BLUE, BLUISH_GREEN, ORANGE, SKY_BLUE, VERMILLION
from twin_gait.parameters.friction import (
    AsymmetricFriction,
    FrictionLaw,
    FrictionParameters,
    LuGreFriction,
    StribeckFriction,
)
from twin_gait.report.canvas import style_panel, write_pictures
from twin_gait.report.failures import failed_pictures
from twin_gait.report.pages import FIGURES_FOLDER
from twin_gait.report.state_diagram import name_to_words
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.vocabulary import JointName

DOCUMENT_FILE = "identification.json"
IDENTIFICATION = FolderKind("an identification", DOCUMENT_FILE)
PLANT_FILE, COMPENSATOR_FILE = "plant.yaml", "compensator.yaml"
# Models that a simulation accepts, with the law whose keys are their parameters.
PARAMETER_FILES: Mapping[str, Mapping[str, type[FrictionLaw]]] = {
    PLANT_FILE: {
        "rotational": FrictionParameters,
        "asymmetric": AsymmetricFriction,
        "asymmetric_stribeck": AsymmetricFriction,
        "dahl": LuGreFriction,
        "lugre": LuGreFriction,
        "lugre_asymmetric": LuGreFriction,
    },
    COMPENSATOR_FILE: {"rotational": FrictionParameters},
}


def write_identification(
    result: Identification,
    target: Path,
    joint: JointName | None,
    device: Device,
    *,
    force: bool = False,
    pictures: bool = True,
) -> dict[str, Any]:
    """Write document, parameter files and figures into a folder, which appears when all are complete.

    ``joint``: joint of the parameter files, or None for no such files. ``device``: device that the parameter
    files extend. ``force``: replace an existing folder. Returns the document.
    """
    files = {} if joint is None else _parameter_files(result, joint, device)
    document: dict[str, Any] = to_json_value(_identification_document(result, joint, device))
    document["parameter_files"] = {file: model for file, (model, _) in files.items()}
    with staged_directory(target, IDENTIFICATION, force=force) as staging:
        for file, (_, text) in files.items():
            write_atomically(staging / file, text)
        if pictures:
            drawings = {"fits": partial(draw_fits, result), "residuals": partial(draw_residuals, result)}
            document |= failed_pictures(write_pictures(drawings, staging / FIGURES_FOLDER).failed)
        write_json(staging / DOCUMENT_FILE, document)
    return document


def _identification_document(
    result: Identification, joint: JointName | None, device: Device
) -> dict[str, Any]:
    """Convert the result to plain numbers, with SI units in the keys."""
    options, best = result.options, result.models[0]
    order = f"rmse with {best.validations[0].left_out} left out" if math.isfinite(best.rank[0]) else "BIC"
    bench = options.bench if any(test.from_bench for test in result.tests) else None
    return {
        "schema_version": 1,
        "joint": joint,
        "device": None if joint is None else device.name,
        "models": [_model(item) for item in result.models],
        "skipped": result.skipped,
        "warnings": result.warnings,
        "method": {
            "order": order,
            **asdict(options.fit),
            "processing": None if bench is None else options.processing,
            "bench": None if bench is None else section_of(BenchSetup).document(bench),
        },
        "tests": [{"name": test.name, "mass_kg": test.mass, "samples": test.counts} for test in result.tests],
    }


def _model(item: IdentifiedModel) -> dict[str, Any]:
    return {
        "name": item.name,
        "formula": item.fit.model.formula,
        "parameters": item.fit.model.parameters(item.fit.x),
        "intervals_95": item.uncertainty.intervals,
        "standard_errors_if_independent": item.uncertainty.standard_errors,
        **asdict(item.goodness),
        "cross_validation": [asdict(run) for run in item.validations],
        "loss": Loss.LINEAR if math.isinf(item.fit.threshold) else Loss.HUBER,
        "warnings": item.warnings,
    }


def _parameter_files(result: Identification, joint: JointName, device: Device) -> dict[str, tuple[str, str]]:
    """Return model and text of each parameter file: the best supported model that dissipates energy.

    The plant supports static laws and bristles, the compensator only the firmware's law.
    """
    found: dict[str, tuple[str, str]] = {}
    for item in result.models:
        for file, entries in PARAMETER_FILES.items():
            if file not in found and item.name in entries:
                values = item.fit.model.parameters(item.fit.x)
                with contextlib.suppress(ValueError):  # pydantic's error for a law that would drive the joint
                    law = law_of(entries[item.name], values)
                    found[file] = (item.name, _parameter_file(file, law, item.name, joint, device))
    return found


def law_of(kind: type[FrictionLaw], values: dict[str, float]) -> FrictionLaw:
    """Create a law from the parameters of a model; linear viscous friction is the same in both directions."""
    if issubclass(kind, StribeckFriction) and "viscous_friction_Nms_per_rad" in values:
        linear = values.pop("viscous_friction_Nms_per_rad")
        values |= {"viscous_friction_forward_Nm": linear, "viscous_friction_backward_Nm": linear}
    law: FrictionLaw = section_of(kind)(**values).convert()
    return law


def _parameter_file(file: str, law: FrictionLaw, model: str, joint: JointName, device: Device) -> str:
    """Write a device with the law in the plant or in the compensator.

    It extends the device of the logs, so that everything else is inherited. A plant that was measured has a
    friction ratio of 1.
    """
    laws = {str(joint): section_of(type(law)).document(law)}
    section: dict[str, Any] = {"plant": {"friction": laws, "friction_ratio": {str(joint): 1.0}}}
    keys = [f"plant.friction.{joint}", f"plant.friction_ratio.{joint}"]
    if file == COMPENSATOR_FILE:
        section, keys = {"control": {"friction_model": laws}}, [f"control.friction_model.{joint}"]
    shipped = packaged("devices").get(device.name)
    is_shipped = shipped is not None and shipped.resolve() == device.path
    content = {
        "schema_version": 2,
        "extends": device.name if is_shipped else str(device.path),
        "description": f"{device.name} with the friction of the {joint} by the model {model}.",
        **section,
        "sources": dict.fromkeys(keys, f"identified by the model {model}, see {DOCUMENT_FILE}"),
    }
    return dump_yaml(content)


_SHOWN_SAMPLES = 15_000
_COLOURS = (VERMILLION, BLUE, BLUISH_GREEN, ORANGE)  # colours of the best models
_BINS = 30
_PANELS = {"all speeds": 1.0, "slow": 0.25}  # share of the largest speed that each panel shows


def draw_fits(result: Identification) -> Figure:
    """Draw the measured torque and the predictions of the best models, over the speed."""
    samples, best = result.samples.used_only(), result.models[0]
    shown = _shown(samples)
    velocity, low, high = samples.velocity[shown], samples.velocity.min(), samples.velocity.max()
    figure = Figure(figsize=(12.0, 5.2), layout="constrained")
    figure.suptitle(f"Friction · best: {name_to_words(best.name)}, RMSE {best.goodness.rmse:.3g} N·m")
    panels = figure.subplots(1, 2, sharey=True)
    best_last = list(zip(result.models, _COLOURS, strict=False))[::-1]
    for axes, (title, share) in zip(panels, _PANELS.items(), strict=True):
        axes.plot(velocity, samples.torque[shown], ".", color="0.72", markersize=2.0, label="measured")
        for item, colour in best_last:
            predicted = (samples.torque - item.residuals)[shown]
            axes.plot(velocity, predicted, ".", color=colour, markersize=1.5, label=name_to_words(item.name))
        axes.set_xlim(share * min(low, 0.0), share * max(high, 0.0))
        axes.set_xlabel("velocity [rad/s]")
        style_panel(axes, title, "friction torque [N·m]")
    panels[0].legend(fontsize="small", frameon=False, loc="upper left", markerscale=4.0, reverse=True)
    return figure


def _shown(samples: Samples) -> slice:
    """Return the slice of evenly spaced samples that a figure shows."""
    return slice(None, None, -(-len(samples) // _SHOWN_SAMPLES))


def draw_residuals(result: Identification) -> Figure:
    """Draw the residuals of the best model against speed, load, angle, time and temperature, and medians."""
    samples, best = result.samples.used_only(), result.models[0]
    known = {
        "velocity [rad/s]": samples.velocity,
        "load torque [N·m]": samples.load,
        "joint angle [rad]": samples.angle,
        "time in the test [s]": samples.time,
        "temperature [°C]": samples.temperature,
    }
    columns = {name: values for name, values in known.items() if values is not None}
    figure = Figure(figsize=(1.0 + 3.6 * len(columns), 4.0), layout="constrained")
    figure.suptitle(f"Residuals of {name_to_words(best.name)}: measured less predicted")
    panels, shown = figure.subplots(1, len(columns), sharey=True, squeeze=False)[0], _shown(samples)
    for axes, (label, values) in zip(panels, columns.items(), strict=True):
        axes.plot(values[shown], best.residuals[shown], ".", color=SKY_BLUE, markersize=1.5)
        middle, edges, _ = binned_statistic(values, best.residuals, "median", bins=_BINS)
        axes.stairs(middle, edges, baseline=None, color=BLACK, linewidth=1.6, zorder=3.0)
        axes.set_xlabel(label)
        style_panel(axes, "", "residual [N·m]")
    return figure
