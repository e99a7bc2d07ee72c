"""A sweep as a user meets it: specification, checks, folder, resumption, pictures."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from errors import raises
from sweep_process import write_spec

from twin_gait import load_experiment, simulate
from twin_gait.cli import main
from twin_gait.configuration.documents import dump_yaml
from twin_gait.configuration.validation import read_yaml
from twin_gait.exceptions import ParameterFileError, RunDirectoryError
from twin_gait.files import shipped_file
from twin_gait.leg_model.urdf import find_urdf, urdf_hash
from twin_gait.report.sweep import (
    cell_means,
    draw_heat_maps,
    draw_main_effects,
    level_names,
    main_effect_rows,
    measure_values,
    parameter_axis,
    varying_axes,
)
from twin_gait.studies import jobs
from twin_gait.studies.batch import flat_summary, simulate_batch
from twin_gait.studies.jobs import run_jobs
from twin_gait.studies.sweep import spec as sweep_spec
from twin_gait.studies.sweep import sweep as sweep_module
from twin_gait.studies.sweep.spec import load_sweep, sweep_from_mapping
from twin_gait.studies.sweep.sweep import check_sweep, read_table, run_sweep
from twin_gait.studies.workers import Workers, WorkersLost

HIP = "scenario.start.hip_deg"
STIFFNESS = "table.phases.early_stance.knee.stiffness_Nm_per_deg"
EXAMPLE = Path(__file__).parents[2] / "examples" / "sweep.yaml"


def assert_same(ours: pd.DataFrame, theirs: pd.DataFrame) -> None:
    pd.testing.assert_frame_equal(ours, theirs, check_exact=True)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A finished sweep of 12 episodes: its specification and its folder."""
    folder = tmp_path_factory.mktemp("swept")
    spec = write_spec(folder / "spec.yaml", measures=["right_knee_torque_rms_Nm"])
    assert main(["sweep", str(spec), "--out", str(folder / "out"), "--workers", "1"]) == 0
    return spec, folder / "out"


def test_a_row_equals_simulate_with_the_same_settings(swept):
    table = read_table(swept[1] / "table.parquet")
    assert table["episode"].tolist() == list(range(12))
    row = table.iloc[5]
    settings = [
        "duration_s=2.0",
        "sensors.ideal=false",
        "sensors.angle_noise_rad=1e-5",
        f"seed={row['seed']}",
    ]
    settings += [f"{key}={float(row[key])!r}" for key in (HIP, STIFFNESS)]
    alone = flat_summary(simulate(load_experiment("bench_leg", settings).experiment))
    assert alone["battery_power_mean_W"] > 0.0
    for name, value in alone.items():
        assert pd.isna(row[name]) if value is None else row[name] == value, name


def test_a_sweep_has_the_table_of_a_batch_of_its_design(swept):
    sweep = load_sweep(swept[0])
    table = read_table(swept[1] / "table.parquet")
    episodes = [
        {**override, "seed": seed} for override, seed in zip(sweep.overrides, table["seed"], strict=True)
    ]
    batch = simulate_batch(sweep.experiment, episodes).drop(columns="set.seed")
    assert_same(table.astype(batch.dtypes), batch)


def test_wearers_and_gait_tables_are_exchanged_whole_and_kept_in_the_specification(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "mine.yaml").write_text(
        "extends: treadmill_guided\nphases: {middle_stance: {minimum_duration_ms: 30}}\n"
    )
    (folder / "who.yaml").write_text("mass_kg: 80\n")
    levels = {
        "table": ["treadmill_pre_swing", "mine.yaml"],
        "patient": ["who.yaml"],
        "patient.height_m": [1.8],
    }
    more = {"experiment": "treadmill_guided", "settings": {"duration_s": 0.1}, "measures": []}
    spec = write_spec(folder / "spec.yaml", method="grid", samples=None, parameters=levels, **more)
    sweep = load_sweep(spec)
    (folder / "who.yaml").write_text("mass_kg: 60\n")  # after it was read
    document = json.dumps(sweep.document)
    for number, table in enumerate(levels["table"]):
        found = sweep.maker()((number, sweep.overrides[number]))
        path = str(folder / table) if table.endswith(".yaml") else table
        settings = [f"table={path}", "patient.height_m=1.8", "duration_s=0.1"]
        expected = load_experiment("treadmill_guided", settings).experiment
        assert (
            found.table.phases == expected.table.phases
            and found.table.transitions == expected.table.transitions
        )
        assert (found.patient.mass, found.patient.height) == (80.0, 1.8)
    again = sweep_from_mapping(json.loads(document), "spec.yaml", Path())
    assert again.document == sweep.document != load_sweep(spec).document


