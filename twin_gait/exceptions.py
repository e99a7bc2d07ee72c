"""All exceptions that twin_gait raises on purpose.

Each message is one line: the accepted values, the given value, and the remedy. The command line prints this
line of a :class:`TwinGaitError` and returns an exit status; users of the library catch the base class.
"""

from pathlib import Path


class TwinGaitError(Exception):
    """Base class of all errors of this package."""


class ParameterError(TwinGaitError, ValueError):
    """A parameter is out of its range or inconsistent with another."""


class MissingParameterError(ParameterError):
    """A parameter without a default is not given; ``key`` is its key in a section of a file."""

    def __init__(self, key: str) -> None:
        """Compose the message from the key."""
        self.key = key
        super().__init__(f"{key}: is missing")


class ParameterFileError(TwinGaitError):
    """A file that a user wrote has a wrong key or value.

    Attributes:
        file: The file that was read.
        key: Path of the key inside the file, for example ``phases.late_stance.hip``.
        problem: Description of the mistake.
    """

    def __init__(self, file: Path | str, key: str, problem: str) -> None:
        """Compose the message ``file: key: problem``."""
        self.file = str(file)
        self.key = key
        # Keys, phases and causes come from the file and may contain line breaks; a message is one line.
        where, text = " ".join(key.split()), " ".join(problem.split())
        self.problem = text
        location = f"{self.file}: {where}" if where else self.file
        super().__init__(f"{location}: {text}")


class MissingKeyError(ParameterFileError):
    """A file lacks a key that has no default."""

    def __init__(self, file: Path | str, key: str, advice: str = "") -> None:
        """Compose the message ``file: key: is missing``, with an advice."""
        super().__init__(file, key, f"is missing{advice}")


class ModelError(TwinGaitError):
    """A URDF cannot be read, or lacks a requested joint or link."""


class GaitTableError(TwinGaitError, ValueError):
    """A gait table contradicts itself: unknown phase, transition to nowhere, wrong guard."""


class MeasurementError(TwinGaitError, ValueError):
    """A measurement for the state machine is missing or not finite."""


class RunDirectoryError(TwinGaitError):
    """A run directory cannot be created, read or written."""


class JobError(TwinGaitError):
    """A job of several failed: ``index`` of its item, and ``problem``, the message of the original error."""

    def __init__(self, index: int, problem: str) -> None:
        """Compose the message from index and problem."""
        self.index, self.problem = index, problem
        super().__init__(f"job {index}: {problem}")


class ViewerError(TwinGaitError):
    """The viewer or its server could not be started."""


class FirmwareError(TwinGaitError):
    """The controller as C cannot be printed, built or run."""


class MissingToolError(FirmwareError):
    """A compiler or an emulator is not installed."""


class MissingOptionalDependency(TwinGaitError, ImportError):
    """An extra that a feature needs is not installed."""

    def __init__(self, package: str, extra: str, feature: str) -> None:
        """Compose the message that names the feature, the package and the install command."""
        super().__init__(
            f"{feature} needs {package}, which is not installed: pip install 'twin-gait[{extra}]'"
        )
