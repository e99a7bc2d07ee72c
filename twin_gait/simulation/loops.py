"""Compiled loops: from this process, from the cache folder, or compiled and put there.

numba is needed to compile and for nothing else. Loading it takes as long as all else that happens before the
first tick, and what it keeps itself is a pickle. Here the object code lies in a file behind a seal and a line
that says what is in it, and LLVM links it into the process.
"""

from __future__ import annotations

import contextlib
import ctypes
import hmac
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from llvmlite import binding

from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.simulation.keeping import cache_folder, read_own, seal

if TYPE_CHECKING:
    from twin_gait.simulation.compiling import CompiledLoop

ARGUMENTS = 3  # of every loop, whole numbers: an address, a first tick, an end
NativeFunction = Callable[..., int]


class MachineCode(NamedTuple):
    """A compiled function as it is kept."""

    object_code: bytes  # Object file.
    symbol: str  # Name of the function in it.


def write_code(path: Path, code: MachineCode) -> None:
    """Keep compiled code, sealed; where that is not possible it is not kept."""
    content = json.dumps({"symbol": code.symbol}).encode() + b"\n" + code.object_code
    proof = seal(path.name, content)
    if proof is not None:
        # A full or read-only disk: the code is in memory and need not be kept.
        with contextlib.suppress(RunDirectoryError):
            write_atomically(path, proof.encode() + b"\n" + content)


def read_code(path: Path) -> MachineCode | None:
    """Compiled code from a file; None if there is none, it is not the user's own, or not what was kept."""
    proof, _, content = (read_own(path) or b"").partition(b"\n")
    expected = seal(path.name, content)
    if expected is None or not hmac.compare_digest(proof, expected.encode()):
        return None
    header, _, object_code = content.partition(b"\n")
    return MachineCode(object_code, json.loads(header)["symbol"])


def load_function(code: MachineCode) -> NativeFunction:
    """Link compiled code into the process; it runs without the interpreter's lock."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(code.object_code))
    engine.finalize_object()
    return function_at(engine.get_function_address(code.symbol), engine)


def function_at(address: int, owner: Any, controller: str | None = None) -> NativeFunction:
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
                f"{controller}: raised an error, such as a division by zero; engine=pinocchio shows which"
            )
        assert status == 0, f"compiled code ended with status {status}"
        return result.value

    return call


# What this process has loaded or compiled; all episodes of a batch mostly share one loop.
_loops: dict[tuple[str, tuple[Any, ...]], NativeFunction] = {}


def kept_loop(
    key: str,
    make: Callable[[], CompiledLoop],
    on_compile: Callable[[], None] | None,
    own: tuple[Any, ...] = (),
) -> NativeFunction:
    """The loop of a key.

    With functions of the user's it is compiled once in this process and not kept on disk, because the sources
    that they depend on are unknown.

    ``key``: from :func:`twin_gait.simulation.keeping.source_key`. ``make``: compiles it.
    ``on_compile``: called if it has to be compiled, which takes 10 to 20 s. ``own``: functions of the user's.
    """
    if (key, own) not in _loops:
        path = None if own else _path_of(key)
        code = None if path is None else read_code(path)
        if code is not None:
            _loops[key, own] = load_function(code)
        else:
            if on_compile is not None:
                on_compile()
            compiled = make()
            if compiled.code is not None and path is not None:
                # Two processes may do this at once: the file is put in place in one step, both are as good.
                write_code(path, compiled.code)
            _loops[key, own] = compiled.function
    return _loops[key, own]


def is_kept(key: str) -> bool:
    """Whether :func:`kept_loop` would compile nothing, without functions of the user's."""
    path = _path_of(key)
    return (key, ()) in _loops or (path is not None and path.is_file())


def _path_of(key: str) -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / f"twin_gait_{key}.loop"
