"""Springs and dampers of the gait table, or less than that."""

import numpy as np

from twin_gait.control.controller import Controller, Plan
from twin_gait.core.control_tick import COLUMNS_PER_JOINT, DAMPING, STIFFNESS
from twin_gait.vocabulary import Side


class Impedance(Controller):
    """The phases of the gait table."""

    mode = "impedance"


class Transparent(Controller):
    """G and gravity shares of the table, no impedance."""

    mode = "transparent"
    by_phases = False

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """The table's without springs and dampers."""
        for column in (STIFFNESS, DAMPING):
            rows[:, column:-1:COLUMNS_PER_JOINT] = 0.0
        return rows


class Gravity(Transparent):
    """Gravity carried in full and G of the table, no impedance (TWIN's gravity mode)."""

    mode = "gravity"

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """As transparent, with the weight of the leg."""
        rows[:, -1] = 1.0
        return super().setpoints(plan, side, rows)


class Constant(Controller):
    """One impedance for the whole stride: the mean of the table's."""

    mode = "constant"
    by_phases = False

    def setpoints(self, plan: Plan, side: Side, rows: np.ndarray) -> np.ndarray:
        """The mean over the phases in each of them."""
        rows[:] = rows.mean(axis=0)
        return rows
