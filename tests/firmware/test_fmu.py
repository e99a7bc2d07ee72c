"""Tests of the functional mock-up units: they are valid, and their loop has the bits of the simulation."""

from __future__ import annotations

import json
import math
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from errors import raises

pytest.importorskip("fmpy", reason="needs FMPy: pip install 'twin-gait[test]'")

from fmpy import simulate_fmu
from fmpy.model_description import read_model_description
from fmpy.validation import validate_fmu
from fmu_tools import Instance, extract, run_loop, write_both

from twin_gait import load_experiment, simulate
from twin_gait.cli.program import main
from twin_gait.core.control_tick import COLUMNS_PER_JOINT
from twin_gait.exceptions import FirmwareError
from twin_gait.firmware.fmu import base_units
from twin_gait.firmware.fmu_plant import plant_fmu
from twin_gait.gait.guards import map_atoms
from twin_gait.simulation.simulation_setup import build_setup
from twin_gait.simulation.stepping import SteppedRun

JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
LOG = {  # columns of the log by the variables of the FMUs
    **{f"{joint}.position": f"{joint}_angle_rad" for joint in JOINTS},
    **{f"{joint}.velocity": f"{joint}_velocity_rad_per_s" for joint in JOINTS},
    **{f"{joint}.target_current": f"{joint}_target_current_A" for joint in JOINTS},
    "bus_voltage": "bus_voltage_V",
}


def loaded(name, *changes, duration=2.0):
    return replace(load_experiment(name, list(changes)).experiment, duration=duration)


def log_of(run, names):
    return run.log[[LOG[name] for name in names]].to_numpy()


