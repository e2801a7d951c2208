"""A load from logs without and with it: by a calibration load, by its own mass, by the log's constants."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from excite.errors import InputError, LogError
from excite.identification.load import weigh_load
from excite.logs.files import save_log
from excite.robot.loading import load_robot
from excite.rows.settings import ProblemSettings
from tests.identification.practice_log import arm_log, changed
from tests.identification.synthetic import add_body

GAINS = np.array([14.9, 13.3, 11.1, 10.6, 11.0, 11.5])
CALIBRATION, MASS, AT = 2.5, 1.6, np.array([0.03, 0.1, -0.12])
SETTINGS = ProblemSettings(cutoff_hz=5.0)


@pytest.fixture(scope="module")
def robot():
    return load_robot("ur10")


@pytest.fixture(scope="module")
def logs(robot):
    """Currents without a load, with one of 2.5 kg, and with one of 1.6 kg, by other motions."""
    bare = robot.nominal_parameters * 1.05
    made = []
    for seed, mass in ((3, 0.0), (3, CALIBRATION), (4, MASS)):
        true = bare.copy()
        if mass:
            true[-10:] = add_body(true[-10:], mass, AT, 0.06)
        log = arm_log(robot, seed, true=true, trials=2)
        made.append(changed(log, lambda t: replace(t, tau=None, current=t.tau / GAINS), torque="current"))
    return made


@pytest.fixture(scope="module")
def weighed(robot, logs):
    """The load of 1.6 kg, by that of 2.5 kg."""
    bare, known, unknown = logs
    return weigh_load(robot, bare, unknown, calibration=(known, CALIBRATION), settings=SETTINGS)


def test_a_calibration_load_tells_gains_and_load_within_their_intervals(weighed):
    found = weighed
    truth = add_body(np.zeros(10), MASS, AT, 0.06)
    told = found.determined
    assert told[:4].all()
    inside = np.abs(found.parameters - truth)[told] < found.half_width_95[told]
    assert inside[:4].all() and inside.mean() >= 0.8
    assert found.half_width_95[0] < 0.1 and abs(found.mass - MASS) < 0.05
    np.testing.assert_allclose(found.center, AT, atol=0.02)
    np.testing.assert_allclose(list(found.gains.values()), GAINS, rtol=0.03)


def test_friction_that_grows_with_the_load_is_no_load(robot, logs, weighed):
    """Harmonic drives lose some hundredths of what they carry: taken into account where it is there, and only there."""

    def losing(log):
        def lost(trial):
            torque = trial.current * GAINS
            way = np.sign(np.gradient(trial.q, trial.time, axis=0))
            return replace(trial, current=(torque + 0.08 * np.abs(torque) * way) / GAINS)

        return replace(log, trials=tuple(lost(trial) for trial in log.trials))

    bare, known, unknown = (losing(log) for log in logs)
    found = weigh_load(robot, bare, unknown, calibration=(known, CALIBRATION), settings=SETTINGS)
    assert "load_friction" in found.drive_terms and "grows with the load" in found.summary()
    assert abs(found.mass - MASS) < found.half_width_95[0]
    plain = replace(SETTINGS, drive_terms=tuple(n for n in found.drive_terms if n != "load_friction"))
    stated = weigh_load(robot, bare, unknown, calibration=(known, CALIBRATION), settings=plain)
    assert found.half_width_95[0] < 0.9 * stated.half_width_95[0]
    assert "load_friction" not in weighed.drive_terms


def test_a_stated_mass_stays_and_is_said_to_be_stated(robot, logs):
    found = weigh_load(robot, logs[0], logs[1], mass=CALIBRATION, settings=SETTINGS)
    assert found.mass == CALIBRATION and found.half_width_95[0] == 0.0 and found.determined[0]
    assert "(stated)" in found.summary() and "2.5 kg" in found.gains_source


@pytest.mark.parametrize("mass", [400.0, 0.02])
def test_a_mass_that_makes_the_bare_robot_another_one_is_refused(robot, logs, mass):
    with pytest.raises(InputError, match="which makes the bare robot weigh"):
        weigh_load(robot, logs[0], logs[1], mass=mass, settings=SETTINGS)


def test_constants_of_the_log_are_believed_and_missing_ones_are_named(robot, logs):
    stated = [
        replace(log, header=log.header.model_copy(update={"torque_constants": constants()})) for log in logs
    ]
    found = weigh_load(robot, stated[0], stated[2], settings=SETTINGS)
    assert abs(found.mass - MASS) < 0.02 * MASS
    with pytest.raises(LogError, match="has no gain"):
        weigh_load(robot, logs[0], logs[2], settings=SETTINGS)


def test_what_the_motions_do_not_tell_is_said(robot):
    """An arm that only turns about its vertical first axis says nothing of a load's height."""
    still = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    def turning(log):
        return replace(log, trials=tuple(replace(t, q=t.q[0] + (t.q - t.q[0]) * still) for t in log.trials))

    pair = [turning(arm_log(robot, 3, true=robot.nominal_parameters, trials=2)) for _ in range(2)]
    found = weigh_load(robot, *pair, settings=SETTINGS)
    assert not found.determined[0] and found.center is None
    assert "do not tell m" in found.summary()


def test_contradictions_are_refused(robot, logs):
    with pytest.raises(InputError, match="calibration load"):
        weigh_load(robot, logs[0], logs[2], mass=1.0, calibration=(logs[1], 2.0))
    with pytest.raises(InputError, match="weigh it"):
        weigh_load(robot, logs[0], logs[2], calibration=(logs[1], -2.0))


def test_the_command_writes_the_load(robot, logs, tmp_path, excite_here):
    names = ["bare", "known", "unknown"]
    for name, log in zip(names, logs, strict=True):
        stated = log.header.model_copy(update={"torque_constants": constants()})
        save_log(replace(log, header=stated, robot_text=robot.urdf), tmp_path / name)
    done = excite_here(
        "identify-load", "ur10", tmp_path / "bare", tmp_path / "unknown", "--calibration", tmp_path / "known",
        "--calibration-mass", "2.5", "--format", "ur", "--out", tmp_path / "out", "--json", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out" / "load.json").read_text())
    assert document == json.loads(done.stdout)
    assert document["schema"] == "excite.load/1"
    assert abs(document["parameters"]["m"]["value"] - MASS) < 0.05
    assert (tmp_path / "out" / "load.script").read_text() == document["controller"]["text"]
    assert document["controller"]["mass"] == document["parameters"]["m"]["value"]
    lone = excite_here("identify-load", "ur10", "bare", "unknown", "--calibration-mass", "2", cwd=tmp_path)
    assert lone.returncode == 4 and lone.stderr.count("\n") == 1 and "give both" in lone.stderr


def constants():
    return dict(zip(load_robot("ur10").joint_names, GAINS.tolist(), strict=True))