def own_robots(folder: Path) -> None:
    """Write three URDFs of one name, a copy of one that ships, a DBC, and a sweep that names all of them."""
    text = shipped_file("twin.urdf").read_text(encoding="utf-8")
    for number, name in enumerate(("leg.urdf", "a/leg.urdf", "b/leg.urdf")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"{text}<!-- {number} -->\n", encoding="utf-8")
    dbc = shipped_file("twin.dbc").read_text(encoding="utf-8")
    (folder / "bus.dbc").write_text(f'{dbc}\nCM_ "of this laboratory";\n', encoding="utf-8")
    shutil.copyfile(shipped_file("twin.urdf"), folder / "copy.urdf")
    experiment = {"preset": "treadmill_guided", "leg": {"urdf": "leg.urdf"}, "network": {"dbc": "bus.dbc"}}
    (folder / "mine.yaml").write_text(dump_yaml(experiment), encoding="utf-8")
    episodes = [
        {"leg.urdf": "a/leg.urdf"}, {"leg": {"urdf": str(folder / "b" / "leg.urdf")}}, {"seed": 3},
        {"leg.urdf": str(folder / "copy.urdf")}, {"leg.urdf": "twin.urdf"},
    ]  # fmt: skip
    entries = {"method": "list", "samples": None, "parameters": None, "episodes": episodes}
    settings = {"duration_s": 0.05}
    write_spec(folder / "spec.yaml", experiment="mine.yaml", settings=settings, measures=[], **entries)


@pytest.mark.slow  # runs episodes of four models twice; the next test sees that the copies are compared
def test_a_sweep_that_was_moved_has_its_own_files_with_it(tmp_path, monkeypatch):
    lab, out, moved = tmp_path / "lab", tmp_path / "out", tmp_path / "moved"
    own_robots(lab)
    sweep = load_sweep(lab / "spec.yaml")
    before = [urdf_hash(find_urdf(sweep.maker()(item).leg.urdf)) for item in enumerate(sweep.overrides)]
    assert len(set(before)) == 4
    table = run_sweep(sweep, out, pictures=False).table
    assert run_sweep(load_sweep(lab / "spec.yaml"), out, pictures=False).summary["last_call"]["episodes"] == 0
    experiment = load_sweep(out / "spec.yaml").document["experiment"]
    assert (experiment["leg"]["urdf"], experiment["network"]["dbc"]) == ("files/leg.urdf", "files/bus.dbc")
    out.rename(moved)
    shutil.rmtree(lab)
    monkeypatch.chdir(tmp_path)
    again = load_sweep(moved / "spec.yaml")
    made = [again.maker()(item) for item in enumerate(again.overrides)]
    assert [urdf_hash(find_urdf(item.leg.urdf)) for item in made] == before
    own = [item.leg.urdf for item in made[:3]] + [item.network.dbc for item in made]
    assert all(Path(path).is_relative_to(moved) for path in own)
    assert again.document == read_yaml(moved / "spec.yaml")
    (moved / "table.parquet").unlink()  # so that all episodes run again, with the copies
    assert_same(run_sweep(again, moved, pictures=False).table, table)


def test_a_sweep_does_not_resume_with_another_file_of_the_same_name(tmp_path):
    lab, out = tmp_path / "lab", tmp_path / "out"
    own_robots(lab)
    run_sweep(load_sweep(lab / "spec.yaml"), out, pictures=False)
    with (lab / "bus.dbc").open("a") as file:
        file.write("\n")
    with raises(RunDirectoryError, "bus.dbc", "--out"):
        run_sweep(load_sweep(lab / "spec.yaml"), out, pictures=False)


def test_every_seed_among_the_parameters_draws_its_own_noise(tmp_path):
    levels = {HIP: [10, 20], "seed": [0, 1, 2]}
    spec = write_spec(tmp_path / "spec.yaml", method="grid", samples=None, parameters=levels)
    table = run_sweep(load_sweep(spec), tmp_path / "out", pictures=False).table
    assert table["seed"].tolist() == table["set.seed"].tolist() == [0, 1, 2, 0, 1, 2]
    assert table.groupby(HIP)["battery_power_mean_W"].nunique().tolist() == [3, 3]


