"""Preparation of the scripts of ``examples/`` for sphinx-gallery.

A script there has Markdown in percent cells, begins with a sentence, and its full results are stored in git.
sphinx-gallery needs reStructuredText and a title, and shows the output of its own run. Therefore every script
is copied with a title, its stored figures above the code, and its headings in reStructuredText; its text is
unchanged.
"""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"

# Scripts by their heading in the gallery. A test checks that no script is missing.
SECTIONS = {
    "first_steps": ("First steps", ("first_gait", "change_the_table", "bench_leg")),
    "thesis": ("The thesis", ("thesis_friction", "thesis_control", "thesis_falls", "thesis_limits")),
    "what_if": (
        "What if",
        ("whatif_friction_map", "whatif_inertia", "whatif_temperature", "friction_presliding"),
    ),
    "people": ("People and devices", ("shipped_people", "cohort", "tuned_cohort", "device_walks")),
    "walk": (
        "The walk: goals, robustness, ground forces",
        (
            "limits_of_validity",
            "default_walk",
            "battery_account",
            "ground_forces",
            "robustness_map",
            "heavy_wearers",
            "start_stop",
            "attainable_floor",
        ),
    ),
    "controllers": ("Controllers compared", ("controllers", "train_policies", "blending", "powered_ankle")),
    "crutches": ("Crutches and chair", ("overground", "rising")),
    "faults": (
        "Faults, bus and the sampled loop",
        ("fault_campaign", "runaways", "supply_loss", "network_map", "can_monitor", "loop_stability"),
    ),
    "device": ("Firmware and proofs", ("firmware", "validation", "identification_coverage")),
}
# Scripts whose full form takes seconds and runs in the site; the site runs the quick form of the others.
IN_FULL = frozenset(
    {
        "first_gait", "change_the_table", "bench_leg", "thesis_control", "thesis_falls", "thesis_limits",
        "validation", "friction_presliding", "controllers", "ground_forces",
    }
)  # fmt: skip
# Scripts that the site cannot run: a bus needs multicast.
NOT_RUN = frozenset({"can_monitor"})
# Pictures from docs/images for scripts without figures.
THUMBNAILS = {
    "bench_leg": "bench_leg.png",
    "change_the_table": "gait_cycle.png",
    "shipped_people": "treadmill_phone.png",
    "cohort": "treadmill.png",
    "tuned_cohort": "tune.png",
    "device_walks": "treadmill.png",
    "default_walk": "gait_cycle.png",
    "start_stop": "live_phone.png",
    "firmware": "live.png",
    "validation": "treadmill_dark.png",
    "identification_coverage": "identification.png",
}
KEPT = """
.. admonition:: Results that are kept

   The figures below are those of the script's full form, kept in git. {ran}
"""
RAN_QUICK = "What it printed when this site was built is that of its quick form, ``--quick``."
RAN_NOT = "It was not run when this site was built."


def title_of(name: str, docstring: str) -> tuple[str, str]:
    """Split the docstring of a script into title and rest; the title ends at the first colon or stop."""
    first, _, rest = docstring.partition("\n\n")
    first = " ".join(first.split())
    head = re.split(r"(?<=\w)[:.?](?:\s|$)", first, maxsplit=1)[0]
    if len(head) > 70:
        head = name.replace("_", " ").capitalize()
        return head, f"{first}\n\n{rest}".strip()
    after = first[len(head) :]
    if after[:1] == "?":
        head, after = f"{head}?", after[1:]
    after = after.lstrip(":. ").strip()
    return head, f"{after[:1].upper()}{after[1:]}\n\n{rest}".strip()


def _figures(name: str) -> list[Path]:
    return sorted((EXAMPLES / "results" / name).glob("*.png"))


def _in_the_other_markup(code: str) -> str:
    """Return code with the headings of its Markdown cells in reStructuredText."""

    def heading(match: re.Match[str]) -> str:
        text = match.group(1)
        return f"# {text}\n# {'-' * len(text)}\n#"

    code = re.sub(r"^# ## (.*)$", heading, code, flags=re.MULTILINE)
    return re.sub(r"^# %% \[markdown\]$", "# %%", code, flags=re.MULTILINE)


def prepared(path: Path, *, run: bool) -> str:
    """Return the text of a script in the form that sphinx-gallery needs.

    Args:
        path: Path of the script.
        run: Whether the site runs its scripts.
    """
    text = path.read_text(encoding="utf-8")
    module = ast.parse(text)
    docstring = ast.get_docstring(module) or ""
    title, rest = title_of(path.stem, docstring)
    end = module.body[0].end_lineno or 1
    code = _in_the_other_markup("\n".join(text.splitlines()[end:]))
    figures = _figures(path.stem)
    header = [title, "=" * len(title), "", *_linked(rest).splitlines()]
    ran = run and path.stem not in NOT_RUN
    if figures and not (ran and path.stem in IN_FULL):
        header += KEPT.format(ran=RAN_QUICK if ran else RAN_NOT).splitlines()
    for figure in figures:
        # Paths are relative to docs/gallery/SECTION, into which sphinx-gallery writes.
        header += [
            "",
            f".. image:: /../examples/results/{path.stem}/{figure.name}",
            f"   :alt: {title}, {figure.stem}",
        ]
    picture = (
        f"../examples/results/{path.stem}/{figures[0].name}" if figures else f"images/{THUMBNAILS[path.stem]}"
    )
    thumbnail = f"# sphinx_gallery_thumbnail_path = '{picture}'\n"
    lines = "\n".join(header).replace("\\", "\\\\")
    return f'"""\n{lines}\n"""\n{code}\n\n{thumbnail}'


def _linked(text: str) -> str:
    """Replace the paths of pages in a docstring by links."""
    return re.sub(r"docs/((?:background|reference)/\w+)\.md", r":doc:`/\1`", text)


def prepare(folder: Path, *, run: bool) -> None:
    """Write the scripts of all sections into a folder; unchanged files keep their time of modification."""
    current = set()
    for order, (section, (heading, names)) in enumerate(SECTIONS.items()):
        target = folder / f"{order}_{section}"
        target.mkdir(parents=True, exist_ok=True)
        files = {"GALLERY_HEADER.rst": f"{heading}\n{'-' * len(heading)}\n"}
        files |= {f"{name}.py": prepared(EXAMPLES / f"{name}.py", run=run) for name in names}
        # Data files that scripts read from their folder.
        files |= {data.name: data.read_text(encoding="utf-8") for data in EXAMPLES.glob("*.yaml")}
        for name, text in files.items():
            path = target / name
            current.add(path)
            if not path.is_file() or path.read_text(encoding="utf-8") != text:
                path.write_text(text, encoding="utf-8")
    for path in folder.rglob("*"):
        if path.is_file() and path.parent != folder and path not in current:
            path.unlink()
    shutil.copy(Path(__file__).parents[1] / "gallery_header.rst", folder / "GALLERY_HEADER.rst")
