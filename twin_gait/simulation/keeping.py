"""Where compiled code is kept, and under which key.

Whatever is compiled is kept under a hash over every source that it depends on: the generated kernel, all of
core, the rooms, the versions of numba, llvmlite, numpy and Python, and the processor. An edit of any of them
is used by the next run. Code is loaded only from the user's own files, and only if a seal with the user's
secret says that this program wrote them. Nothing here needs the compiler.
"""

import contextlib
import hashlib
import hmac
import os
import platform
import secrets
import tempfile
import warnings
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from llvmlite import binding

CACHE_VARIABLE = "TWIN_GAIT_CACHE"
SECRET_BYTES = 32
# What a compiled loop is made of or made by, in this package; folders stand for all their modules.
SOURCES = (
    "../core",
    "../control/controllers",
    "../control/gait_controller",
    "../control/joint_board",
    "../control/supervisor",
    "../gait/signals",
    "../network/messages",
    "rooms",
    "binding",
    "compiling",
    "episode",
    "interface",
    "log",
    "record",
)


def cache_folder() -> Path | None:
    """Folder of the compiled code: ``$TWIN_GAIT_CACHE``, or twin_gait in the user's cache folder.

    Returns the folder, made if needed; None if it cannot be had, belongs to somebody else, or others may
    write there. What is compiled then stays in memory.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    try:
        if chosen:
            return private_folder(Path(chosen))
        return private_folder(_home("XDG_CACHE_HOME", ".cache") / "twin_gait", close=True)
    except (OSError, RuntimeError):  # pathlib's error where the user has no home
        return None


@lru_cache(maxsize=8)
def private_folder(folder: Path, *, close: bool = False) -> Path | None:
    """A folder that is the user's alone to write, made if needed; a warning and None if it is not.

    ``close``: whether it is this program's own, to be closed to others where an earlier version left it open.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if close and folder.stat().st_uid == os.geteuid():
        folder.chmod(0o700)
    if only_mine(folder.stat()):
        return folder
    warnings.warn(
        f"{folder}: not used, because somebody else owns it or may write there; compiled code stays in memory"
        f" (chmod go-w, or choose another folder by {CACHE_VARIABLE})",
        RuntimeWarning,
        stacklevel=2,
    )
    return None


def only_mine(status: os.stat_result) -> bool:
    """Whether a file or folder belongs to the user and nobody else may write to it."""
    return status.st_uid == os.geteuid() and not status.st_mode & 0o022


def read_own(path: Path) -> bytes | None:
    """Content of a file that is the user's own to write, and not a link; None of any other."""
    try:
        with open(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
            return file.read() if only_mine(os.fstat(file.fileno())) else None
    except OSError:
        return None


def seal(name: str, content: bytes) -> str | None:
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
    secret = read_own(path)
    readable = path.stat().st_mode & 0o077
    return None if secret is None or len(secret) < SECRET_BYTES or readable else secret


def _home(variable: str, folder: str) -> Path:
    chosen = os.environ.get(variable)
    return Path(chosen) if chosen else Path.home() / folder


@lru_cache(maxsize=8)
def source_key(what: str, *more: str) -> str:
    """Hash over what is compiled and every source, package and processor that it depends on."""
    digest = hashlib.sha256(what.encode() + _content(*SOURCES, *more))
    for name in ("numba", "llvmlite", "numpy"):
        digest.update(f"{name} {metadata.version(name)}".encode())
    digest.update(f"{platform.python_version()} {platform.machine()} {' '.join(target())}".encode())
    return digest.hexdigest()[:24]


@lru_cache(maxsize=4)
def _content(*names: str) -> bytes:
    """Hash over modules, read once in a process: an edit during a long batch changes nothing in it."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in source_files(*names))).digest()


def source_files(*names: str) -> list[Path]:
    """Modules of this package by name, of a folder all of them."""
    home, found = Path(__file__).parent, []
    for name in names:
        path = home / f"{name}.py"  # before a folder: an older version may have left one of this name
        found += [path] if path.is_file() else sorted((home / name).glob("*.py"))
    return found


def target() -> tuple[str, str]:
    """Name and abilities of the processor that code is compiled for: this one, if numba is not told another.

    Returns as LLVM writes them: ``znver4`` and ``+avx2,+fma,-avx512f``.
    """
    name, features = (os.environ.get(f"NUMBA_CPU_{what}") for what in ("NAME", "FEATURES"))
    if features is None:  # as in numba.core.config
        generic = str(name).lower() == "generic"
        features = "" if generic else binding.get_host_cpu_features().flatten()
    return name or binding.get_host_cpu_name(), features
