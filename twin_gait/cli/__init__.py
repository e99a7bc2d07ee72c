"""The command line: the only place that prints, draws progress and decides the exit status."""

from twin_gait.cli.main import main

__all__ = ["main"]
