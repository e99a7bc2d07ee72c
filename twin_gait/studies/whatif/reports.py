"""What each study has to say: its figure, its tables, and paragraphs computed from them."""

from __future__ import annotations

from collections.abc import Callable

from twin_gait.report.whatif_friction import draw_friction_map
from twin_gait.report.whatif_inertia import draw_inertia
from twin_gait.report.whatif_temperature import draw_temperature
from twin_gait.studies.whatif.friction_map import study_friction_map
from twin_gait.studies.whatif.friction_words import friction_text
from twin_gait.studies.whatif.inertia import study_inertia
from twin_gait.studies.whatif.inertia_words import inertia_text
from twin_gait.studies.whatif.page import Report
from twin_gait.studies.whatif.temperature import study_temperature
from twin_gait.studies.whatif.temperature_words import temperature_text
from twin_gait.studies.whatif.work import Means


def report_on(study: str, means: Means, *, quick: bool = False) -> Report:
    """Run a study and report on it.

    Args:
        study: ``friction-map``, ``temperature`` or ``inertia``.
        means: Processes, progress, interruption.
        quick: A small part of each grid.

    Returns:
        The report.

    Raises:
        Interrupted: If it was stopped.
    """
    return REPORTS[study](means, quick)


def _friction_map(means: Means, quick: bool) -> Report:
    found = study_friction_map(means, quick=quick)
    return Report(
        name="friction_map",
        title="What if the friction model is too strong?",
        text=friction_text(found),
        tables={
            "friction_map": found.map,
            "friction_map_limits": found.thresholds,
            "friction_map_prices": found.prices,
        },
        figure=draw_friction_map(found.map, found.thresholds, found.prices),
    )


def _temperature(means: Means, quick: bool) -> Report:
    found = study_temperature(means, quick=quick)
    return Report(
        name="temperature",
        title="What if the friction changes with temperature, age or load?",
        text=temperature_text(found),
        tables={"temperature": found.cases, "temperature_best": found.best},
        figure=draw_temperature(found.cases, found.best),
    )


def _inertia(means: Means, quick: bool) -> Report:
    found = study_inertia(means, quick=quick)
    return Report(
        name="inertia",
        title="What if the inertia is compensated too?",
        text=inertia_text(found),
        tables={
            "inertia": found.stability,
            "inertia_limits": found.limits,
            "inertia_noise": found.noise,
        },
        figure=draw_inertia(found.stability, found.limits, found.noise),
    )


REPORTS: dict[str, Callable[[Means, bool], Report]] = {
    "friction-map": _friction_map,
    "temperature": _temperature,
    "inertia": _inertia,
}
