"""Writer of a page for every public package with the names in its ``__all__`` and their docstrings."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import twin_gait

# Public names besides those of ``twin_gait`` itself, by the module that defines them.
PUBLIC: dict[str, tuple[str, ...]] = {
    "twin_gait.checking.hanging_leg": ("friction_slope", "linear_loops"),
    "twin_gait.checking.linear_loop": ("LinearLoop", "spectral_radius", "transition_matrix"),
    "twin_gait.checking.network": ("traffic_of",),
    "twin_gait.configuration.bench_device": ("BENCH_ACTUATORS", "BENCH_FRICTION", "bench_joint"),
    "twin_gait.configuration.device_file": ("load_device",),
    "twin_gait.configuration.documents": ("dump_yaml",),
    "twin_gait.configuration.experiments": ("list_patients",),
    "twin_gait.configuration.gait_table_file": ("load_mode_table",),
    "twin_gait.control.controller": ("Controller", "Plan"),
    "twin_gait.control.safety": ("Trip", "TripCause"),
    "twin_gait.core.friction": ("friction_torque", "rotational_friction_torque", "steady_deflection"),
    "twin_gait.core.plant": ("Plant",),
    "twin_gait.firmware.verification": ("verify",),
    "twin_gait.gait.table": ("TICK", "BlendingLaw", "JointImpedance", "PhaseParameters"),
    "twin_gait.identification.identify": ("IdentificationOptions", "identify_tests"),
    "twin_gait.identification.processing": ("BenchSetup", "Processing", "process_log"),
    "twin_gait.identification.reading": ("Log", "Quantity", "read_log"),
    "twin_gait.leg_model.urdf": ("packaged_urdf",),
    "twin_gait.measures.effort": ("energy_balance",),
    "twin_gait.measures.foot_contact": ("CONTACT_FORCE",),
    "twin_gait.measures.leg_record": ("leg_record",),
    "twin_gait.measures.phases": ("usual_phases",),
    "twin_gait.measures.reference": ("normative_moment", "reference_curve"),
    "twin_gait.measures.strides": ("PERCENT", "normalise_strides"),
    "twin_gait.palette": (
        "BLACK", "BLUE", "BLUISH_GREEN", "EVENT_COLOUR", "GREY", "JOINT_COLOURS", "ORANGE", "REDDISH_PURPLE",
        "VERMILLION",
    ),
    "twin_gait.parameters.friction": (
        "FrictionLaw", "FrictionParameters", "LuGreFriction",
    ),
    "twin_gait.parameters.quantities": ("NOT_NEGATIVE", "Key", "RotaryDamping"),
    "twin_gait.parameters.ranges": ("require",),
    "twin_gait.replay.machine": ("replay_log",),
    "twin_gait.replay.recording": ("read_recording",),
    "twin_gait.report.canvas": ("put_legend", "save", "style_panel"),
    "twin_gait.report.state_diagram": ("name_to_words",),
    "twin_gait.simulation.bench_joint.loop": ("BenchRun", "simulate_bench"),
    "twin_gait.simulation.binding": ("specialize",),
    "twin_gait.simulation.simulation_setup": ("SimulationSetup", "build_setup"),
    "twin_gait.simulation.stages.motion": ("compute_accelerations",),
    "twin_gait.studies.batch": ("override_experiment", "run_episodes"),
    "twin_gait.studies.campaign": ("TWO_WAY_SPEEDS", "Campaign", "Protocol", "planned_tests"),
    "twin_gait.studies.fault_campaign": ("draw_faults", "outcome_table", "simulate_faults"),
    "twin_gait.studies.jobs": ("run_jobs",),
    "twin_gait.studies.sweep.spec": ("load_sweep",),
    "twin_gait.studies.sweep.sweep": ("run_sweep",),
    "twin_gait.studies.workers": ("Workers",),
    "twin_gait.testing.cases": ("transition_tests",),
    "twin_gait.vocabulary": ("PelvisGuide",),
    "twin_gait.worlds.bench_control": ("TorqueControl",),
    "twin_gait.worlds.bench_joint": ("BenchJoint", "LinkParameters"),
    "twin_gait.worlds.bench_leg": ("BenchLeg", "ImposedMotionParameters"),
    "twin_gait.worlds.faults": ("Fault", "FaultKind"),
    "twin_gait.worlds.world": ("Posture", "Scenario", "World", "start_posture"),
}  # fmt: skip


def summary_of(module: str) -> str:
    """Return the first line of the docstring of a module."""
    return (importlib.import_module(module).__doc__ or "").strip().splitlines()[0]


def constants(module: str) -> list[str]:
    """Return the public names of a module that are neither classes nor functions."""
    found = importlib.import_module(module)
    values = {name: getattr(found, name) for name in PUBLIC[module]}
    return [
        name for name, value in values.items() if not (inspect.isclass(value) or inspect.isroutine(value))
    ]


def _assignments(module: str) -> Iterator[tuple[str, list[str], int, int]]:
    """Yield the names assigned in a module, the lines of the file, and first and last line of each."""
    text = Path(importlib.import_module(module).__file__ or "").read_text(encoding="utf-8")
    for node in ast.parse(text).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for name in (item for target in targets if target for item in ast.walk(target)):
            if isinstance(name, ast.Name):
                yield name.id, text.splitlines(), node.lineno, node.end_lineno or node.lineno


def meanings(module: str) -> dict[str, str]:
    """Return the comment next to or above the assignment of each public constant of a module, by name."""
    names_of_constants, found = set(constants(module)), {}
    for name, lines, first, last in _assignments(module):
        if name not in names_of_constants:
            continue
        above: list[str] = []
        while (line := lines[first - 2 - len(above)]).startswith("#"):
            above.insert(0, line.lstrip("# "))
        behind = [part for line in lines[first - 1 : last] for part in re.findall(r"  # (.*)", line)][:1]
        found[name] = " ".join([*above, *behind])
    return found


def constants_of(module: str) -> list[str]:
    """Return the table of the public constants of a module as lines."""
    comments, values = meanings(module), importlib.import_module(module)
    rows = []
    for name in constants(module):
        value = repr(getattr(values, name))
        value = f"``{value}``" if len(value) <= 40 else ""
        rows.append([f"``{name}``", value, comments.get(name, "").replace("`", "")])
    if not rows:
        return []
    cells = ["   * - " + "\n     - ".join(row) for row in (["constant", "value", "meaning"], *rows)]
    return ["```{eval-rst}", ".. list-table::", "   :header-rows: 1", "", *cells, "```", ""]


def part_of(module: str) -> str:
    """Return the package below ``twin_gait`` that a module belongs to, or the module itself."""
    return module.split(".")[1]


def section_of(module: str) -> list[str]:
    """Return the section of a module in MyST: its docstring, and its public names."""
    described = [name for name in PUBLIC[module] if name not in constants(module)]
    lines = [f"## `{module}`", "", "```{eval-rst}", f".. automodule:: {module}"]
    if described:
        lines.append(f"   :members: {', '.join(described)}")
    return [*lines, "```", "", *constants_of(module)]


def prepare(folder: Path) -> None:
    """Write the pages; unchanged files keep their time of modification."""
    folder.mkdir(parents=True, exist_ok=True)
    top = ["# `twin_gait`", "", "```{eval-rst}", ".. automodule:: twin_gait", "   :members:"]
    top += ["   :imported-members:", "   :exclude-members: __version__", "```", ""]
    pages = {"twin_gait.md": "\n".join(top)}
    rows = [
        "| module | public names |",
        "|---|---|",
        f"| [twin_gait](twin_gait.md) | {', '.join(f'`{name}`' for name in sorted(twin_gait.__all__))} |",
    ]
    parts = list(dict.fromkeys(map(part_of, PUBLIC)))
    for part in parts:
        modules = [module for module in PUBLIC if part_of(module) == part]
        lines = [f"# `twin_gait.{part}`", "", summary_of(f"twin_gait.{part}"), ""]
        pages[f"{part}.md"] = "\n".join([*lines, *chain.from_iterable(map(section_of, modules))])
        for module in modules:
            rows.append(f"| [{module}]({part}.md) | {', '.join(f'`{name}`' for name in PUBLIC[module])} |")
    tree = "\n".join(["```{toctree}", ":hidden:", "", "twin_gait", *parts, "```"])
    text = "These names are public; everything else may change without notice."
    pages["index.md"] = "\n".join(["# API", "", text, "", *rows, "", tree, ""])
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
