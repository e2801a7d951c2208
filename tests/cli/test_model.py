"""``excite model``: what it shows a person of what changed."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from typer.testing import CliRunner

import excite
from excite.cli.main import app
from excite.cli.results import _relative_change, _shown_changes
from excite.export.models.subject import Change
from excite.logs.files import save_log
from tests.diagnosis.two_joints import moved, two_joint_log
from tests.export.models.identified_folder import known

_BODY = "<inertial><mass value='2'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial>"
_LIMIT = "<axis xyz='0 1 0'/><limit lower='-1' upper='1' velocity='1' effort='90'/>"


def test_digits_are_no_changes_of_what_was_zero() -> None:
    rows = (
        Change("arm", "com_x", "m", 0.2, 0.2),
        Change("arm", "com_y", "m", 0.0, -1e-40),
        Change("arm", "com_z", "m", 0.0, 1e-3),
        Change("arm", "Ixx", "kg·m²", 0.01, 0.01),
        Change("arm", "Ixy", "kg·m²", 0.0, 1e-9),
        Change("elbow", "viscous", "N·m·s/rad", 0.0, 1e-6),
    )
    assert [(row.place, row.parameter) for row in _shown_changes(rows)] == [
        ("arm", "com_z"),
        ("elbow", "viscous"),
    ]


def test_a_change_of_next_to_nothing_is_no_share_of_it() -> None:
    """A centre of mass of 2e-8 m that became 2 mm had grown by 10171486.6 %."""
    said = [
        _relative_change(Change("arm", "com_x", "m", before, 0.002)) for before in (0.0, 2e-8, 0.001, 0.0016)
    ]
    assert said == ["", "", " (+100.0 %)", " (+25.0 %)"]


def test_joints_that_slide_have_their_own_units(tmp_path: Path) -> None:
    robot = tmp_path / "arm.urdf"
    robot.write_text(
        f"<robot name='arm'><link name='root'/><link name='cart'>{_BODY}</link><link name='bar'>{_BODY}</link>"
        f"<joint name='rail' type='prismatic'><parent link='root'/><child link='cart'/>{_LIMIT}</joint>"
        f"<joint name='turn' type='revolute'><parent link='cart'/><child link='bar'/>{_LIMIT}</joint></robot>"
    )
    folder = known(str(robot), tmp_path).folder
    written = excite.write_simulator_model(folder, "mjcf", tmp_path / "out", robot=str(robot))
    units = {(row.place, row.parameter): row.unit for row in written.changes}
    assert [units["rail", term] for term in ("viscous", "coulomb", "armature")] == ["N·s/m", "N", "kg"]
    assert [units["turn", term] for term in ("viscous", "coulomb", "armature")] == [
        "N·m·s/rad",
        "N·m",
        "kg·m²",
    ]


def test_servos_that_nobody_stated_carry_the_robot_and_are_said_to_be_assumed(tmp_path: Path) -> None:
    """What ``excite identify mine.urdf log`` leaves: of the robot no more is known than the URDF and the log say."""
    rng = np.random.default_rng(4)
    trials = [
        moved(name, role, 6.0, rng, np.eye(2))
        for name, role in (("a", "identification"), ("b", "validation"))
    ]
    log = save_log(two_joint_log(tuple(trials)), tmp_path / "log")
    result, urdf = tmp_path / "result", log / "two.urdf"
    done = CliRunner().invoke(app, ["identify", str(urdf), str(log), "--out", str(result)])
    assert done.exit_code == 0, done.exception
    written = excite.write_simulator_model(result, "mjcf", tmp_path / "out")
    for file in (written.folder / written.files[0], result / "identified.xml"):
        model = mujoco.MjModel.from_xml_path(str(file))
        assert model.nu == 2
        assert (model.actuator_gainprm[:, 0] > 5.0).all()
    assert any("servos' gains" in note for note in written.notes)
