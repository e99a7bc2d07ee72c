"""Phases, the gait table, its guards, and the state machine."""

from twin_gait.gait.machine import GaitStateMachine, LegSignals, PhaseSwitch
from twin_gait.gait.program import GuardProgram, compile_guards
from twin_gait.gait.table import (
    TICK,
    Blending,
    BlendingLaw,
    DraftTable,
    DrivenBy,
    GaitTable,
    JointImpedance,
    PhaseParameters,
    Scaling,
    Transition,
    Waiver,
)

__all__ = [
    "TICK",
    "Blending",
    "BlendingLaw",
    "DraftTable",
    "DrivenBy",
    "GaitStateMachine",
    "GaitTable",
    "GuardProgram",
    "JointImpedance",
    "LegSignals",
    "PhaseParameters",
    "PhaseSwitch",
    "Scaling",
    "Transition",
    "Waiver",
    "compile_guards",
]
