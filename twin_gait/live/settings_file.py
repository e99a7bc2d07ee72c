"""Experiment files of a live session: the walked one, and the settings for the next session."""

import itertools
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from twin_gait.configuration.custom_sections import section_of
from twin_gait.configuration.documents import table_document
from twin_gait.configuration.events import changed_keys
from twin_gait.configuration.experiments import LoadedExperiment, experiment_from_mapping
from twin_gait.configuration.validation import assign
from twin_gait.parameters.quantities import require
from twin_gait.parameters.wearer import PLAIN_NAME, is_plain_name
from twin_gait.simulation.settings import Settings


def settings_document(
    opened: Mapping[str, Any], before: Settings, settings: Settings, patient: str, now: datetime
) -> dict[str, Any]:
    """Return the experiment file that starts the next session with the settings of this one.

    The controls of the monitor are no part of an experiment and are left out.

    ``opened``: experiment file of this session; ``before``: its settings at the start; ``settings``: present
    settings; ``patient``: name of the person; ``now``: present time, whose date is part of the names. Raises
    ParameterError if the name cannot be that of a person.
    """
    require(is_plain_name(patient), "patient", PLAIN_NAME, patient)
    document = {key: value for key, value in opened.items() if key != "duration_s"}
    for key, value in changed_keys(before, settings).items():
        if not key.startswith(("monitor.", "table.")):
            document = assign(document, key.split("."), value)
    if document.get("patient") is not None:
        document = assign(document, ["patient", "name"], patient)
    document["table"] = {**table_document(settings.table), "name": f"{patient}_{now:%Y-%m-%d}"}
    description = f"Settings of {patient}, saved by twin-gait live on {now:%Y-%m-%d at %H:%M}."
    first = {"schema_version": document["schema_version"], "name": patient, "description": description}
    document = {**first, "patient": document.get("patient"), **{**document, **first}}
    experiment_from_mapping(document, "settings", Path())
    return document


def choose_step(loaded: LoadedExperiment) -> LoadedExperiment:
    """Return an experiment with a default step that is stable at every setting of its adjustments.

    An experiment with an integration of its own is returned as it is.
    """
    experiment, scenario = loaded.experiment, loaded.experiment.scenario
    if experiment.integration is not None:
        return loaded
    step = experiment.resolved_integration.step
    for values in itertools.product(*((item.minimum, item.maximum) for item in scenario.adjustments)):
        changed = scenario
        for item, value in zip(scenario.adjustments, values, strict=True):
            changed = changed.replace_adjustment(item.name, value * item.scale)
        step = min(step, changed.step)
    integration = replace(experiment.resolved_integration, step=step)
    section = section_of(type(integration)).document(integration)
    return replace(
        loaded,
        experiment=replace(experiment, integration=integration),
        document={**loaded.document, "integration": section},
    )
