"""Where compiled code is kept, and under which key.

Whatever is compiled is kept under a hash over every source that it depends on: the generated kernel, all of
core, the stages of a tick, the versions of numba, llvmlite, numpy and Python, and the processor. An edit of
any of them is used by the next run. Code is loaded only from the user's own files, and only if a seal with
the user's secret says that this program wrote them. Nothing here needs the compiler.
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

ARGUMENTS = 3  # of every loop, whole numbers: an address, a first tick, an end
Loop = Callable[..., int]
OnCompile: TypeAlias = Callable[[], None] | None  # what is called if a loop has to be compiled first
CACHE_VARIABLE = "TWIN_GAIT_CACHE"
SECRET_BYTES = 32
KEY_DIGITS = 24
# What a compiled loop is made of or made by, in this package; folders stand for all their modules.
_LAWS = "../core", "../control", "../worlds/arm_policy", "../worlds/bench_control"
SOURCES = *_LAWS, "../kernels", "../gait/signals", "../gait/table", "../network/messages", "."


def cache_folder() -> Path | None:
    """Folder of the compiled code: ``$TWIN_GAIT_CACHE``, or twin_gait in the user's cache folder.

    Returns the folder, made if needed; None if it cannot be had, belongs to somebody else, or others may
    write there. What is compiled then stays in memory.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    try:
        return private_folder(Path(chosen) if chosen else _home("XDG_CACHE_HOME", ".cache") / "twin_gait")
    except (OSError, RuntimeError):  # pathlib's error where the user has no home
        return None


@lru_cache(maxsize=8)
def private_folder(folder: Path) -> Path | None:
    """A folder that is the user's alone to write, made if needed; a warning and None if it is not."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if is_private(folder.stat()):
        return folder
    warnings.warn(
        f"{folder}: not used, because somebody else owns it or may write there; compiled code stays in memory"
        f" (chmod go-w, or choose another folder by {CACHE_VARIABLE})",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def is_private(status: os.stat_result) -> bool:
    """Whether a file or folder belongs to the user and nobody else may write to it."""
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022


def read_private_file(path: Path) -> bytes | None:
    """Content of a file that is the user's own to write, and not a link; None of any other."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
            return file.read() if is_private(os.fstat(file.fileno())) else None
    except OSError:
        return None


def sign(name: str, content: bytes) -> str | None:
    """Proof that this user's own program kept a content under a name: HMAC-SHA256 with the user's secret.

    In hexadecimal digits; None if there is no place for a secret. One file in place of another is noticed
    too.
    """
    try:
        secret = _secret(_home("XDG_DATA_HOME", ".local/share") / "twin_gait" / "cache.key")
    except (OSError, RuntimeError):
        return None
    return hmac.new(secret, name.encode() + b"\n" + content, "sha256").hexdigest() if secret else None


@lru_cache(maxsize=1)
def _secret(path: Path) -> bytes | None:
    """The user's secret, apart from the code that it protects; made at the first use, read by nobody else."""
    if not path.exists():
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, new = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)  # 0600
        with os.fdopen(descriptor, "wb") as file:
            file.write(secrets.token_bytes(SECRET_BYTES))
        # Of two processes that get here at once, both go on with the secret of the first.
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
    # This processor, and what numba is told to compile for in place of it.
    told = [os.environ.get(f"NUMBA_CPU_{what}") for what in ("NAME", "FEATURES")]
    here = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    digest.update(repr((platform.python_version(), platform.machine(), *told, *here)).encode())
    return digest.digest()


@lru_cache(maxsize=1)
def _content() -> bytes:
    """Hash over all sources, read once in a process: an edit during a long batch changes nothing in it."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in source_files())).digest()


def source_files() -> list[Path]:
    """Modules that :data:`SOURCES` stands for."""
    home, found = Path(__file__).parent, []
    for name in SOURCES:
        path = home / f"{name}.py"  # before a folder: an older version may have left one of this name
        found += [path] if path.is_file() else sorted((home / name).rglob("*.py"))
    return found


class CompiledLoop(NamedTuple):
    """A loop compiled in this process."""

    function: Loop  # Takes whole numbers and returns one.
    # What can be kept of it, the name of the function and an object file behind a line break; None if it
    # needs more than the C library.
    code: bytes | None


def write_code(path: Path, code: bytes) -> None:
    """Keep compiled code, sealed; where that is not possible it is not kept."""
    proof = sign(path.name, code)
    if proof is not None:
        # A full or read-only disk: the code is in memory and need not be kept.
        with contextlib.suppress(RunDirectoryError):
            write_atomically(path, proof.encode() + b"\n" + code)


def read_code(path: Path) -> bytes | None:
    """Compiled code from a file; None if there is none, it is not the user's own, or not what was kept."""
    proof, _, code = (read_private_file(path) or b"").partition(b"\n")
    expected = sign(path.name, code)
    return code if expected is not None and hmac.compare_digest(proof, expected.encode()) else None


