"""What must not matter to an identification, or matter in a known way: units, names, order, roles, rate, trials."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.identification.identify import identify
from excite.identification.result import Identification
from excite.logs.log import Log, Trial
from excite.robot.load import load_robot
from excite.robot.robot import Robot
from tests.identification.synthetic import smooth
from tests.made_log import FRICTION, made_log

RATE = 100.0
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
# Of the four joints: viscous and Coulomb friction, zero of the torque sensor, rotor.
VISCOUS, COULOMB = np.array([0.9, 0.7, 0.4, 0.2]), np.array([1.1, 0.9, 0.5, 0.0])
OFFSET, ROTOR = np.array([0.0, 0.8, 0.0, -0.3]), np.array([0.3, 0.2, 0.1, 0.05])
NAMES = ("first", "second", "third", "fourth")


def chain(folder: Path, names: tuple[str, ...] = NAMES, scale: float = 1.0) -> Robot:
    """Four bodies on a table, all masses and inertias times a scale."""
    parts = ['<robot name="chain"><link name="table"/>']
    parent = "table"
    for k, (name, axis) in enumerate(zip(names, AXES, strict=True)):
        mass, child = scale * (6.0 - k), f"{name}_body"
        moments = " ".join(f'i{ends}="{0.02 * mass}"' for ends in ("xx", "yy", "zz"))
        parts.append(
            f'<link name="{child}"><inertial><origin xyz="0.05 0.01 0.12"/><mass value="{mass}"/>'
            f'<inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="revolute">'
            f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 0.25"/><axis xyz="{axis}"/>'
            '<limit lower="-2.5" upper="2.5" effort="500" velocity="10"/></joint>'
        )
        parent = child
    folder.mkdir(exist_ok=True)
    path = folder / "chain.urdf"
    path.write_text("".join([*parts, "</robot>"]))
    return load_robot(path)


def recorded(robot: Robot, *, still: tuple[int, ...] = (), seconds: float = 14.0) -> Log:
    """Two trials of true bodies 10 % off, friction, zeros and rotors; in the first some joints stand."""
    rng = np.random.default_rng(5)
    model = robot.model.copy()
    for body in range(1, model.njoints):
        model.inertias[body] = pin.Inertia.FromDynamicParameters(
            model.inertias[body].toDynamicParameters() * rng.uniform(0.9, 1.1)
        )
    data, trials = model.createData(), []
    for number, role in enumerate(("identification", "validation")):
        time = np.arange(0.0, seconds, 1.0 / RATE)
        q, v, a = smooth(rng, time, np.full(4, 1.4), top_hz=0.6)
        if number == 0:
            q[:, still], v[:, still], a[:, still] = 0.3, 0.0, 0.0
        torque = np.array([pin.rnea(model, data, *sample) for sample in zip(q, v, a, strict=True)])
        torque += VISCOUS * v + COULOMB * np.tanh(v / 0.01) + OFFSET + ROTOR * a
        torque += rng.normal(size=torque.shape) * [0.1, 0.1, 0.05, 0.02]
        trials.append(Trial(name=f"run_{number}", role=role, time=time, q=q, tau=torque))
    return with_trials(trials, list(robot.joint_names))


def with_trials(trials: list[Trial], joints: list[str]) -> Log:
    """A log whose header names friction and rotors and no zeros of sensors, as a converter writes it."""
    return made_log(
        trials,
        joints,
        round(1.0 / float(np.median(np.diff(trials[0].time)))),
        modelled=["rigid_body", *FRICTION, "armature"],
    )


def errors(found: Identification) -> np.ndarray:
    return np.array([fit.rmse for fit in found.validation.values()])


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Robot:
    return chain(tmp_path_factory.mktemp("chain"))


@pytest.fixture(scope="module")
def log(robot) -> Log:
    return recorded(robot)


@pytest.fixture(scope="module")
def found(robot, log) -> Identification:
    return identify(robot, log)


def test_zeros_of_sensors_that_no_header_names_are_found_where_they_are(found):
    drives = found.identified.by_drive()
    for name, value in zip(NAMES, OFFSET, strict=True):
        if value:
            assert drives[f"offset.{name}"] == pytest.approx(value, abs=0.1)
        else:
            assert abs(drives.get(f"offset.{name}", 0.0)) < 0.1
    said = next(item for item in found.findings if item.kind == "drives")
    assert {"offset.second", "offset.fourth"} <= set(said.places) and "offset.second +0.8" in said.text
    for term, values in (("viscous", VISCOUS), ("coulomb", COULOMB)):
        np.testing.assert_allclose([drives.get(f"{term}.{name}", 0.0) for name in NAMES], values, atol=0.05)
    assert abs(drives.get("coulomb.fourth", 0.0)) < 0.02


def test_torques_of_a_sensor_without_zeros_friction_and_rotor_get_none_of_size(robot, log):
    """Measured less what was put in: what is left for drives lies within the noise."""
    trials = []
    for trial in log.trials:
        v = np.gradient(trial.q, trial.time, axis=0)
        a = np.gradient(v, trial.time, axis=0)
        bare = trial.tau - VISCOUS * v - COULOMB * np.tanh(v / 0.01) - OFFSET - ROTOR * a
        trials.append(replace(trial, tau=bare))
    drives = identify(robot, replace(log, trials=tuple(trials))).identified.by_drive()
    sizes = {"viscous": VISCOUS, "coulomb": COULOMB, "offset": OFFSET}
    for term, values in sizes.items():
        left = np.array([drives.get(f"{term}.{name}", 0.0) for name in NAMES])
        assert (np.abs(left) < 0.1 * values.max()).all(), (term, left)
    assert len(drives) < 16


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_the_unit_of_mass_changes_nothing_but_numbers(scale, log, found, tmp_path):
    trials = tuple(replace(trial, tau=scale * trial.tau) for trial in log.trials)
    other = identify(chain(tmp_path, scale=scale), replace(log, trials=trials))
    np.testing.assert_allclose(errors(other), scale * errors(found), rtol=1e-3)
    assert [item.name for item in other.essential] == [item.name for item in found.essential]
    assert other.identified.drive_names == found.identified.drive_names
    np.testing.assert_allclose(
        other.identified.drives, scale * found.identified.drives, rtol=1e-2, atol=1e-3 * scale
    )
    assert [item.link for item in other.changes.segments] == [item.link for item in found.changes.segments]


def test_names_are_only_names(log, found, tmp_path):
    names = ("zulu", "alpha", "mike", "kilo")
    other = identify(chain(tmp_path, names), with_trials(list(log.trials), list(names)))
    np.testing.assert_allclose(other.parameters, found.parameters, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(errors(other), errors(found), rtol=1e-9)


def test_the_order_of_the_columns_is_only_an_order(robot, log, found):
    order = [2, 0, 3, 1]
    trials = [replace(trial, q=trial.q[:, order], tau=trial.tau[:, order]) for trial in log.trials]
    other = identify(robot, with_trials(trials, [NAMES[k] for k in order]))
    for name, fit in found.validation.items():
        assert other.validation[name].rmse == pytest.approx(fit.rmse, rel=1e-3)
    assert set(other.identified.drive_names) == set(found.identified.drive_names)
    np.testing.assert_allclose(other.parameters[:40], found.parameters[:40], rtol=1e-2, atol=1e-3)


def test_half_the_rate_says_the_same(robot, log, found):
    every = np.arange(0, log.trials[0].n_samples, 2)
    other = identify(robot, with_trials([trial.rows(every) for trial in log.trials], list(NAMES)))
    # Half the samples leave √2 times the noise after the same filter.
    assert errors(other).sum() < 1.2 * np.sqrt(2.0) * errors(found).sum()


def test_a_trial_in_two_parts_says_the_same(robot, log, found):
    first, judge = log.trials
    middle = first.n_samples // 2
    parts = [
        replace(first.rows(np.arange(*ends)), name=f"part_{ends[0]}")
        for ends in ((0, middle), (middle, first.n_samples))
    ]
    other = identify(robot, with_trials([*parts, judge], list(NAMES)))
    assert errors(other).sum() < 1.3 * errors(found).sum()


def test_roles_can_be_exchanged(robot, log, found):
    turned = [
        replace(trial, role={"identification": "validation", "validation": "identification"}[trial.role])
        for trial in log.trials
    ]
    other = identify(robot, with_trials(turned, list(NAMES)))
    assert errors(other).sum() < 1.5 * errors(found).sum()


@pytest.mark.parametrize("method", ["adaptive", "wls", "qp"])
def test_a_joint_that_stands_where_one_learns_and_moves_where_one_judges_is_said(robot, method):
    found = identify(robot, recorded(robot, still=(3,)), method)
    assert "fourth" not in found.fit and "fourth" in found.validation
    said = next(item for item in found.findings if item.kind == "no_rows")
    assert said.places == ("fourth",) and "let the joint move" in said.text


@pytest.mark.parametrize("method", ["adaptive", "wls", "ls", "qp"])
def test_fewer_numbers_than_parameters_are_no_failure(robot, log, method):
    """A second and a half of motion: 4 joints, some 20 numbers, 56 parameters."""
    first, judge = log.trials
    short = with_trials([first.rows(np.arange(300, 490)), judge], list(NAMES))
    found = identify(robot, short, method)
    assert found.solved and np.isfinite(found.parameters).all()
    # Nothing is certain of what nothing is left over of.
    assert not found.changes.segments
    if method == "adaptive":
        nominal = np.array([fit.reference_rmse for fit in found.validation.values()])
        assert errors(found).sum() < nominal.sum()
        assert not found.consistency.inconsistent