def test_metadata_holds_version_and_the_whole_specification(swept):
    spec, out = swept
    metadata = pq.ParquetFile(out / "table.parquet").schema_arrow.metadata
    assert metadata[b"twin_gait.schema_version"] == b"1"
    document = json.loads(metadata[b"twin_gait.sweep"])
    assert sweep_from_mapping(document, "metadata", Path()).document == load_sweep(spec).document


def test_the_specification_in_the_folder_gives_the_same_sweep(swept, tmp_path):
    spec, out = swept
    again = load_sweep(out / "spec.yaml")
    assert again.document == load_sweep(spec).document
    assert_same(run_sweep(again, tmp_path / "again", pictures=False).table, read_table(out / "table.parquet"))


def test_resuming_a_finished_sweep_changes_nothing(swept, capsys):
    spec, out = swept
    before = (out / "table.parquet").read_bytes()
    assert main(["sweep", str(spec), "--out", str(out), "--workers", "1", "--no-pictures"]) == 0
    assert ", 12 of them before" in capsys.readouterr().out
    assert (out / "table.parquet").read_bytes() == before


def test_unstable_steps_are_counted_without_unknown_ones_and_without_episodes():
    steps = pd.array([True, False, None, False], dtype="boolean")
    assert sweep_module._count_unstable_steps(pd.DataFrame({"step_stable": steps})) == 2
    assert sweep_module._count_unstable_steps(pd.DataFrame()) == 0


def test_stopping_and_resuming_gives_the_same_table(swept, tmp_path):
    sweep, out = load_sweep(swept[0]), tmp_path / "out"
    done = []
    for _ in range(20):
        began = len(done)
        result = run_sweep(
            sweep,
            out,
            pictures=False,
            progress=lambda number, total: done.append(number),
            should_stop=lambda began=began: len(done) > began + 3,
        )
        assert len(result.table) >= result.summary["last_call"]["resumed_with"]
        if result.summary["status"] == "completed":
            break
    assert result.summary["last_call"]["resumed_with"] > 0
    assert_same(read_table(out / "table.parquet"), read_table(swept[1] / "table.parquet"))


def test_rows_that_a_kill_left_in_table_and_parts_count_once(swept, tmp_path):
    sweep, out = load_sweep(swept[0]), tmp_path / "out"
    run_sweep(sweep, out, pictures=False)
    (out / "parts").mkdir()
    (out / "parts" / ".00000000-00000001.parquet.half").write_bytes(b"PAR1")
    # What a kill between writing the table and removing the parts leaves.
    (out / "parts" / "00000000-00000011.parquet").write_bytes((out / "table.parquet").read_bytes())
    assert_same(run_sweep(sweep, out, pictures=False).table, read_table(swept[1] / "table.parquet"))


def test_another_sweep_or_other_sources_are_refused(swept, tmp_path, monkeypatch):
    spec, out = swept
    with raises(RunDirectoryError, "out", "--out"):
        run_sweep(load_sweep(spec, ["duration_s=0.3"]), out)
    monkeypatch.setattr(sweep_spec, "sources_hash", lambda: "edited")
    with raises(RunDirectoryError, "twin_gait", "--out"):
        run_sweep(load_sweep(spec), out)


def test_a_worker_with_other_sources_runs_nothing(monkeypatch):
    ran: list[int] = []
    assert run_jobs(ran.append, [5]) == [None]
    hashes = iter(["ours", "edited"])
    monkeypatch.setattr(jobs, "sources_hash", lambda: next(hashes))
    with raises(WorkersLost, "twin_gait"):
        run_jobs(ran.append, [6])
    assert ran == [5]


def test_a_damaged_table_is_named(swept, tmp_path):
    spec, out = swept[0], tmp_path / "out"
    run_sweep(load_sweep(spec, ["duration_s=0.1"]), out, pictures=False)
    table = (out / "table.parquet").read_bytes()
    (out / "table.parquet").write_bytes(table[:-100])
    with raises(RunDirectoryError, "table.parquet") as error:
        run_sweep(load_sweep(spec, ["duration_s=0.1"]), out)
    assert "\n" not in str(error.value)


