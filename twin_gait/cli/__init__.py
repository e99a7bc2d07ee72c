"""Command line: the only package that prints, shows progress and sets the exit status."""

from twin_gait.cli.program import main

__all__ = ["main"]