@pytest.fixture(scope="module")
def experiment():
    return loaded("treadmill_guided")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the folder that the command writes."""
    out = tmp_path_factory.mktemp("command") / "fmus"
    assert main(["firmware", "treadmill_guided", "--target", "fmu", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def fmus(written):
    return [extract(written / f"{name}.fmu") for name in ("controller", "plant")]


@pytest.fixture
def instances(fmus):
    return Instance(fmus[0]), Instance(fmus[1])


def test_fmpy_validates_and_runs_both_without_a_message(fmus, capfd):
    for folder in fmus:
        assert validate_fmu(str(folder)) == []
        assert simulate_fmu(str(folder), stop_time=0.01)["time"][-1] == pytest.approx(0.01)
    assert capfd.readouterr() == ("", "")


def test_the_loop_has_the_bits_of_the_simulation(experiment, instances):
    run, names = simulate(experiment), list(LOG)
    assert run.log["left_phase"].nunique() == 5  # all phases of the table
    assert np.array_equal(run_loop(*instances, experiment.n_ticks, names), log_of(run, names))


def test_parameters_at_the_start_are_those_of_the_table(experiment, instances):
    controller, setup = instances[0], build_setup(experiment)
    for leg, side in enumerate(setup.sides):
        for phase, row in zip(setup.table.phase_names, setup.phase_rows[leg], strict=True):
            for joint, numbers in zip(
                setup.table.joints, row[:-1].reshape(-1, COLUMNS_PER_JOINT), strict=True
            ):
                names = ("stiffness", "damping", "equilibrium", "gain")
                found = [controller[f"{side}_{joint}.{phase}.{name}"] for name in names]
                assert found == numbers.tolist()
            assert controller[f"{side}_leg.{phase}.gravity_share"] == row[-1]
    # "hip.angle_deg < 6.0" of the table, which its scaling leaves as it is.
    assert controller["threshold.early_stance.middle_stance.loaded"] == pytest.approx(math.radians(6.0))
    assert controller["threshold.late_stance.swing_flexion.trailing_limb_2"] == 0.094


def test_changed_parameters_act_as_in_the_table(fmus, experiment):
    """Stiffness and gain of a phase, and a threshold, set before the start, against a changed table."""
    table, cause = experiment.table, "clearance"
    phase = table.phases["middle_stance"]
    knee = replace(phase.joints["knee"], friction_compensation_gain=0.9)
    phases = {**table.phases, "middle_stance": replace(phase, joints={**phase.joints, "knee": knee})}

    def move(atom):
        return replace(atom, threshold=25.0) if atom.signal == "hip.angle_deg" else atom

    rules = [
        replace(rule, guard=map_atoms(rule.guard, move)) if rule.cause == cause else rule
        for rule in table.transitions
    ]
    changed = replace(experiment, table=replace(table, phases=phases, transitions=tuple(rules)))
    parameters = {f"{side}_knee.middle_stance.gain": 0.9 for side in ("left", "right")}
    parameters["threshold.swing_flexion.swing_extension.clearance"] = math.radians(25.0)
    names = list(LOG)
    found = run_loop(Instance(fmus[0], parameters), Instance(fmus[1]), experiment.n_ticks, names)
    assert np.array_equal(found, log_of(simulate(changed), names))
    assert not np.array_equal(found, log_of(simulate(experiment), names))


def test_parameters_that_change_during_a_walk_act_at_once(experiment, instances):
    """The controller in a walk, changed after 0.7 s and again after 0.9 s, against a run that is changed."""
    controller, plant = instances
    setup, names = build_setup(experiment), list(LOG)
    run = SteppedRun(setup)
    found, rows = [], np.array(run.numbers["phase_rows"])
    for begin, end in ((0, 700), (700, 900), (900, 1200)):
        run.advance(end - begin)
        found.append(run_loop(controller, plant, end - begin, names))
        rows = 1.1 * rows
        run.set({**run.numbers, "phase_rows": rows.tolist(), "belt_speed": 0.5}, fade_ticks=0)
        plant["belt_speed"] = 0.5
        for leg, side in enumerate(setup.sides):
            for phase, row in zip(setup.table.phase_names, rows[leg], strict=True):
                for joint, numbers in zip(setup.table.joints, row[:-1].reshape(-1, 4), strict=True):
                    for name, value in zip(
                        ("stiffness", "damping", "equilibrium", "gain"), numbers, strict=True
                    ):
                        controller[f"{side}_{joint}.{phase}.{name}"] = value
                controller[f"{side}_leg.{phase}.gravity_share"] = row[-1]
    expected = run.rows()[:, [run.layout.names.index(LOG[name]) for name in names]]
    assert np.array_equal(np.concatenate(found), expected)


def test_instances_in_one_process_are_independent(fmus):
    name = "left_hip.early_stance.stiffness"
    first, second = Instance(fmus[0], {name: 10.0}), Instance(fmus[0], {name: 20.0})
    assert (first[name], second[name]) == (10.0, 20.0)
    for item in (first, second):
        item.step()
    phase = first["left_leg.phase"]
    assert phase == 0 and (first["left_hip.stiffness"], second["left_hip.stiffness"]) == (10.0, 20.0)


def test_a_restored_state_continues_with_the_same_bits(instances):
    controller, plant = instances
    names = ["left_hip.position", "left_hip.target_current"]
    run_loop(controller, plant, 50, names)
    states = [item.fmu.getFMUstate() for item in instances]
    first = run_loop(controller, plant, 50, names)
    for item, state in zip(instances, states, strict=True):
        saved = item.fmu.serializeFMUstate(state)
        item.fmu.setFMUstate(item.fmu.deSerializeFMUstate(saved))
    assert np.array_equal(run_loop(controller, plant, 50, names), first)
    for item in instances:
        item.fmu.reset()
    assert plant.fmu.getReal([plant.variables["left_hip.position"].valueReference])[0] != first[-1, 0]


def test_outputs_are_valid_before_the_first_step(instances, experiment):
    (_, plant), first = instances, simulate(experiment).log.iloc[0]
    for joint in JOINTS:
        assert plant[f"{joint}.position"] == first[f"{joint}_angle_rad"] != 0.0
        assert plant[f"{joint}.angle"] == pytest.approx(plant[f"{joint}.position"], abs=1e-4)
    assert plant["bus_voltage"] == first["bus_voltage_V"] > 0.0


def test_a_step_of_several_ticks_holds_the_inputs(fmus):
    one, many = Instance(fmus[1]), Instance(fmus[1])
    for item in (one, many):
        item["left_hip.target_current"] = 2.0
    for _ in range(10):
        one.step()
    many.step(0.01)
    assert one["left_hip.position"] == many["left_hip.position"]


@pytest.mark.parametrize("size", [0.0005, 0.0, -0.001, 0.00125, math.nan])
def test_other_steps_are_rejected(instances, size, capfd):
    with pytest.raises(Exception, match="fmi2DoStep"):
        instances[0].step(size)
    assert "multiple of 1 ms" in "".join(capfd.readouterr())


def test_an_output_cannot_be_set(instances):
    with pytest.raises(Exception, match="fmi2SetReal"):
        instances[0]["left_hip.torque"] = 1.0


@pytest.mark.parametrize("phase", [-1, 5, 2**31 - 1])
def test_a_phase_that_the_table_does_not_have_is_rejected(instances, phase, capfd):
    plant = instances[1]
    with pytest.raises(Exception, match="fmi2SetInteger"):
        plant["left_leg.phase"] = phase
    assert "limits" in "".join(capfd.readouterr())
    found = {item.name: item for item in plant.variables.values()}["left_leg.phase"]
    assert (int(found.min), int(found.max)) == (0, 4)


def test_the_status_has_the_codes_of_the_simulation(fmus):
    found = {item.name: item for item in read_model_description(str(fmus[1])).modelVariables}
    assert "0 walking, 1 fell, 2 diverged, 3 tipped, 4 lost a crutch" in found["status"].description


def test_the_command_does_not_verify_units(tmp_path, capsys):
    words = ["firmware", "treadmill_guided", "--target", "fmu", "--verify", "--out", str(tmp_path / "fmus")]
    assert main(words) == 2
    assert "--verify" in capsys.readouterr().err and not (tmp_path / "fmus").exists()


def test_units_and_descriptions(fmus):
    found = {item.name: item for item in read_model_description(str(fmus[0])).modelVariables}
    stiffness = found["left_knee.late_stance.stiffness"]
    assert (stiffness.unit, stiffness.variability, stiffness.causality) == ("N.m/rad", "tunable", "parameter")
    assert found["left_knee.angle"].unit == "rad" and found["left_knee.angle"].displayUnit == "deg"
    assert "3 swing_flexion" in found["left_leg.phase"].description
    assert all(item.description for item in found.values())
    # The damping b = τ/ω: kg·m²/s² over rad/s.
    assert base_units("N.m.s/rad") == {"kg": 1, "m": 2, "s": -1, "rad": -1}
    assert base_units("V") == {"kg": 1, "m": 2, "s": -3, "A": -1}


def test_the_command_writes_sources_and_states_the_numbers_of_variables(written):
    manifest = json.loads((written / "manifest.json").read_text())
    assert manifest["missing"] == {} and list(manifest["fmus"]) == ["controller.fmu", "plant.fmu"]
    for name, counts in manifest["fmus"].items():
        with zipfile.ZipFile(written / name) as archive:
            files = set(archive.namelist())
            text = archive.read("modelDescription.xml").decode()
        assert {"sources/fmu.c", "sources/real.h", "resources/experiment.yaml"} < files
        assert text.count('causality="input"') == counts["inputs"] > 0


@pytest.mark.parametrize(
    ("changes", "facts"),
    [
        (["faults=[motor_stuck:left_knee@1s]"], ["faults"]),
        (["sensors.ideal=false", "sensors.angle_noise_rad=0.0001"], ["sensors.angle_noise_rad"]),
    ],
)
def test_plants_without_an_fmu_are_rejected_by_key(changes, facts):
    with raises(FirmwareError, *facts):
        plant_fmu(load_experiment("treadmill_guided", changes).experiment)


def test_a_person_who_announces_steps_has_no_fmu():
    changes = ["sensors.ideal=true", "scenario.arms.pattern=four_point"]
    with raises(FirmwareError, "scenario.arms.pattern", "four_point", "as_needed"):
        plant_fmu(load_experiment("overground", changes).experiment)


OTHERS = (
    *("bench_leg", "treadmill_ankle", "treadmill_start_stop", "overground", "sit_to_stand", "stand_to_sit"),
    *("hip_exoskeleton", "knee_orthosis", "osl_prosthesis", "sup_prosthesis"),
    "treadmill_guided integration.method=semi_implicit_euler",
    "treadmill_guided patient=incomplete_sci patient.effort_noise=0",
    "treadmill_guided scenario.support.pitch=soft",
    "treadmill_guided scenario.support.pitch=soft interface=brace",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_other_experiments_have_the_bits_of_the_simulation(name, tmp_path):
    experiment = loaded(*name.split())
    folders = write_both(experiment, tmp_path)
    controller, plant = map(Instance, folders)
    assert all(validate_fmu(str(folder)) == [] for folder in folders)
    names = [item for item in LOG if item in plant.variables or item in controller.variables]
    run = simulate(experiment)
    assert np.array_equal(run_loop(controller, plant, experiment.n_ticks, names), log_of(run, names))
