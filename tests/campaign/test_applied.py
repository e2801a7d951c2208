"""The robot with the effects of a diagnosis in it, and the diagnosis that follows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from excite.campaign import applied as apply
from excite.campaign.applied import Applied, apply_effects, check_applicable
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.answer.candidate import RobotChanges
from excite.diagnosis.diagnose import diagnose
from excite.errors import InputError, RobotError
from excite.logs.files import load_log, save_log
from excite.logs.log import Trial
from excite.logs.robot import nominal_robot, robot_for_log
from excite.robot import load as bringing
from excite.robot.loading import load_robot
from excite.robot.robot import Robot
from tests.diagnosis.few_trials import few_trials
from tests.diagnosis.test_command_only import controller_of, without_torque
from tests.identification.practice_log import arm_log, changed
from tests.report.diagnosed import ambiguous, two_joints_diagnosed
from tests.reproduction.emps import emps_log
from tests.reproduction.real_robots.entry import RIGID, with_modelled

LOAD = pin.Inertia(1.5, np.array([0.05, 0.02, 0.06]), np.diag([0.004, 0.005, 0.003]))
VISCOUS, COULOMB = 3.0, 4.0


def rubbed(trial: Trial) -> Trial:
    """Viscous friction at the shoulder's lift, dry friction at the elbow."""
    v = np.gradient(trial.q, trial.time, axis=0)
    made = VISCOUS * v * np.eye(6)[1] + COULOMB * np.tanh(v / 0.01) * np.eye(6)[2]
    return replace(trial, tau=trial.tau + made)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A UR10 with a load at its wrist and friction at two joints, of which its model knows nothing."""
    robot = load_robot("ur10")
    true = robot.nominal_parameters.copy()
    true[50:60] += LOAD.toDynamicParameters()
    log = changed(arm_log(robot, 3, duration=10.0, torque="link_side", trials=3, true=true), rubbed)
    header = log.header.model_copy(update={"modelled": ("rigid_body_fixed",), "torque": "motor_side"})
    return save_log(replace(log, robot_text=robot.urdf, header=header), tmp_path_factory.mktemp("log"))


@pytest.fixture(scope="module")
def first(folder: Path) -> Diagnosis:
    return diagnose(folder)


@pytest.fixture(scope="module")
def again(folder: Path, applied: Applied) -> Diagnosis:
    return diagnose(folder, robot_for_log(applied.robot, folder))


@pytest.fixture(scope="module")
def applied(folder: Path, first: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Applied:
    assert {item.effect for item in first.effects} == {"payload", "coulomb_friction", "viscous_friction"}
    return apply_effects(first, nominal_robot(load_log(folder)), tmp_path_factory.mktemp("robot"))


def test_what_was_found_is_where_a_description_holds_it(applied: Applied) -> None:
    said = yaml.safe_load(applied.robot.read_text())["drives"]
    assert said["found"] is True and "armature" not in said
    assert said["viscous"]["joints"] == {"shoulder_lift_joint": pytest.approx(VISCOUS, rel=0.01)}
    assert said["coulomb"]["joints"] == {"elbow_joint": pytest.approx(COULOMB, rel=0.01)}
    inertias = load_robot(applied.robot).model.inertias
    heavy, before = inertias[6], load_robot("ur10").model.inertias[6]
    assert heavy.toDynamicParameters() == pytest.approx((before + LOAD).toDynamicParameters(), abs=2e-3)
    # Other links are as they were.
    for new, old in zip(inertias[1:6], load_robot("ur10").model.inertias[1:6], strict=True):
        assert new.toDynamicParameters() == pytest.approx(old.toDynamicParameters(), rel=1e-9, abs=1e-12)
    assert applied.left_out == ()
    assert any("wrist_3_link: +1.5 kg" in text for text in applied.written)


def test_the_next_diagnosis_finds_nothing(again: Diagnosis) -> None:
    assert (again.verdict, again.effects) == ("none", ())
    assert again.gap.before < 1.2 * again.gap.noise_floor


def test_the_next_simulator_is_the_last_one_with_its_effects(first: Diagnosis, again: Diagnosis) -> None:
    old, new = first.simulation, again.simulation
    assert old is not None and new is not None
    for name, after in old.after.items():
        assert new.before[name] == pytest.approx(after, rel=0.4)
        assert new.before[name] < 0.2 * old.before[name]


def test_joints_that_are_held_stay_held(first: Diagnosis, tmp_path: Path) -> None:
    robot = load_robot("ur10")
    text = robot.urdf.replace(
        "</robot>",
        '<link name="hook"/><joint name="latch" type="revolute"><parent link="wrist_3_link"/><child link="hook"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>',
    )
    (tmp_path / "held.urdf").write_text(text)
    content = robot.description.model_dump(mode="json", by_alias=True, exclude_unset=True)
    content["model"] = {"path": "held.urdf", "source": "a test"}
    content["locked_joints"] = {"latch": 0.3}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    written = apply_effects(first, load_robot(tmp_path / "robot.yaml"), tmp_path / "out")
    assert load_robot(written.robot).joint_names == robot.joint_names


def test_what_was_written_wrongly_is_found_as_a_rest(folder: Path, applied: Applied, tmp_path: Path) -> None:
    """Drives marked as found are taken as given: a part of the friction is left to be named."""
    content = yaml.safe_load(applied.robot.read_text())
    content["drives"]["coulomb"]["joints"]["elbow_joint"] = 0.6 * COULOMB
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    (tmp_path / "robot.urdf").write_text((applied.robot.parent / "robot.urdf").read_text())
    (rest,) = diagnose(folder, robot_for_log(tmp_path / "robot.yaml", folder)).effects
    assert (rest.effect, rest.location) == ("coulomb_friction", "elbow_joint")
    assert rest.parameters["level"].value == pytest.approx(0.4 * COULOMB, rel=0.03)
    # A guess about a type of robot is no part of the model.
    content["drives"]["found"] = False
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content))
    found = diagnose(folder, robot_for_log(tmp_path / "robot.yaml", folder)).effects
    assert max(e.parameters["level"].value for e in found if "level" in e.parameters) == pytest.approx(
        COULOMB, rel=0.02
    )


def test_what_no_description_holds_is_a_line(tmp_path: Path) -> None:
    robot = load_robot("ur10")
    line = "backlash at elbow_joint: it stands in augmented.xml alone"
    changes = (RobotChanges(), RobotChanges(), RobotChanges(coulomb={"elbow_joint": 2.0}, beyond=(line,)))
    found = replace(two_joints_diagnosed(), changes=changes)
    applied = apply_effects(found, robot, tmp_path)
    assert applied.left_out == (line,)
    assert applied.summary().splitlines()[1:] == [
        "  coulomb [N·m]: elbow_joint 2",
        f"  not in it: {line}",
        "  a diagnosis with this robot finds again what is not in it",
    ]
    assert applied.to_json() == {
        "robot": str(tmp_path / "robot.yaml"),
        "written": ["coulomb [N·m]: elbow_joint 2"],
        "left_out": [line],
    }


def test_a_joint_that_slides_has_units_of_its_own(tmp_path: Path) -> None:
    body = (
        "<inertial><mass value='2'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial>"
    )
    limit = "<axis xyz='0 0 1'/><limit lower='-1' upper='1' velocity='1' effort='90'/>"
    (tmp_path / "arm.urdf").write_text(
        f"<robot name='arm'><link name='root'/><link name='cart'>{body}</link><link name='bar'>{body}</link>"
        f"<joint name='lift' type='prismatic'><parent link='root'/><child link='cart'/>{limit}</joint>"
        f"<joint name='turn' type='revolute'><parent link='cart'/><child link='bar'/>{limit}</joint></robot>"
    )
    changes = RobotChanges(coulomb={"lift": 3.0, "turn": 2.0}, armature={"lift": 4.0})
    said = apply._describe_changes(changes, bringing.load_robot(str(tmp_path / "arm.urdf")))
    assert said == ["coulomb [N·m]: turn 2", "coulomb [N]: lift 3", "armature [kg]: lift 4"]


def test_what_the_record_cannot_tell_apart_is_said(tmp_path: Path) -> None:
    found = replace(ambiguous(two_joints_diagnosed()), changes=(RobotChanges(), RobotChanges()))
    (line,) = apply_effects(found, load_robot("ur10"), tmp_path).written
    assert line == (
        "joint spring at shoulder was taken, which this record cannot tell from torque bias at shoulder"
    )


def test_a_diagnosis_that_says_nothing_of_a_robot_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no effects that could be written"):
        apply_effects(two_joints_diagnosed(), load_robot("ur10"), tmp_path / "robot")
    assert not (tmp_path / "robot").exists()


def test_a_load_whose_moments_no_body_has_gets_the_nearest_that_one_can_have(tmp_path: Path) -> None:
    """A lump on a light wrist, of which a record tells mass and place far better than moments of inertia."""
    load = pin.Inertia(0.5, np.array([0.0, 0.02, 0.05]), np.diag([0.0, 0.0, 0.004]))
    changes = RobotChanges(bodies={"wrist_3_link": load.toDynamicParameters()})
    found = replace(two_joints_diagnosed(), effects=(), changes=(changes,))
    applied = apply_effects(found, load_robot("ur10"), tmp_path)
    assert "wrist_3_link: no body has the moments of inertia found" in applied.summary()
    robot = load_robot(applied.robot)
    # Mass and its moment, which gravity tells, are as they were found.
    more = (robot.nominal_parameters - load_robot("ur10").nominal_parameters)[50:54]
    np.testing.assert_allclose(more, load.toDynamicParameters()[:4], atol=1e-9)


def test_a_robot_that_cannot_be_is_not_left_behind(tmp_path: Path) -> None:
    """A load that its drives cannot hold up."""
    heavy = RobotChanges(
        bodies={"wrist_3_link": pin.Inertia(900.0, np.zeros(3), np.eye(3)).toDynamicParameters()}
    )
    found = replace(two_joints_diagnosed(), effects=(), changes=(heavy,))
    with pytest.raises(
        RobotError, match=r"^ur10: .*with what was found it is no robot .*; diagnose without --apply"
    ):
        apply_effects(found, load_robot("ur10"), tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_free_base_is_refused_before_any_work(g1: Robot) -> None:
    check_applicable(load_robot("ur10"))
    with pytest.raises(InputError, match=r"--apply: g1 has a free base"):
        check_applicable(g1)


@pytest.mark.slow
def test_a_servo_keeps_the_model_that_it_had(gap_dir: Path, tmp_path: Path) -> None:
    """Commands and positions alone: the feedforward was made without the load, whatever the next round's model has."""
    log = few_trials(load_log(gap_dir / "arm" / "case_003"), 1)
    robot = nominal_robot(log)
    log = without_torque(log, controller_of(log, robot) | {"feedforward": "inverse_dynamics"})
    found = diagnose(log, robot)
    assert (found.effect, found.location) == ("payload", "link6")
    applied = apply_effects(found, robot, tmp_path)
    assert log.folder is not None
    rest = diagnose(log, robot_for_log(applied.robot, log.folder))
    assert (rest.verdict, rest.effects) == ("none", ())
    assert rest.gap.before < 0.05 * found.gap.before


