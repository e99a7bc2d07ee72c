"""Controllers with the springs and dampers of the gait table, or with a part of them."""

import numpy as np

from twin_gait.control.controller import Controller, Plan
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, STIFFNESS
from twin_gait.vocabulary import Side


class Impedance(Controller):
    """Impedances of the phases of the gait table."""

    mode = "impedance"


class Transparent(Controller):
    """Friction compensation and gravity shares of the table, without impedance."""

    mode = "transparent"
    phase_driven = False

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Set the stiffness and damping of the table to zero."""
        for column in (STIFFNESS, DAMPING):
            rows[:, column:-1:COLUMNS_PER_JOINT] = 0.0
        return rows


class Gravity(Transparent):
    """Full gravity compensation and the table's friction compensation, no impedance (TWIN's gravity mode)."""

    mode = "gravity"

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Set the share of gravity compensation to 1, and the impedance to zero."""
        rows[:, -1] = 1.0
        return super().setpoints(plan, side, rows)


class Constant(Controller):
    """One impedance for the whole stride: the mean of the table's phases."""

    mode = "constant"
    phase_driven = False

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """Replace the setpoints of every phase by their mean over the phases."""
        rows[:] = rows.mean(axis=0)
        return rows
