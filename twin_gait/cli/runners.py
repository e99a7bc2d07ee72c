"""Who executes the runs of a command: ``--workers`` of this machine, or those of a ``--scheduler``."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin_gait.studies.jobs import Workers


PROCESSORS = os.cpu_count() or 1


def add_workers(parser: argparse.ArgumentParser, default: int | str = PROCESSORS) -> None:
    """Add ``--workers`` to a command; :func:`workers_of` reads it.

    Args:
        parser: Of the command.
        default: How many there are without the flag, for the help.
    """
    parser.add_argument("--workers", type=int, metavar="N", help=f"processes of this machine ({default})")


def add_runner(parser: argparse.ArgumentParser) -> None:
    """Add ``--workers`` and ``--scheduler`` to a command; :func:`runner_of` reads them.

    Args:
        parser: Of the command.
    """
    add_workers(parser)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler, such as tcp://127.0.0.1:8786")


def workers_of(arguments: argparse.Namespace, default: int = PROCESSORS) -> int:
    """How many processes the user wants.

    Args:
        arguments: Of the command.
        default: How many without the flag.

    Returns:
        Their number.

    Raises:
        ParameterError: If it is below 1.
    """
    from twin_gait.parameters import require

    workers: int | None = arguments.workers
    if workers is None:
        return default
    require(workers >= 1, "--workers", "1 or more", workers)
    return workers


def check_runner(arguments: argparse.Namespace) -> None:
    """Refuse flags that name no runner, before anything is read or started.

    Args:
        arguments: Of the command.

    Raises:
        ParameterError: If the workers are below 1, or go with a scheduler.
    """
    from twin_gait.exceptions import ParameterError

    if arguments.workers is not None and arguments.scheduler is not None:
        raise ParameterError("--workers: does not go with --scheduler, which has workers of its own")
    workers_of(arguments)


@contextlib.contextmanager
def runner_of(arguments: argparse.Namespace) -> Iterator[Workers]:
    """The processes of this machine or the cluster that the user asked for.

    Args:
        arguments: Of the command.

    Yields:
        The workers; processes end with the context.

    Raises:
        ParameterError: If there is no scheduler at the address.
        MissingOptionalDependency: If a cluster is asked for and dask.distributed is not installed.
    """
    from twin_gait.studies.jobs import Workers

    with Workers(workers_of(arguments), arguments.scheduler) as workers:
        yield workers