@pytest.mark.slow
def test_a_real_axis_has_no_friction_left_in_the_second_round(data_dir: Path, tmp_path: Path) -> None:
    """EMPS: published viscous friction 203.5 N·s/m and dry friction 20.4 N, which the log does not call modelled."""
    log = with_modelled(emps_log(data_dir, tmp_path, split=2 / 3), (*RIGID, "torque_bias"))
    found = diagnose(log)
    assert {item.effect for item in found.effects} == {"coulomb_friction", "viscous_friction"}
    applied = apply_effects(found, nominal_robot(log), tmp_path / "robot")
    assert applied.left_out == ()
    drives = load_robot(applied.robot).description.drives
    assert drives.coulomb is not None and drives.coulomb.joints["slide"] == pytest.approx(20.4, rel=0.1)
    assert drives.viscous is not None and drives.viscous.joints["slide"] == pytest.approx(203.5, rel=0.1)
    assert log.folder is not None
    rest = diagnose(log, robot_for_log(applied.robot, log.folder))
    assert (rest.verdict, rest.effects) == ("none", ())
    assert rest.gap.per_channel["slide"].before == pytest.approx(
        found.gap.per_channel["slide"].after, rel=0.05
    )


def test_a_robot_that_only_a_log_described_can_move_then(applied: Applied) -> None:
    """A log says nothing of servos or of how fast joints may go: placeholders would let the arm hang."""
    robot = load_robot(applied.robot)
    assert robot.description.limits.acceleration.source != "not stated in the log"
    assert robot.limits.acceleration.max() < 100.0
    assert min(robot.description.controller.kp.joints.values()) > 10.0
    assert set(robot.description.controller.kp.joints) == set(robot.joint_names)
    assert robot.description.assumed
