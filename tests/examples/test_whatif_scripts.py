"""Numbers that the what-ifs keep for their page follow their tables, and lines lie on the cells of maps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from whatif.endings import Ending
from whatif.figures import COLOURS, position_of
from whatif.friction import map_row
from whatif_friction_map import map_settings, of_the_map
from whatif_inertia import of_stability
from whatif_temperature import largest_safe_gain


@pytest.mark.slow
def test_counts_of_the_map_follow_the_table() -> None:
    table = pd.DataFrame([map_row(setting) for setting in map_settings(quick=True)])
    found = of_the_map(table)
    above = (table["compensation"] == "measured") & (table["gain"] > table["friction_ratio"])
    assert found["above"] == found["above_moving"] == above.sum() > 0
    assert found["matrix_agrees"] == found["runs"]
    table.loc[above.idxmax(), "ending"] = str(Ending.REST)
    changed = of_the_map(table)
    assert changed["above_moving"] == above.sum() - 1
    assert changed["matrix_agrees"] == changed["runs"] - 1
    assert changed["reference_at_rest"] == found["reference_at_rest"]


def test_wrong_predictions_of_the_eigenvalues_are_counted() -> None:
    rows = [(0.5, True), (0.5, False), (-0.5, False), (0.05, False)]
    table = pd.DataFrame(rows, columns=["growth_rate_per_s", "linear_run_is_unstable"])
    table = table.assign(ending="rest", amplitude_deg=0.0, torque_amplitude_Nm=0.0)
    limits = pd.DataFrame(
        {"gear": "rigid", "held": [True, False], "source": "encoder", "largest_share": [0.9, 1.0]}
    )
    found = of_stability(table, limits.assign(bus_delay_ms=0.0))
    assert (found["decided"], found["misses"], found["moving"]) == (3, 1, 0)
    assert found["rigid_free"] == {"least": 1.0, "most": 1.0} and found["compliant_worst"] is None


def test_safe_gain_is_the_one_below_the_first_that_moves() -> None:
    table = pd.DataFrame(
        {"gain": [0.1, 0.2, 0.3, 0.1, 0.2, 0.3], "ending": ["rest", "rest", "runaway", *["rest"] * 3]}
    )
    assert largest_safe_gain(table) == 0.2
    assert largest_safe_gain(table[3:]) == 0.3


def test_every_ending_has_a_colour() -> None:
    assert set(COLOURS) == set(Ending)


def test_lines_are_at_the_positions_of_the_cells() -> None:
    positions = position_of([0.1, 0.2, 0.4], np.array([0.05, 0.1, 0.3, 0.4, 0.5]))
    assert positions == pytest.approx([-0.5, 0.0, 1.5, 2.0, 2.5])
