"""The attainable floor: an optimum, in the engine what it is in the programme, and better than a table."""

from __future__ import annotations

import attainable_floor as page
import numpy as np
import pytest
from floor import walk as programme

from twin_gait import load_experiment, simulate


def test_without_casadi_one_line_names_the_extra_to_install(monkeypatch, capsys):
    monkeypatch.setattr(programme, "ca", None)
    with pytest.raises(SystemExit) as left:
        programme.require_casadi()
    assert left.value.code == 2
    assert capsys.readouterr().err == "attainable_floor: needs casadi: pip install 'twin-gait[floor]'\n"


@pytest.mark.slow
def test_an_optimum_is_replayed_and_beats_the_table():
    pytest.importorskip("casadi", reason="needs casadi: pip install 'twin-gait[floor]'")
    settings = page.settings_of("vertical")
    table = simulate(load_experiment("treadmill_guided", settings).experiment)
    search = page.search_of(settings, 80)  # with fewer the replay leaves the solution by more than 0.1°
    goals = programme.NOTHING._replace(peak=1.2)
    found = search.solve(search.start_from(table), page.WEIGHTS[0], goals)
    assert found.succeeded and found.optimality < programme.OPTIMALITY

    row, walked = page.row_of(found, "peak")
    assert row["drift_deg"] < 0.1
    assert row["error_deg"] < page.numbers_of(table)["error_deg"] - 1.0
    assert row["peak"] < 1.2 + 0.02
    assert row["stride_s"] == pytest.approx(2.0 * search.half, abs=1e-3)

    # Half a stride later the other leg is where this one was.
    n, other_side = len(found.states) // 2, {"left": "right", "right": "left"}
    model = found.problem.world.model
    for item in found.problem.joints:
        other = model.index(other_side[item.side], item.joint)
        for shift in (0, n):
            assert found.states[item.coordinate + shift, -1] == pytest.approx(
                found.states[other + shift, 0], abs=1e-7
            )

    # The motors do what the engine lets them do: nothing is cut off in the replay.
    middles = (np.arange(len(walked.log)) % round(search.half / 1e-3) + 0.5) * 1e-3
    ends = np.linspace(0.0, search.half, found.torques.shape[1])
    first = slice(0, round(search.half / 1e-3))
    for row_, item in zip(found.torques, found.problem.joints, strict=True):
        wanted = np.interp(middles[first], ends, row_)
        given = walked.log[f"{item.side}_{item.joint}_motor_torque_Nm"].to_numpy()[first]
        assert np.abs(given - wanted).max() < 1e-6
        assert np.abs(given).max() <= 60.0 + 1e-6
