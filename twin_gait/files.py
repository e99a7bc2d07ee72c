"""Atomic writing of files, so that a reader never sees a partial file, and reading with limits of size."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import stat
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_gait.exceptions import ParameterFileError, RunDirectoryError

if TYPE_CHECKING:
    import pandas as pd

# The longest run, an hour, has 3.6 million rows; with braces some 600 million numbers, 5 GB.
MOST_ROWS, MOST_CELLS = 10_000_000, 700_000_000
MOST_TEXT, LONGEST_LINE = 2**30, 65_536  # largest size of a text log in bytes, and of its lines in characters
MOST_DOCUMENT = 2**26  # largest size of a URDF, DBC or JSON file in bytes; a summary has some thousands

# Kinds of files that are never read or replaced, by the format bits of their mode.
_SPECIAL = {
    stat.S_IFLNK: "a symbolic link", stat.S_IFIFO: "a FIFO (named pipe)", stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
}  # fmt: skip


def shipped_file(name: str) -> Path | None:
    """Return the path of a file of the folder ``urdf``, in the wheel or next to the package in a checkout.

    Args:
        name: Name of the file, such as ``twin.urdf``.

    Returns:
        The path, or None if there is no such file.
    """
    package = Path(__file__).parent
    paths = (package / "urdf" / name, package.parent / "urdf" / name)
    return next((path for path in paths if path.is_file()), None)


def require_regular(path: Path, most: int | None = None) -> None:
    """Raise ParameterFileError unless a path leads to a regular file of at most ``most`` bytes.

    A pipe or a device may block a reader, or never end. Raises OSError if there is no file.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        kind = _SPECIAL.get(stat.S_IFMT(status.st_mode), "a folder")
        raise ParameterFileError(path, "", f"cannot be read: it is {kind}; expected a regular file")
    if most is not None and status.st_size > most:
        problem = f"is larger than {most} bytes, the largest size read; check the path, or divide the file"
        raise ParameterFileError(path, "", problem)


def read_bytes(path: Path, most: int = MOST_DOCUMENT) -> bytes:
    """Return the content of a regular file; every file that a user names is read by this function.

    Args:
        most: Largest accepted size in bytes.

    Raises:
        ParameterFileError: If it is not a regular file, or larger.
        OSError: If it cannot be read.
    """
    require_regular(path, most)
    # Without O_NONBLOCK, a pipe that has replaced the file since the check would block.
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ParameterFileError(path, "", f"is larger than {most} bytes, the largest size that is read")
    return data


def read_text(path: Path, most: int = MOST_DOCUMENT, encoding: str = "utf-8") -> str:
    """Return the text of a regular file with line ends as in Unix; raise the errors of :func:`read_bytes`.

    Raises:
        UnicodeDecodeError: If it has another encoding.
    """
    return io.TextIOWrapper(io.BytesIO(read_bytes(path, most)), encoding=encoding).read()


def read_json(path: Path) -> Any:
    """Return the value of a JSON file; raise the errors of :func:`read_text`.

    Raises:
        ValueError: If it is not JSON, or nested too deeply.
    """
    try:
        return json.loads(read_text(path))
    except RecursionError as error:
        raise ValueError(f"{path.name} is nested too deeply") from error


def finite_or_none(value: float) -> float | None:
    """Convert a number to its value in JSON, which cannot represent infinite numbers and NaN.

    Returns:
        The number, or None if it is not finite.
    """
    return float(value) if math.isfinite(value) else None


def to_json_value(value: Any) -> Any:
    """Convert a value for JSON: numbers of NumPy to Python's, not finite ones to null, others to text."""
    if isinstance(value, float):
        return finite_or_none(value)
    if isinstance(value, bool | int) or value is None:
        return value
    if isinstance(value, Mapping):
        return {str(key): to_json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_json_value(item) for item in value]
    return to_json_value(value.item()) if hasattr(value, "item") else str(value)


