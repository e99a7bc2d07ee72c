"""The machine of a gait table with its guards in C, as the firmware has them.

Guards, thresholds and the choice of a transition are printed as for the device, built with double numbers by
the C compiler of this machine, and called where :class:`~twin_gait.gait.GaitStateMachine` calls Python.
"""

import ctypes
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from twin_gait.core.guards import GuardProgram, next_transition
from twin_gait.firmware import TranslationUnit, print_units
from twin_gait.firmware.cross import compile_library
from twin_gait.gait.machine import GaitStateMachine
from twin_gait.gait.program import compile_guards, require_bits
from twin_gait.gait.table import StateTable
from twin_gait.testing.driver import MachineFactory
from twin_gait.vocabulary import Side

_ARGUMENTS = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int32, ctypes.c_void_p, ctypes.c_int32, ctypes.c_void_p


class CompiledMachine(GaitStateMachine):
    """A state machine whose transitions are chosen in C."""

    def __init__(self, table: StateTable, program: GuardProgram, choose: Callable[..., int], phase: str):
        """Begin in a phase.

        ``table``: the gait table. ``program``: its guards. ``choose``:
        :func:`~twin_gait.core.guards.next_transition` of the same guards in C. ``phase``: phase at tick 0.
        """
        super().__init__(table, Side.LEFT, initial_phase=phase, program=program)
        self._in_c = choose
        self._counters = (ctypes.c_int32 * program.n_transitions)()

    def _choose(self, ticks_in_phase: int, signals: Sequence[float], other_phase: int) -> int:
        measured = (ctypes.c_double * len(signals))(*signals)
        return self._in_c(self.phase_index, ticks_in_phase, measured, other_phase, self._counters)


def compiled_machines(tables: Sequence[StateTable]) -> list[MachineFactory]:
    """Machines of tables of gait or of modes in C, built together.

    Raises GaitTableError: a table has more phases or conditions than the device's whole numbers have bits.
    Raises FirmwareError: there is no C compiler.
    """
    programs = [compile_guards(table) for table in tables]
    for table, program in zip(tables, programs, strict=True):
        require_bits(table, program)
    names = [f"table_{number}" for number in range(len(tables))]
    unit = TranslationUnit("guards", [next_transition], dict(zip(names, programs, strict=True)))
    with TemporaryDirectory() as folder:
        for name, text in print_units([unit]).files.items():
            Path(folder, name).write_text(text)
        sources = sorted(Path(folder).glob("*.c"))
        library = ctypes.CDLL(str(compile_library(sources, flags=["-DREAL_DOUBLE"])))
    choose = library.next_transition
    choose.argtypes = _ARGUMENTS

    def factory(table: StateTable, program: GuardProgram, name: str) -> MachineFactory:
        there: Any = ctypes.byref(ctypes.c_char.in_dll(library, name))
        return partial(CompiledMachine, table, program, partial(choose, there))

    return list(map(factory, tables, programs, names))
