"""Code cache: files of compiled loops, with a key over every source of a loop.

The key is a hash over everything that compiled code depends on: the generated kernel, all of core, the stages
of a tick, the versions of numba, llvmlite, numpy and Python, and the processor. The next run therefore uses
an edit of any of them. Code is loaded only from files of the user, and only if a signature with the user's
secret key proves that this program wrote them. The module does not need the compiler.
"""

import contextlib
import ctypes
import hashlib
import hmac
import logging
import os
import platform
import secrets
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from llvmlite import binding

from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.simulation.compile_notes import (
    Compilation,
    LoopVariant,
    compile_text,
    parse_variant,
    read_records,
)

ARGUMENTS = 3  # Number of arguments of every loop, all integers: an address, a first tick and an end.
Loop = Callable[..., int]
OnCompile: TypeAlias = Callable[[], None] | None  # Function that is called before a loop is compiled.
CACHE_VARIABLE = "TWIN_GAIT_CACHE"
SECRET_BYTES = 32
KEY_DIGITS = 24
# Sources of this package that a compiled loop depends on; a folder includes all its modules.
_LAWS = "../core", "../control", "../worlds/arm_policy", "../worlds/bench_control"
SOURCES = *_LAWS, "../kernels", "../gait/signals", "../gait/table", "../network/messages", "."


def cache_folder() -> Path | None:
    """Return the folder of the code cache: ``$TWIN_GAIT_CACHE``, or twin_gait in the user's cache folder.

    The folder is created if it does not exist. The result is None if it cannot be created, belongs to another
    user, or is writable for others. Compiled code then stays in memory.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    try:
        return private_folder(Path(chosen) if chosen else _home("XDG_CACHE_HOME", ".cache") / "twin_gait")
    except (OSError, RuntimeError):  # pathlib raises RuntimeError if the user has no home folder
        return None


@lru_cache(maxsize=8)
def private_folder(folder: Path) -> Path | None:
    """Return a folder that only the user can write to, created if missing; otherwise warn and return None."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if is_private(folder.stat()):
        return folder
    warnings.warn(
        f"{folder}: not used, because another user owns it or may write into it; compiled code stays in "
        f"memory (use chmod go-w, or set another folder with {CACHE_VARIABLE})",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def is_private(status: os.stat_result) -> bool:
    """Return whether a file or folder belongs to the user and nobody else may write to it."""
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022


def read_private_file(path: Path) -> bytes | None:
    """Return the content of a file that only the user can write to and that is no link; otherwise None."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
            return file.read() if is_private(os.fstat(file.fileno())) else None
    except OSError:
        return None


def sign(name: str, content: bytes) -> str | None:
    """Return a signature which proves that this program stored a content under a name for this user.

    It is an HMAC-SHA256 with the user's secret key, in hexadecimal digits; None if the key cannot be stored.
    The name is part of it, so that one file in place of another is detected too.
    """
    try:
        secret = _secret(_home("XDG_DATA_HOME", ".local/share") / "twin_gait" / "cache.key")
    except (OSError, RuntimeError):
        return None
    return hmac.new(secret, name.encode() + b"\n" + content, "sha256").hexdigest() if secret else None


@lru_cache(maxsize=1)
def _secret(path: Path) -> bytes | None:
    """Return the user's secret key from a folder apart from the code, created at the first use.

    The result is None if the key is too short or others can read or write its file.
    """
    if not path.exists():
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, new = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)  # 0600
        with os.fdopen(descriptor, "wb") as file:
            file.write(secrets.token_bytes(SECRET_BYTES))
        # If two processes create a key at the same time, both use the key of the first one.
        with contextlib.suppress(FileExistsError):
            os.link(new, path)
        os.unlink(new)
    secret = read_private_file(path)
    readable = path.stat().st_mode & 0o077
    return None if secret is None or len(secret) < SECRET_BYTES or readable else secret


def _home(variable: str, folder: str) -> Path:
    chosen = os.environ.get(variable)
    return Path(chosen) if chosen else Path.home() / folder


@lru_cache(maxsize=8)
def source_key(text: str) -> str:
    """Return the key of a loop: a hash over its pattern and all that :func:`_sources` hashes."""
    key = hashlib.sha256(text.encode() + _sources()).hexdigest()[:KEY_DIGITS]
    _variants[key] = parse_variant(text)
    return key


def _sources() -> bytes:
    """Return a hash over every source, package and processor that compiled code may depend on."""
    digest = hashlib.sha256(_content())
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name} {metadata.version(name)}".encode())
    # This processor, and the processor for which numba compiles if these variables are set.
    target = [os.environ.get(f"NUMBA_CPU_{quantity}") for quantity in ("NAME", "FEATURES")]
    here = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    digest.update(repr((platform.python_version(), platform.machine(), *target, *here)).encode())
    return digest.digest()


@lru_cache(maxsize=1)
def _content() -> bytes:
    """Return a hash over all sources, read once per process: an edit does not affect a batch that runs."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in source_files())).digest()


def source_files() -> list[Path]:
    """Return the files of all modules in :data:`SOURCES`, and the YAML files with their data."""
    home, found = Path(__file__).parent, []
    for name in SOURCES:
        module = [path for end in ("py", "yaml") if (path := home / f"{name}.{end}").is_file()]
        found += module or sorted((home / name).rglob("*.py"))
    return found


class CompiledLoop(NamedTuple):
    """Loop that was compiled in this process."""

    function: Loop  # Function of integers that returns an integer.
    # Code for the cache: the name of the function, a line break and an object file; None if the loop needs
    # more than the C library.
    code: bytes | None


def write_code(path: Path, code: bytes) -> None:
    """Write compiled code with a signature into the code cache, if that is possible."""
    proof = sign(path.name, code)
    if proof is not None:
        # On a full or read-only disk the error is ignored, because the code is in memory.
        with contextlib.suppress(RunDirectoryError):
            write_atomically(path, proof.encode() + b"\n" + code)


def read_code(path: Path) -> bytes | None:
    """Return compiled code from a file; None if the file is missing, not the user's, or was changed."""
    proof, _, code = (read_private_file(path) or b"").partition(b"\n")
    expected = sign(path.name, code)
    return code if expected is not None and hmac.compare_digest(proof, expected.encode()) else None


def load_function(code: bytes) -> Loop:
    """Link compiled code into the process; its function runs without the lock of the interpreter."""
    symbol, _, object_code = code.partition(b"\n")
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(object_code))
    engine.finalize_object()
    return wrap_native_function(engine.get_function_address(symbol.decode()), engine)


