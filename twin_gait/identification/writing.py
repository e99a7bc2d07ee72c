"""What an identification leaves behind: the document, parameter files, samples and figures in a folder."""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from twin_gait import parameters
from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.readers import section_of
from twin_gait.files import plain, write_atomically, write_json
from twin_gait.identification.figures import draw_fits, draw_residuals
from twin_gait.identification.fitting import Loss
from twin_gait.identification.identify import Identification, IdentifiedModel
from twin_gait.identification.processing import BenchSetup, Processing, ProcessingOptions
from twin_gait.report.canvas import readable, write_figures_page
from twin_gait.runs.folders import FolderKind, staged_directory
from twin_gait.vocabulary import JointName
from twin_gait.worlds import BENCH_FRICTION

DOCUMENT_FILE = "identification.json"
IDENTIFICATION = FolderKind("an identification", DOCUMENT_FILE)
SAMPLES_FILE = "samples.csv"
PLANT_FILE, COMPENSATOR_FILE = "plant.yaml", "compensator.yaml"
REPORT_FILE = "report.html"
SCHEMA_VERSION = 1
PRESET = "bench_leg"
_LISTED_SAMPLES = 100_000
# Models that a simulation takes, with the law whose keys are their parameters.
PARAMETER_FILES: Mapping[str, Mapping[str, type[parameters.FrictionLaw]]] = {
    PLANT_FILE: {
        "rotational": parameters.FrictionParameters,
        "asymmetric": parameters.AsymmetricFriction,
        "asymmetric_stribeck": parameters.AsymmetricFriction,
        "dahl": parameters.LuGreFriction,
        "lugre": parameters.LuGreFriction,
        "lugre_asymmetric": parameters.LuGreFriction,
    },
    COMPENSATOR_FILE: {"rotational": parameters.FrictionParameters},
}


def write_identification(
    result: Identification,
    target: Path,
    joint: JointName | None,
    *,
    force: bool = False,
    pictures: bool = True,
) -> dict[str, Any]:
    """Write everything into a folder that appears when all is written."""
    laws = {} if joint is None else _parameter_laws(result)
    document: dict[str, Any] = plain(_identification_document(result, joint))
    document["parameter_files"] = {file: model for file, (model, _) in laws.items()}
    with staged_directory(target, IDENTIFICATION, force=force) as staging:
        write_json(staging / DOCUMENT_FILE, document)
        write_atomically(staging / SAMPLES_FILE, _samples_csv(result))
        for file, (model, law) in laws.items():
            assert joint is not None  # without one there are no laws
            write_atomically(staging / file, _parameter_file(file, law, model, joint))
        if pictures:
            _draw(result, staging, joint)
    return document


def _draw(result: Identification, folder: Path, joint: JointName | None) -> None:
    figures = {"fits": draw_fits(result), "residuals": draw_residuals(result)}
    left_out = (f"left out: {run.left_out} [N m]" for run in result.models[0].validations)
    heads = ["model", "law", "RMSE [N m]", *left_out, "BIC"]
    rows = [
        (readable(item.name), item.fit.model.formula, f"{item.goodness.rmse:.3g}",
         *(f"{run.rmse:.3g}" for run in item.validations), f"{item.goodness.bic:.0f}")
        for item in result.models
    ]  # fmt: skip
    title = "Friction" if joint is None else f"Friction of the {joint}"
    write_figures_page(folder / REPORT_FILE, figures, title, "models best first", [heads, *rows])


def _identification_document(result: Identification, joint: JointName | None) -> dict[str, Any]:
    """The result as plain numbers, SI units in the keys."""
    options, best = result.options, result.models[0]
    order = f"rmse with {best.validations[0].left_out} left out" if math.isfinite(best.rank[0]) else "BIC"
    balance = any(test.from_bench for test in result.tests)
    usual = Processing.ZERO_PHASE if balance else Processing.NONE
    processing = replace(options.processing, processing=options.processing.processing or usual)
    bench = options.bench if balance else None
    return {
        "schema_version": SCHEMA_VERSION,
        "joint": joint,
        "models": [_model(item) for item in result.models],
        "skipped": result.skipped,
        "warnings": result.warnings,
        "method": {
            "order": order,
            **asdict(options.fit),
            "processing": section_of(ProcessingOptions).document(processing),
            "bench": None if bench is None else section_of(BenchSetup).document(bench),
        },
        "tests": [{"name": test.name, "mass_kg": test.mass, "samples": test.counts} for test in result.tests],
    }


def _model(item: IdentifiedModel) -> dict[str, Any]:
    known = item.uncertainty
    return {
        "name": item.name,
        "formula": item.fit.model.formula,
        "parameters": item.fit.model.parameters(item.fit.x),
        "intervals_95": known.intervals,
        "intervals_by": {"drawn": known.by, "blocks": known.blocks},
        "standard_errors_if_independent": known.standard_errors,
        **asdict(item.goodness),
        "cross_validation": [asdict(run) for run in item.validations],
        "loss": Loss.LINEAR if math.isinf(item.fit.threshold) else Loss.HUBER,
        "robust_sigma_Nm": item.fit.sigma,
        "warnings": item.warnings,
    }


def _samples_csv(result: Identification) -> str:
    """Samples that were fitted, and what the best model makes of them; at most 100 000 rows."""
    samples = result.samples.used_only()
    columns = {
        "test": np.array([test.name for test in result.tests])[samples.test],
        "time_s": samples.time,
        "angle_rad": samples.angle,
        "velocity_rad_per_s": samples.velocity,
        "load_torque_Nm": samples.load,
        "temperature_degC": samples.temperature,
        "friction_torque_Nm": samples.torque,
        "model_torque_Nm": samples.torque - result.models[0].residuals,
    }
    table = pd.DataFrame({name: values for name, values in columns.items() if values is not None})
    shown = table.iloc[:: -(-len(table) // _LISTED_SAMPLES)]
    return shown.to_csv(index=False, float_format="%.7g", lineterminator="\n")


def _parameter_laws(result: Identification) -> dict[str, tuple[str, parameters.FrictionLaw]]:
    """Model and law of each parameter file: the best that its reader knows and that takes no power back.

    The plant takes static laws and bristles, the compensator the firmware's law alone.
    """
    found: dict[str, tuple[str, parameters.FrictionLaw]] = {}
    for item in result.models:
        for file, entries in PARAMETER_FILES.items():
            if file not in found and item.name in entries:
                values = item.fit.model.parameters(item.fit.x)
                with contextlib.suppress(ValueError):  # pydantic's, of a law that would drive the joint
                    found[file] = (item.name, section_of(entries[item.name])(**values).convert())
    return found


def _parameter_file(file: str, law: parameters.FrictionLaw, model: str, joint: JointName) -> str:
    """An experiment with the law in the plant or in the compensator.

    The other joint keeps table 3.1 of the thesis. A plant that was measured has a friction ratio of 1.
    """
    found = {**BENCH_FRICTION, joint: law}
    laws = {str(name): section_of(type(item)).document(item) for name, item in found.items()}
    ratios = {str(name): 1.0 if name is joint else 0.5 for name in BENCH_FRICTION}
    section = {"plant": {"friction": laws, "friction_ratio": ratios}}
    if file == COMPENSATOR_FILE:
        section = {"control": {"friction_model": laws}}
    name = f"identified_{joint}_{Path(file).stem}"
    description = f"Friction of the {joint} by the model {model} of {DOCUMENT_FILE}."
    return dump_yaml({"preset": PRESET, "name": name, "description": description, **section})