def dump(data: Any) -> str:
    """Serialize a value as JSON on one line without spaces."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def apply_umask(mode: int) -> int:
    """Apply the user's umask to a mode, which temporary files and folders ignore.

    Args:
        mode: Mode of a file or a folder, such as ``0o644``.

    Returns:
        The mode without the bits of the mask.
    """
    mask = os.umask(0o077)
    os.umask(mask)
    return mode & ~mask


@contextlib.contextmanager
def private_files() -> Iterator[None]:
    """Create new files and folders, also those of processes started here, for the user alone."""
    mask = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(mask)


def check_replaceable(path: Path) -> None:
    """Check that a path does not exist or is a regular file or a folder.

    Raises:
        RunDirectoryError: If it is a symbolic link, a FIFO, a socket or a device.
    """
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        kind = _SPECIAL.get(stat.S_IFMT(path.lstat().st_mode))
        if kind is not None:
            raise RunDirectoryError(f"{path}: is {kind}, which is never replaced; give another name")


def write_atomically(path: str | Path, content: str | bytes) -> None:
    """Write a file through a temporary one in its folder; the data are on the disk when this returns.

    Args:
        content: Text (written as UTF-8) or bytes.

    Raises:
        RunDirectoryError: If it cannot be written, or replaces something other than a regular file.
    """
    path, data = Path(path), content.encode("utf-8") if isinstance(content, str) else content
    check_replaceable(path)
    try:
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise RunDirectoryError(f"{path}: cannot be written ({error.strerror})") from error
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())  # before the renaming, because a loss of power could leave an empty file
        os.chmod(name, apply_umask(0o644))
        os.replace(name, path)
        sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise RunDirectoryError(f"{path}: cannot be written ({error.strerror})") from error


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write a document atomically as JSON, with values converted by :func:`to_json_value`.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    text = json.dumps(to_json_value(document), indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(path, f"{text}\n")


def sync_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, if the file system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def write_new(paths: Iterable[Path], content: str) -> Path:
    """Write a file under the first name that does not exist yet; no file is overwritten.

    Args:
        content: Text (written as UTF-8).

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    for path in paths:
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
        except FileExistsError:
            continue
        except OSError as error:
            raise RunDirectoryError(f"{path}: cannot be written ({error.strerror})") from error
        write_atomically(path, content)
        return path
    raise RunDirectoryError("no temporary name is free")


def require_table_size(path: Path, rows: int, columns: int) -> None:
    """Reject a table that is larger than any log of a walk, before it fills the memory.

    Raises:
        ParameterFileError: If it is too large.
    """
    if rows > MOST_ROWS or rows * columns > MOST_CELLS:
        raise ParameterFileError(
            path,
            "",
            f"has {rows} rows of {columns} columns; at most {MOST_ROWS} rows and {MOST_CELLS} numbers are "
            "read; divide the file",
        )


def require_parquet(path: Path) -> None:
    """Raise ParameterFileError unless a parquet file is regular and has at most the size of a log.

    Raises pyarrow.ArrowException if it is not a parquet file, and OSError if it cannot be read.

    Raises pyarrow.ArrowException if it is no such file, and OSError if it cannot be read.
    """
    import pyarrow.parquet as pq

    require_regular(path)
    with pq.ParquetFile(path) as file:
        require_table_size(path, file.metadata.num_rows, file.metadata.num_columns)


def read_parquet(path: Path, columns: Collection[str] | None = None) -> pd.DataFrame:
    """Read a regular parquet file, unless it is larger than any log of a walk when unpacked.

    The columns are read one by one, because the whole table next to the frame would take twice the memory.

    Args:
        path: The file.
        columns: Names of the columns to read if the file has them; None for all.

    Raises:
        ParameterFileError: If it is not a regular file, or too large.
        pyarrow.ArrowException: If it is not a parquet file.
        OSError: If it cannot be read.
    """
    import numpy as np
    import pandas as pd
    import pyarrow.parquet as pq

    require_parquet(path)
    with pq.ParquetFile(path) as file:
        names = [name for name in file.schema_arrow.names if columns is None or name in columns]
        others = {}
        numbers = np.empty((len(names), file.metadata.num_rows))
        for index, name in enumerate(names):
            read = file.read([name])  # also reads columns whose names begin with this one
            column = read.column(read.column_names.index(name))
            if column.type == "double":
                numbers[index] = column.to_numpy()
            else:
                others[name] = column.to_pandas()
    return pd.DataFrame(numbers.T, columns=names, copy=False).assign(**others)


def write_parquet(path: Path, table: pd.DataFrame, **metadata: str) -> None:
    """Write a table atomically as parquet, compressed; ``metadata`` is stored under ``twin_gait.NAME``.

    Raises:
        RunDirectoryError: If it cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrow = pa.Table.from_pandas(table, preserve_index=False)
    named = {f"twin_gait.{name}": text for name, text in metadata.items()}
    arrow = arrow.replace_schema_metadata({**(arrow.schema.metadata or {}), **named})
    # A dictionary of the values of a column of numbers takes a third of the time and increases the file.
    repeating = [field.name for field in arrow.schema if field.type != "double"]
    buffer = io.BytesIO()
    pq.write_table(arrow, buffer, compression="zstd", use_dictionary=repeating)
    write_atomically(path, buffer.getvalue())
