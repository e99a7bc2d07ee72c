"""The check of a gait table: setup of the case, list of all rules, and report of the findings."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from twin_gait.checking import exits, graph, network, published_ranges, stability, stuck_phases, torques
from twin_gait.checking.finding import CheckCase, Finding, Rule, Severity, invalid_waiver, waive
from twin_gait.checking.signals import ANY_ANGLE, JOINT_RANGES
from twin_gait.configuration.experiments import DEFAULT_PRESET, load_experiment, presets
from twin_gait.configuration.gait_table_file import load_state_table, packaged_gait_tables
from twin_gait.docstrings import summary_of
from twin_gait.experiment.experiment import Experiment
from twin_gait.gait.modes import ModeTable
from twin_gait.gait.signals import HIGHEST_VELOCITY, TRUNK_PITCH, signal_part
from twin_gait.gait.table import GaitTable, StateTable
from twin_gait.simulation.simulation_setup import SimulationSetup, scaled_table, start_phase
from twin_gait.vocabulary import JointName
from twin_gait.worlds.world import World

_MODULES = (graph, exits, stuck_phases, torques, stability, published_ranges, network)
RULES: tuple[Rule, ...] = tuple(rule for module in _MODULES for rule in module.RULES)
MODE_RULES: tuple[Rule, ...] = (*graph.MODE_RULES, *exits.RULES)  # rules for tables of modes
NOTES: tuple[Rule, ...] = (stability.stability_margin,)  # rules whose findings are all notes
REPORT_VERSION = 2
TRUNK = signal_part(TRUNK_PITCH.name)


def rules() -> dict[str, str]:
    """Return the ids of all rules, each with one line on the mistake that it finds."""
    everything: tuple[Callable[..., Any], ...] = (*RULES, *MODE_RULES, invalid_waiver)
    return {rule.__name__: summary_of(rule) for rule in everything}


def load_case(
    source: str | Path | None, experiment: str | Path | None = None, settings: Sequence[str] = ()
) -> CheckCase:
    """Load a table and the experiment against which it is checked.

    Args:
        source: Name of a packaged table of gait or of modes, or path of a table file. None checks the
            experiment's own gait table; so does the name of a preset if no table has this name. A table of
            modes is checked without an experiment.
        experiment: Preset, or path of an experiment file or run directory. Without it, a table for the joints
            of the preset with the same name (or of the default preset) is checked against that preset, and a
            table for other joints is checked without an experiment.
        settings: Values that override those of the experiment, as in
            :func:`~twin_gait.configuration.experiments.load_experiment`.

    Returns:
        The case.

    Raises:
        TwinGaitError: If a file has a mistake, or the experiment cannot drive the joints of the table.
    """
    if experiment is None and source in presets() and source not in packaged_gait_tables():
        source, experiment = None, source
    table = None if source is None else load_state_table(source)
    if isinstance(table, ModeTable):
        return build_case(table)
    preset = table.name if table is not None and table.name in presets() else DEFAULT_PRESET
    loaded = load_experiment(experiment or preset, settings).experiment
    if table is None:
        table = loaded.table
    elif experiment is None:  # the phases in which the legs start are not given
        loaded = replace(loaded, scenario=loaded.scenario.replace_unknown_phases(table.phase_names))
    drives = experiment is not None or set(table.joints) == set(loaded.table.joints)
    return build_case(table, loaded if drives else None)


def build_case(
    table: StateTable, experiment: Experiment | None = None, setup: SimulationSetup | None = None
) -> CheckCase:
    """Build the case of a check.

    ``experiment``: the experiment that the table drives; its own table is replaced by ``table``. If it is
    None, the table is checked without an experiment. ``setup``: the simulation setup of the experiment with
    this table, if it exists already. Returns the table, scaled to the experiment, and the limits of its
    joints: the limits of the URDF, or the normal ranges of human joints if there is no experiment.
    """
    if experiment is None or not isinstance(table, GaitTable):
        limits = {part: JOINT_RANGES.get(part, ANY_ANGLE) for part in (*table.joints, TRUNK)}
        return CheckCase(table=table, experiment=None, limits=limits)
    driving = replace(experiment, table=table)
    world = driving.build_world() if setup is None else setup.world
    return CheckCase(
        table=scaled_table(driving, world) if setup is None else setup.table,
        experiment=driving,
        limits={TRUNK: _pitches(world)}
        | {joint: _angles(driving, world, JointName(joint)) for joint in table.joints},
        velocity_limits={joint: _velocity(driving, world, JointName(joint)) for joint in table.joints},
        first_phases=tuple(
            table.phase_names[start_phase(table, world.initial_phases[side])] for side in driving.sides
        ),
        built_setup=setup,
    )


def _angles(experiment: Experiment, world: World, joint: JointName) -> tuple[float, float]:
    """Return the range of a joint over both sides in [rad]; a continuous joint is limited to one turn."""
    control, model = experiment.control, world.model
    limits = [control.joint_range(model, side, joint) for side in model.sides]
    lowest, highest = min(low for low, _ in limits), max(high for _, high in limits)
    return max(lowest, ANY_ANGLE[0]), min(highest, ANY_ANGLE[1])


def _pitches(world: World) -> tuple[float, float]:
    """Return the range of the trunk's pitch in [rad]: zero on a guided pelvis, else up to the fall pitch."""
    largest = 0.0 if world.model.pitch_index is None else min(world.fall_pitch, ANY_ANGLE[1])
    return -largest, largest


