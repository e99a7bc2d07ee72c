"""The command line: the only place that prints, draws progress and decides the exit status."""

from twin_gait.cli.program import main

__all__ = ["main"]