def test_a_fall_and_a_divergence_are_results(tmp_path):
    hard = {"plant.stops.stiffness_Nm_per_rad": 1e7, "scenario.start": {"hip_deg": 20, "knee_deg": -20}}
    spec = write_spec(
        tmp_path / "spec.yaml", method="list", episodes=[{}, hard], parameters=None, samples=None
    )
    result = run_sweep(load_sweep(spec, ["duration_s=0.5"]), tmp_path / "out")
    assert result.table["status"].tolist() == ["completed", "diverged"]
    assert result.summary["outcomes"] == {"too short to judge": 1, "diverged": 1}
    assert result.summary["unstable_steps"] == 1
    # What is neither a number nor a text is kept as JSON.
    assert json.loads(result.table["scenario.start"][1]) == hard["scenario.start"]


RANGE = {"from": 5, "to": 30}
BAD = {
    "unknown key": ({"metod": "grid"}, [], "metod: unknown key; did you mean 'method'"),
    "unknown method": ({"method": "random"}, [], "method: .*'random'"),
    "no such experiment": ({"experiment": "moonwalk"}, [], "moonwalk: there is no such preset or file"),
    "misspelt parameter": (
        {"parameters": {"scenario.start.hip_dg": RANGE}},
        [],
        r"episode \d+: scenario.*hip_dg: unknown",
    ),
    "out of range": (
        {"method": "grid", "samples": None, "parameters": {"duration_s": [0.1, 0.2, -1]}},
        [],
        "episode 2: duration.*-1",
    ),
    "phase that is not there": (
        {
            "method": "grid",
            "samples": None,
            "parameters": {"scenario.start_phase": ["swing_flexion", "flight"]},
        },
        [],
        "episode 1: .*flight",
    ),
    "misspelt range": ({"parameters": {HIP: {"from": 5, "too": 6}}}, [], f"parameters.{HIP}: too: unknown"),
    "falling range": (
        {"parameters": {HIP: {"from": 5, "to": 4}}},
        [],
        f"parameters.{HIP}: expected from to be below to",
    ),
    "not a range": ({"parameters": {HIP: 5}}, [], f"parameters.{HIP}: expected a list.*got 5"),
    "no parameters": ({"parameters": {}}, [], "parameters: is missing or empty"),
    "no samples": (
        {"samples": None},
        [],
        "samples: is missing or empty; the method latin_hypercube requires it",
    ),
    "no count": ({"method": "grid", "samples": None}, [], f"parameters.{HIP}: expected a count"),
    "samples of a grid": ({"method": "grid"}, [], "samples: the method grid does not use it"),
    "list of parameters": ({"method": "list", "samples": None}, [], "episodes: is missing"),
    "both": ({"episodes": [{}]}, [], "episodes: the method latin_hypercube does not use it"),
    "date": ({"parameters": {HIP: ["2026-01-01"]}}, [], r"episode \d+: scenario.*hip_deg.*2026-01-01"),
    "negative seed": ({"seed": -1}, [], "seed: .*-1"),
    "no gait table": (
        {"parameters": {"table": ["mine"]}},
        [],
        "spec.yaml: table: there is no gait table 'mine'; expected the path .*sup_2009",
    ),
    "no person": ({"parameters": {"patient": ["me"]}}, [], "spec.yaml: patient: there is no person 'me'"),
    "wrong setting": ({"settings": {"patient.mas_kg": 70}}, [], "mas_kg"),
    "no measure": ({"measures": ["happiness"]}, [], "measures: there is no measure 'happiness'"),
    "text to draw": ({"measures": ["outcome"]}, [], "measures: there is no measure 'outcome'"),
    "zero workers": ({}, ["--workers", "0"], "--workers: expected 1 or more, got 0"),
    "workers and scheduler": (
        {},
        ["--workers", "2", "--scheduler", "tcp://h:1"],
        "--workers: leave it out",
    ),
    "wrong --set": ({}, ["--set", "nonsense"], "expected key=value"),
}