def load_function(code: bytes) -> Loop:
    """Link compiled code into the process; it runs without the interpreter's lock."""
    symbol, _, object_code = code.partition(b"\n")
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(object_code))
    engine.finalize_object()
    return wrap_native_function(engine.get_function_address(symbol.decode()), engine)


def wrap_native_function(address: int, owner: Any, controller: str | None = None) -> Loop:
    """A compiled function by the address of a native one, which writes its result through a pointer.

    ``owner``: what has to live as long as the function. ``controller``: name of the user's control law in it,
    if there is one; if that raises something, the function raises ParameterError.
    """
    pointers = ctypes.POINTER(ctypes.c_int64), ctypes.POINTER(ctypes.c_void_p)
    native = ctypes.CFUNCTYPE(ctypes.c_int, *pointers, *(ctypes.c_int64,) * ARGUMENTS)(address)

    def call(*arguments: int, _owner: Any = owner) -> int:
        result, exception = ctypes.c_int64(), ctypes.c_void_p()
        status = native(ctypes.byref(result), ctypes.byref(exception), *arguments)
        # The loop itself raises nothing: what it calls divides as the processor does and asserts nothing.
        if status != 0 and controller is not None:
            raise ParameterError(
                f"{controller}: raised an error, such as a division by zero or an index out of range; "
                "engine=pinocchio shows which"
            )
        if status != 0:
            raise RuntimeError(f"compiled code ended with status {status}")
        return result.value

    return call


_variants: dict[str, LoopVariant] = {}  # by key
# What this process has loaded or compiled; all episodes of a batch mostly share one loop.
_loops: dict[tuple[str, tuple[Any, ...]], Loop] = {}


def cached_loop(
    key: str, make: Callable[[], CompiledLoop], on_compile: OnCompile, user_functions: tuple[Any, ...] = ()
) -> Loop:
    """The loop of a key.

    With functions of the user's it is compiled once in this process and not kept on disk, because the sources
    that they depend on are unknown.

    ``key``: from :func:`twin_gait.simulation.code_cache.source_key`. ``make``: compiles it.
    ``on_compile``: called if it has to be compiled; without it the logger ``twin_gait`` warns of the wait.
    ``own``: functions of the user's.
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
                # Two processes may do this at once: the file is put in place in one step, both are as good.
                write_code(path, compiled.code)
                _write_record(path, key, time.perf_counter() - started)
            _loops[key, user_functions] = compiled.function
    return _loops[key, user_functions]


def _announcement(key: str, *, has_user_code: bool) -> str:
    """Return the line that announces a compilation, by the records of kept loops."""
    folder = cache_folder()
    records = [] if folder is None else read_records(map(read_private_file, folder.glob("twin_gait_*.json")))
    return compile_text(_variant(key), _sources().hex(), records, has_user_code=has_user_code)


def _write_record(path: Path, key: str, seconds: float) -> None:
    """Write the record of a compilation next to the file of a loop, where that is possible."""
    kind, flags = _variant(key)
    record = Compilation(kind, flags, _sources().hex(), round(seconds, 3))
    with contextlib.suppress(RunDirectoryError):
        write_atomically(path.with_suffix(".json"), record.to_json())


def _variant(key: str) -> LoopVariant:
    return _variants.get(key, LoopVariant("", {}))


def is_cached(key: str) -> bool:
    """Whether :func:`kept_loop` would compile nothing, without functions of the user's."""
    path = _path_of(key)
    return (key, ()) in _loops or (path is not None and path.is_file())


def _path_of(key: str) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / f"twin_gait_{key}.loop"