def wrap_native_function(address: int, owner: Any, controller: str | None = None) -> Loop:
    """Return a Python function that calls native code at an address; the code returns through a pointer.

    ``owner``: object that must exist as long as the function. ``controller``: name of the user's control law
    in the code, if there is one; if the control law raises an error, the function raises ParameterError.
    """
    pointers = ctypes.POINTER(ctypes.c_int64), ctypes.POINTER(ctypes.c_void_p)
    native = ctypes.CFUNCTYPE(ctypes.c_int, *pointers, *(ctypes.c_int64,) * ARGUMENTS)(address)

    def call(*arguments: int, _owner: Any = owner) -> int:
        result, exception = ctypes.c_int64(), ctypes.c_void_p()
        status = native(ctypes.byref(result), ctypes.byref(exception), *arguments)
        # The loop itself raises no errors: its steps divide like the processor and contain no assertions.
        if status != 0 and controller is not None:
            raise ParameterError(
                f"{controller}: raised an error, such as a division by zero or an index out of range; "
                "engine=pinocchio shows which"
            )
        if status != 0:
            raise RuntimeError(f"compiled code ended with status {status}")
        return result.value

    return call


_variants: dict[str, LoopVariant] = {}  # Patterns of loops by key.
# Loops that this process has loaded or compiled; the episodes of a batch mostly share one loop.
_loops: dict[tuple[str, tuple[Any, ...]], Loop] = {}


def cached_loop(
    key: str, make: Callable[[], CompiledLoop], on_compile: OnCompile, user_functions: tuple[Any, ...] = ()
) -> Loop:
    """Return the loop of a key, from memory, from the code cache, or compiled.

    A loop with functions of the user is compiled once in each process and not stored on disk, because the
    sources of these functions are unknown.

    ``key``: from :func:`twin_gait.simulation.code_cache.source_key`. ``make``: compiles the loop.
    ``on_compile``: called before a compilation; without it the logger ``twin_gait`` writes a warning.
    ``user_functions``: functions of the user.
    """
    if (key, user_functions) not in _loops:
        path = None if user_functions else _path_of(key)
        code = None if path is None else read_code(path)
        if code is not None:
            _loops[key, user_functions] = load_function(code)
        else:
            if on_compile is not None:
                on_compile()
            else:
                logging.getLogger("twin_gait").warning(_announcement(key, has_user_code=bool(user_functions)))
            started = time.perf_counter()
            compiled = make()
            if compiled.code is not None and path is not None:
                # Two processes may write at once: a file is replaced in one step, and both files are valid.
                write_code(path, compiled.code)
                _write_record(path, key, time.perf_counter() - started)
            _loops[key, user_functions] = compiled.function
    return _loops[key, user_functions]


def _announcement(key: str, *, has_user_code: bool) -> str:
    """Return the line that announces a compilation, from the records of the loops in the code cache."""
    folder = cache_folder()
    records = [] if folder is None else read_records(map(read_private_file, folder.glob("twin_gait_*.json")))
    return compile_text(_variant(key), _sources().hex(), records, has_user_code=has_user_code)


def _write_record(path: Path, key: str, seconds: float) -> None:
    """Write the record of a compilation next to the file of a loop, if that is possible."""
    kind, flags = _variant(key)
    record = Compilation(kind, flags, _sources().hex(), round(seconds, 3))
    with contextlib.suppress(RunDirectoryError):
        write_atomically(path.with_suffix(".json"), record.to_json())


def _variant(key: str) -> LoopVariant:
    return _variants.get(key, LoopVariant("", {}))


def is_cached(key: str) -> bool:
    """Return whether the loop of a key without functions of the user needs no compilation."""
    path = _path_of(key)
    return (key, ()) in _loops or (path is not None and path.is_file())


def _path_of(key: str) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / f"twin_gait_{key}.loop"
