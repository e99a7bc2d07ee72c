"""The state machine of a gait table with its guards in C, as in the firmware.

Guards, thresholds and the choice of a transition are printed as for the device, but with double precision.
They are built by the C compiler of this machine, and called in place of the Python function of
:class:`~twin_gait.gait.machine.GaitStateMachine`.
"""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from twin_gait.core.guards import GuardProgram, next_transition
from twin_gait.firmware.cross import compile_library
from twin_gait.firmware.printer import TranslationUnit, print_units
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.program import DEVICE_BITS, compile_guards
from twin_gait.gait.table import StateTable
from twin_gait.testing.cases import MachineFactory
from twin_gait.vocabulary import Side


def compiled_machines(tables: Sequence[StateTable]) -> list[MachineFactory]:
    """Build the machines of tables of gait or of modes in C, in one library.

    Raises GaitTableError: a table has more phases or conditions than the device's integers have bits.
    Raises FirmwareError: there is no C compiler.
    """
    programs = [compile_guards(table, DEVICE_BITS) for table in tables]
    names = [f"table_{number}" for number in range(len(tables))]
    unit = TranslationUnit("guards", [next_transition], dict(zip(names, programs, strict=True)))
    with TemporaryDirectory() as folder:
        for name, text in print_units([unit]).files.items():
            Path(folder, name).write_text(text)
        sources = sorted(Path(folder).glob("*.c"))
        library = ctypes.CDLL(str(compile_library(sources, flags=["-DREAL_DOUBLE"])))
    choose = library.next_transition
    numbers, number = ctypes.c_void_p, ctypes.c_int32
    choose.argtypes = numbers, number, number, numbers, number, numbers

    def factory(table: StateTable, program: GuardProgram, name: str) -> MachineFactory:
        guards = ctypes.byref(ctypes.c_char.in_dll(library, name))

        def in_c(
            _: GuardProgram, phase: int, ticks: int, signals: Sequence[float], other: int, debounce: list[int]
        ) -> int:
            measured = (ctypes.c_double * len(signals))(*signals)
            counters = (ctypes.c_int32 * program.n_transitions)(*debounce)
            chosen: int = choose(guards, phase, ticks, measured, other, counters)
            debounce[:] = counters
            return chosen

        def machine(phase: str) -> GaitStateMachine:
            made = GaitStateMachine(table, Side.LEFT, initial_phase=phase, program=program)
            made.transition_selector = in_c
            return made

        return machine

    return list(map(factory, tables, programs, names))
