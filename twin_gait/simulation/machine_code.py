"""Machine code of a compiled loop: kept in one file, and loaded without the compiler.

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
from typing import Any, NamedTuple

from llvmlite import binding

from twin_gait.exceptions import ParameterError, RunDirectoryError
from twin_gait.files import write_atomically
from twin_gait.simulation.keeping import read_own, seal

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
    """Read compiled code.

    Returns the code, or None if there is none, it is not the user's own, or it is not what was kept.
    """
    proof, _, content = (read_own(path) or b"").partition(b"\n")
    expected = seal(path.name, content)
    if expected is None or not hmac.compare_digest(proof, expected.encode()):
        return None
    header, _, object_code = content.partition(b"\n")
    return MachineCode(object_code, json.loads(header)["symbol"])


def load_function(code: MachineCode, n_arguments: int) -> NativeFunction:
    """Link compiled code into the process.

    ``n_arguments``: of the function; all are whole numbers, as is its result. Returns the function; it runs
    without the interpreter's lock.
    """
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(code.object_code))
    engine.finalize_object()
    return function_at(engine.get_function_address(code.symbol), n_arguments, engine)


def function_at(address: int, n_arguments: int, owner: Any, controller: str | None = None) -> NativeFunction:
    """A compiled function by its address.

    ``address``: of the native function, which returns a status and writes its result through a pointer.
    ``n_arguments``: of the function; all are whole numbers, as is its result. ``owner``: what has to live as
    long as the function. ``controller``: name of the user's control law in it, if there is one. Returns the
    function; it raises ParameterError if the user's law raises something.
    """
    pointers = ctypes.POINTER(ctypes.c_int64), ctypes.POINTER(ctypes.c_void_p)
    native = ctypes.CFUNCTYPE(ctypes.c_int, *pointers, *(ctypes.c_int64,) * n_arguments)(address)

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
