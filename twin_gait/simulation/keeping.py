"""Where compiled code is kept, and under which key.

Whatever is compiled is kept under a hash over every source that it depends on: the generated text, all of
core, the loop, the versions of numba, llvmlite, numpy and Python, and the processor. An edit of any of them
is used by the next run. Nothing here needs the compiler.
"""

from __future__ import annotations

import atexit
import hashlib
import importlib.util
import os
import platform
import shutil
import tempfile
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from llvmlite import binding

from twin_gait import core

CACHE_VARIABLE = "TWIN_GAIT_CACHE"
CORE_MODULES = (
    "articulated_body",
    "actuator",
    "assistance",
    "belt",
    "blending",
    "contact",
    "control_tick",
    "dead_zone",
    "estimation",
    "faults",
    "friction",
    "friction_models",
    "guards",
    "hyperbolic",
    "impedance",
    "inertial",
    "integrators",
    "motor_drive",
    "plant",
    "safety",
    "wearer",
)
# Modules of this package that a compiled loop is made of or made by, beside core.
LOOP_MODULES = ("columns", "compiling", "episode_arrays", "flattening", "module_text", "pointers")
# The loop itself.
EPISODE_ROOMS = (
    "tick",
    "surroundings",
    "sensors",
    "monitor",
    "phases",
    "path",
    "motors",
    "wearer",
    "motion",
    "record",
)
_PACKAGE = __name__.rpartition(".")[0]


def cache_folder() -> Path:
    """Folder of the compiled code: ``$TWIN_GAIT_CACHE``, or twin_gait in the user's cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "twin_gait"


def usable_folder(wanted: Path) -> Path:
    """The wanted folder, made if needed, or a private temporary one where it cannot be written.

    The temporary one lasts as long as the process: compiled code is not kept where others could write.

    Args:
        wanted: From :func:`cache_folder`.

    Returns:
        A folder that can be written.
    """
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        if os.access(wanted, os.W_OK):
            return wanted
    except OSError:
        pass
    return _private_folder()


@lru_cache(maxsize=1)
def _private_folder() -> Path:
    folder = tempfile.mkdtemp(prefix="twin_gait_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@lru_cache(maxsize=8)
def source_key(what: str) -> str:
    """Hash over what is compiled and every source, package and processor that it depends on.

    Args:
        what: Text that tells one compiled loop from another.

    Returns:
        The hash; the sources are read once in a process, so that an edit during a long batch changes nothing.
    """
    digest = hashlib.sha256(what.encode())
    names = [f"{_PACKAGE}.{name}" for name in LOOP_MODULES]
    names += episode_rooms()
    names += [f"{core.__name__}.{name}" for name in CORE_MODULES]
    for name in names:
        digest.update(source_of(name).encode())
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name} {metadata.version(name)}".encode())
    digest.update(f"{platform.python_version()} {platform.machine()} {_processor()}".encode())
    return digest.hexdigest()[:24]


def episode_rooms() -> list[str]:
    """Full names of the modules that the compiled loop is written in, the tick first."""
    return [f"{_PACKAGE}.episode.{name}" for name in EPISODE_ROOMS]


def source_of(module: str) -> str:
    """Source text of a module, which is not imported for it.

    Args:
        module: Its full name.

    Returns:
        The text.
    """
    spec = importlib.util.find_spec(module)
    assert spec is not None and spec.origin is not None  # a module of this package is a file
    return Path(spec.origin).read_text(encoding="utf-8")


def _processor() -> str:
    """Name and abilities of the processor, for which code is compiled."""
    return f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"
