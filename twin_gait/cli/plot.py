"""``twin-gait plot``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from twin_gait.cli.options import check_file
from twin_gait.cli.terminal import DONE

FORMATS = ("pdf", "svg", "png")
RESOLUTION = 600  # [dots per inch], what journals ask of pictures with lines and letters


def add_parser(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "plot",
        help="draw a run for a paper",
        description=(
            "Draw figures of a run directory for print: one or two columns wide, letters on the panels, no "
            "title inside; what the title would say is printed, for the caption."
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="run directory")
    parser.add_argument(
        "--figure",
        action="append",
        metavar="NAME",
        dest="figures",
        help="gait_cycle, torques, …; may be repeated (all that the run has)",
    )
    parser.add_argument("--format", choices=FORMATS, help="format (that of --out's name, or else pdf)")
    parser.add_argument(
        "--width", type=float, default=85.0, metavar="MM", help="85 for one column (the default), 174 for two"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="file, of one figure (RUN/figures/NAME-WIDTHmm.FORMAT)"
    )
    parser.add_argument("--force", action="store_true", help="replace existing files")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draw the figures."""
    from twin_gait.exceptions import ParameterError
    from twin_gait.report.canvas import save
    from twin_gait.report.figures import available_figures, draw_for_paper
    from twin_gait.runs.record import FIGURES_FOLDER, load_run

    run_shown = load_run(arguments.directory).run
    names = arguments.figures or available_figures(run_shown)
    if arguments.out is not None and len(names) != 1:
        raise ParameterError(f"--out: takes one figure; name it with --figure, of {', '.join(names)}")
    drawn = {name: draw_for_paper(run_shown, name, arguments.width) for name in names}
    suffix, folder = _format_of(arguments), arguments.directory / FIGURES_FOLDER
    paths = {name: arguments.out or folder / f"{name}-{arguments.width:g}mm.{suffix}" for name in names}
    if arguments.out is None:
        folder.mkdir(exist_ok=True)
    for path in paths.values():
        check_file("--out", path, force=arguments.force)
    for name, (figure, caption) in drawn.items():
        save(figure, paths[name], form=suffix, resolution=RESOLUTION)
        print(f"{paths[name]}\n  {caption}")
    return DONE


def _format_of(arguments: argparse.Namespace) -> str:
    suffix = "" if arguments.out is None else arguments.out.suffix[1:]
    return str(arguments.format or (suffix if suffix in FORMATS else FORMATS[0]))