def _velocity(experiment: Experiment, world: World, joint: JointName) -> float:
    """Return the highest speed of a joint over both sides in [rad/s], if device or URDF state one."""
    model = world.model
    highest = max(experiment.control.highest_speed(model, side, joint) for side in model.sides)
    return highest if math.isfinite(highest) else HIGHEST_VELOCITY


def check(case: CheckCase, chosen: Sequence[Rule] | None = None) -> list[Finding]:
    """Check a table by the chosen rules, or by all rules for its kind.

    Returns the findings, the most severe ones first, then in the order of the phases.
    """
    if chosen is None:
        chosen = MODE_RULES if isinstance(case.table, ModeTable) else RULES
    found = [*invalid_waiver(case, rules()), *(finding for rule in chosen for finding in rule(case))]
    waived = (waive(case.table, finding) for finding in found)
    return sorted(waived, key=lambda finding: _order(case.table, finding))


def check_before_run(experiment: Experiment) -> list[Finding]:
    """Check the gait table of an experiment, and its modes, before a run.

    Returns the errors and the warnings that are not waived; notes are left out.
    """
    chosen = [rule for rule in RULES if rule not in NOTES]
    findings = check(build_case(experiment.table, experiment), chosen)
    if experiment.modes is not None:
        findings += check(build_case(experiment.modes))
    return [item for item in findings if item.severity is not Severity.NOTE and not item.waived]


def _order(table: StateTable, finding: Finding) -> tuple[int, bool, int]:
    names = table.phase_names
    phase = names.index(finding.phase) if finding.phase in names else len(names)
    return list(Severity).index(finding.severity), bool(finding.waived), phase


def counts(findings: Sequence[Finding]) -> dict[str, int]:
    """Count the findings of each severity; waived findings are counted separately."""
    live = [finding.severity for finding in findings if not finding.waived]
    found = {f"{severity}s": live.count(severity) for severity in Severity}
    return {**found, "waived": len(findings) - len(live)}


def report(case: CheckCase, findings: Sequence[Finding]) -> dict[str, Any]:
    """Convert the findings to a mapping for JSON; a schema version only ever gets additional keys."""
    return {
        "schema_version": REPORT_VERSION,
        "table": case.table.name,
        "experiment": None if case.experiment is None else case.experiment.name,
        "counts": counts(findings),
        "findings": [asdict(finding) | {"waived": finding.waived or None} for finding in findings],
    }