@pytest.mark.parametrize(("entries", "options", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_line_status_2_and_nothing_is_written(
    entries, options, message, tmp_path, monkeypatch, capsys
):
    spec = write_spec(tmp_path / "spec.yaml", **entries)
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "spec.yaml", "--out", "out", *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith("twin-gait: ") and error.count("\n") == 1
    assert re.search(message, error), error
    assert list(tmp_path.iterdir()) == [spec]


def test_folders_without_a_sweep_are_left_unchanged(tmp_path, capsys):
    spec = write_spec(tmp_path / "spec.yaml")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.png").touch()
    for target in ("photos", "spec.yaml", "spec.yaml/below"):
        assert main(["sweep", str(spec), "--out", str(tmp_path / target), "--workers", "1"]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert [path.name for path in (tmp_path / "photos").iterdir()] == ["cat.png"]


def test_workers_check_a_long_sweep(tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_module, "CHECKED_HERE", 5)
    episodes = [{HIP: 10}] * 8
    episodes[-2] = {HIP: "high"}
    spec = write_spec(tmp_path / "spec.yaml", method="list", samples=None, parameters=None, episodes=episodes)
    with Workers(2) as workers, raises(ParameterFileError, "episode 6", "hip_deg", "high"):
        check_sweep(load_sweep(spec), workers)


def test_an_experiment_next_to_the_specification_is_found_from_any_folder(tmp_path, monkeypatch):
    document = load_experiment("bench_leg", ["plant.gravity_m_per_s2=3.7"]).document
    (tmp_path / "moon.yaml").write_text(dump_yaml(document))
    spec = write_spec(tmp_path / "spec.yaml", experiment="moon.yaml")
    monkeypatch.chdir("/")
    assert load_sweep(spec).experiment.plant.gravity == 3.7


def test_the_example_is_a_sweep_of_320_walks():
    sweep = load_sweep(EXAMPLE)
    assert len(sweep.overrides) == 320
    check_sweep(sweep, Workers())
    commented = [
        line.removeprefix("#   ") for line in EXAMPLE.read_text().splitlines() if line.startswith("#   ")
    ]
    text = "\n".join(commented)
    hypercube, rows = text.split("method: list")
    rest = {"experiment": "treadmill_guided"}
    for other in (f"{hypercube}", f"method: list{rows}"):
        entries = {**rest, **read_yaml_text(other)}
        check_sweep(sweep_from_mapping(entries, "comment", Path()), Workers())


def test_the_example_draws_all_requested_figures():
    sweep = load_sweep(EXAMPLE)
    # 75 kg, 1.80 m, a middle belt, 60 % support: a walk that completes
    values = (75, 1.80, 0.38, 0.6)
    (episode,) = (item for item in enumerate(sweep.overrides) if np.allclose([*item[1].values()], values))
    row = flat_summary(simulate(sweep.maker()(episode)))
    assert row["status"] == "completed"
    assert all(np.isfinite(row[name]) for name in sweep.document["measures"])


def test_a_measure_that_cannot_be_drawn_is_named(tmp_path, capsys):
    wanted = ["right_knee_torque_rms_Nm", "right_stride_time_mean_s"]  # the first two strides do not count
    spec = write_spec(tmp_path / "spec.yaml", measures=wanted)
    assert main(["sweep", str(spec), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    shown = capsys.readouterr().out
    assert "not drawn, because no completed episode has this value: right_stride_time_mean_s\n" in shown


def read_yaml_text(text: str) -> dict[str, object]:
    import yaml

    lines = [line for line in text.splitlines()]
    lines = [line.split("   draws ")[0].split("   each ")[0] for line in lines]
    return yaml.safe_load("\n".join(lines))


def test_pictures_are_drawn_for_the_share_and_the_measures(swept):
    names = sorted(path.name for path in (swept[1] / "figures").iterdir())
    assert names == [
        "heat_map_right_knee_torque_rms_Nm.png",
        "heat_map_walked.png",
        "main_effects_right_knee_torque_rms_Nm.png",
        "main_effects_walked.png",
    ]
    page = (swept[1] / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png") == len(names)


def test_cells_are_the_means_of_their_episodes():
    rng = np.random.default_rng(5)
    table = pd.DataFrame({"a": rng.integers(0, 3, 60) * 1.5, "b": rng.choice(["x", "y"], 60)})
    table["outcome"] = rng.choice(["walked", "hung"], 60, p=[0.7, 0.3])
    table["m_W"] = rng.standard_normal(60)
    first, second = parameter_axis(table, "a"), parameter_axis(table, "b")
    found = cell_means(measure_values(table, "m_W"), first, second)
    wanted = table[table["outcome"] == "walked"].pivot_table("m_W", "a", "b", aggfunc="mean")
    np.testing.assert_allclose(found, wanted.to_numpy(), rtol=1e-12)
    shares = cell_means(measure_values(table, "walked"), first, second)
    wanted = table.assign(c=table["outcome"] == "walked").pivot_table("c", "a", "b", aggfunc="mean")
    np.testing.assert_allclose(shares, wanted.to_numpy(dtype=float), rtol=1e-12)


def test_bins_hold_every_episode_and_the_last_value():
    table = pd.DataFrame({"a": np.geomspace(0.1, 10.0, 50)})
    axis = parameter_axis(table, "a")
    codes = axis.cat.codes.to_numpy()
    assert codes[0] == 0 and codes[-1] == len(level_names(axis)) - 1
    counts = np.bincount(codes)
    assert counts.sum() == 50 and counts.max() - counts.min() <= 1
    assert parameter_axis(pd.DataFrame({"a": [1.0, 1.0]}), "a") is None


def test_tick_labels_have_no_exponents():
    assert level_names(parameter_axis(pd.DataFrame({"a": [20000.0, 300000.0]}), "a")) == ["20000", "300000"]


def test_a_main_effect_counts_the_runs_that_it_is_the_mean_of():
    """Four episodes at each level; one of the first level walked, three of the second."""
    table = pd.DataFrame({"a": [1.0] * 4 + [2.0] * 4})
    table["outcome"] = ["walked", "fell", "held", "hung", "walked", "walked", "walked", "fell"]
    table["m_W"] = [5.0, 9.0, 9.0, 9.0, 1.0, 2.0, 3.0, 9.0]
    rows = main_effect_rows(table, ["a"], ["walked", "m_W"])
    assert rows[0] == ("measure", "parameter", "level", "episodes", "n", "mean", "SD")
    assert rows[1:] == [
        ("share that walked", "a", "1", "4", "4", "0.25", ""),
        ("share that walked", "a", "2", "4", "4", "0.75", ""),
        ("m [W]", "a", "1", "4", "1", "5", "–"),
        ("m [W]", "a", "2", "4", "3", "2", "1"),
    ]
    figure = draw_main_effects(varying_axes(table, ["a"]), measure_values(table, "m_W"), "m_W", "title")
    labels = [label.get_text() for label in figure.axes[0].get_xticklabels()]
    assert labels == ["1\nn = 1", "2\nn = 3"]


def test_a_hatched_cell_has_episodes_of_which_none_walked():
    table = pd.DataFrame({"a": [1.0, 1.0, 2.0], "b": [1.0, 2.0, 1.0], "m_W": 1.0})
    table["outcome"] = ["walked", "fell", "walked"]  # no episode at (2, 2)
    figure = draw_heat_maps(varying_axes(table, ["a", "b"]), measure_values(table, "m_W"), "m_W", "title")
    (cell,) = figure.axes[0].patches
    assert cell.get_xy() == (-0.5, 0.5) and cell.get_hatch() == "//"
    assert (
        figure.get_suptitle() == "title: m [W]\nhatched: none walked, or none has a value, blank: no episode"
    )


def test_strides_of_all_episodes_are_one_table_also_after_a_resumption(tmp_path: Path) -> None:
    values = {HIP: [10.0, 20.0]}
    document = {"experiment": "bench_leg", "settings": {"duration_s": 5.0}, "method": "grid", "strides": True}
    sweep = sweep_from_mapping({**document, "parameters": values}, "here", tmp_path)
    done = [0]

    def progress(number: int, total: int) -> None:
        done.append(number)

    stopped = run_sweep(
        sweep, tmp_path / "out", pictures=False, progress=progress, should_stop=lambda: done[-1] > 0
    )
    assert len(stopped.table) == 1 == pd.read_csv(tmp_path / "out" / "strides.csv")["episode"].nunique()
    run_sweep(sweep, tmp_path / "out", pictures=False)
    table = pd.read_csv(tmp_path / "out" / "strides.csv")
    assert table["episode"].unique().tolist() == [0, 1] and not (tmp_path / "out" / "strides_parts").exists()
    for episode, hip in enumerate(values[HIP]):
        run = simulate(load_experiment("bench_leg", ["duration_s=5", f"{HIP}={hip}"]).experiment)
        rows = table[table["episode"] == episode].reset_index(drop=True)
        assert len(rows) > 0 and (rows[HIP] == hip).all()
        pd.testing.assert_frame_equal(rows[list(run.strides)], run.strides, rtol=1e-12, check_dtype=False)
