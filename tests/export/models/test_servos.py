"""Gains, limits and delays in each simulator's own terms, as other readers find them; names that a format refuses."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

import excite
from excite.errors import InputError
from excite.export.registry import MODEL_FORMATS
from excite.results import write_json
from excite.robot.loading import load_robot, model_file
from excite.simulation.true_parameters import nominal_drives
from tests.export.identified import identification_of
from tests.export.models.foreign import configuration, isaaclab, mjlab, mjlab_model, usd_model, usd_values
from tests.export.models.identified_folder import known
from tests.export.test_results_out import MINE

pytestmark = pytest.mark.usefixtures("readers_here")

LATE = 0.0321
JOINT = "elbow_joint"


def candidate(effect: str, location: str, **parameters: float) -> dict:
    return {
        "effect": effect,
        "location": location,
        "parameters": {
            name: {"value": value, "std": None, "unit": "s"} for name, value in parameters.items()
        },
        "evidence": 100.0,
        "gap_after": 0.1,
        "share_closed": 0.9,
    }


@pytest.fixture
def late(tmp_path: Path) -> Path:
    """A diagnosis that found motors to follow late, and the robot that it wrote."""
    robot = load_robot("ur10")
    text = robot.source.read_text(encoding="utf-8")
    (tmp_path / "better").mkdir()
    (tmp_path / "better" / "robot.yaml").write_text(text, encoding="utf-8")
    if not re.search(r"package:", text):
        shutil.copy(model_file(robot), tmp_path / "better")
    found = candidate("actuator_lag", "torque", time_constant=LATE)
    gap = {"before": 1.0, "after": 0.1, "noise_floor": 0.05, "share_closed": 0.99, "per_channel": {}}
    said = [
        "actuator lag at torque: it stands in augmented.xml alone",
        "encoder offset at elbow_joint: of the reading (0.1), not of the robot; take it off the log",
    ]
    document = {
        "schema": "excite.diagnosis/1",
        "robot": "ur10",
        "verdict": "effect",
        "effect": "actuator_lag",
        "location": "torque",
        "tied_locations": ["torque"],
        "candidates": [found],
        "effects": [found],
        "gap": gap,
        "simulation": None,
        "where": [],
        "next_experiment": None,
        "applied": {"robot": "better/robot.yaml", "written": [], "left_out": said},
    }
    write_json(document, tmp_path / "diagnosis.json")
    return tmp_path


def test_isaac_lab_delays_commands_by_whole_steps(late: Path, tmp_path: Path) -> None:
    written = excite.write_simulator_model(late, "isaaclab", tmp_path / "out")
    group = configuration(tmp_path / "out" / written.files[0], isaaclab()).actuators["joints"]
    assert type(group).__name__ == "DelayedPDActuatorCfg"
    assert (group.min_delay, group.max_delay) == (6, 6)
    assert set(group.actuator_effort_limit) == set(load_robot("ur10").joint_names)
    assert group.joint_effort_limit is None
    assert [item.parameter for item in written.lost] == ["effect"] and "encoder" in written.lost[0].why
    assert any("6 steps of 0.005 s" in note for note in written.notes)


def test_mjlab_delays_commands_by_whole_steps(late: Path, tmp_path: Path) -> None:
    written = excite.write_simulator_model(late, "mjlab", tmp_path / "out")
    cfg = configuration(tmp_path / "out" / written.files[0], mjlab())
    assert {(one.delay_min_lag, one.delay_max_lag) for one in cfg.articulation.actuators} == {(6, 6)}


def test_mujoco_filters_commands(late: Path, tmp_path: Path) -> None:
    written = excite.write_simulator_model(late, "mjcf", tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / written.files[0]))
    data = mujoco.MjData(model)
    data.ctrl[2] = 1.0
    steps = round(LATE / model.opt.timestep)
    for _ in range(steps):
        mujoco.mj_step(model, data)
    assert data.act[2] == pytest.approx(1.0 - np.exp(-1.0), rel=0.01)


@pytest.mark.parametrize("name", [n for n in MODEL_FORMATS if "delay" not in MODEL_FORMATS[n].held])
def test_a_delay_that_a_format_lacks_is_said(name: str, late: Path, tmp_path: Path) -> None:
    lost = excite.write_simulator_model(late, name, tmp_path / "out").lost
    (item,) = (item for item in lost if item.parameter == "delay")
    assert item.value == LATE and not any("actuator lag" in other.why for other in lost)


def test_usd_counts_angles_in_degrees(tmp_path: Path) -> None:
    given = known("ur10", tmp_path)
    out = tmp_path / "out"
    written = excite.write_simulator_model(tmp_path, "usda", out)
    block, degree = usd_values((out / written.files[0]).read_text(), JOINT), np.pi / 180.0
    robot, index = given.robot, given.robot.joint_index(JOINT)
    viscous, coulomb = given.drives[f"viscous.{JOINT}"], given.drives[f"coulomb.{JOINT}"]
    wanted = {
        "drive:angular:physics:stiffness": nominal_drives(robot).kp[index] * degree,
        "drive:angular:physics:damping": nominal_drives(robot).kd[index] * degree,
        "drive:angular:physics:maxForce": robot.limits.torque[index],
        "physxJointAxis:angular:maxJointVelocity": robot.limits.velocity[index] / degree,
        "physxJointAxis:angular:viscousFrictionCoefficient": viscous * degree,
        "physxJointAxis:angular:dynamicFrictionEffort": coulomb,
        "physxJointAxis:angular:staticFrictionEffort": coulomb,
        "newton:damping": viscous * degree,
        "newton:friction": coulomb,
        "newton:armature": given.drives[f"armature.{JOINT}"],
    }
    for attribute, value in wanted.items():
        assert block[attribute] == pytest.approx(value, rel=1e-6), attribute


def test_mjlab_servos_pull_as_the_robots_do(tmp_path: Path) -> None:
    given = known("ur10", tmp_path)
    written = excite.write_simulator_model(tmp_path, "mjlab", tmp_path / "out")
    model = mjlab_model(configuration(tmp_path / "out" / written.files[0], mjlab()))
    whole = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "ur10.xml"))
    for name in given.robot.joint_names:
        ours, theirs = whole.actuator(name), model.actuator(name)
        np.testing.assert_array_equal(ours.gainprm, theirs.gainprm)
        np.testing.assert_array_equal(ours.biasprm, theirs.biasprm)
        np.testing.assert_array_equal(ours.forcerange, theirs.forcerange)


ODD = """<robot name="7-dof arm"><link name="world base"/>
<link name="1st/link"><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.1 0.1 0.4"/></geometry></collision></link>
<link name="1st.link"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="lift+turn" type="revolute"><parent link="world base"/><child link="1st/link"/><axis xyz="-1 0 0"/>
<limit lower="-1" upper="2" effort="50" velocity="3"/></joint>
<joint name="lift.turn" type="prismatic"><parent link="1st/link"/><child link="1st.link"/>
<origin xyz="0 0 0.4" rpy="0.3 -0.2 0.1"/><axis xyz="0.6 0 0.8"/>
<limit lower="0" upper="0.3" effort="20" velocity="1"/></joint></robot>
"""


@pytest.mark.parametrize("name", MODEL_FORMATS)
def test_names_and_axes_of_any_kind_are_taken(name: str, tmp_path: Path) -> None:
    """Signs that patterns, prims and Python give a meaning, two names that become one, a slide along no axis."""
    (tmp_path / "arm.urdf").write_text(ODD, encoding="utf-8")
    given = known(str(tmp_path / "arm.urdf"), tmp_path)
    written = excite.write_simulator_model(tmp_path, name, tmp_path / "out", robot=str(tmp_path / "arm.urdf"))
    assert written.proof.felt > 10
    main = tmp_path / "out" / written.files[0]
    if name == "usda":
        # A slide counts in metres.
        slide = usd_values(main.read_text(), "lift_turn_")
        assert slide["physics:upperLimit"] == pytest.approx(0.3)
        assert slide["newton:damping"] == pytest.approx(given.drives["viscous.lift.turn"])
        model = usd_model(main)
        assert {model.joint(k).name for k in range(model.njnt)} == {"lift+turn", "lift.turn"}
    if name in ("isaaclab", "mjlab"):
        cfg = configuration(main, isaaclab() if name == "isaaclab" else mjlab())
        patterns = list(cfg.init_state.joint_pos)
        assert [[bool(re.fullmatch(p, j)) for j in given.robot.joint_names] for p in patterns] == [
            [True, False],
            [False, True],
        ]


def test_a_document_says_what_is_lost_and_what_was_proved(tmp_path: Path) -> None:
    known("ur10", tmp_path)
    excite.write_simulator_model(tmp_path, "urdf", tmp_path / "out")
    document = json.loads((tmp_path / "out" / "model.json").read_text())
    assert {row["parameter"] for row in document["lost"]} == {"armature", "kp", "kd"}
    assert document["proof"]["torque_error"] < 1e-9


def test_mjlab_keeps_a_text_of_ones_own_and_drops_its_motors_when_it_is_read(tmp_path: Path) -> None:
    mine = tmp_path / "mine.xml"
    mine.write_text(MINE, encoding="utf-8")
    given = known(str(mine), tmp_path)
    written = excite.write_simulator_model(tmp_path, "mjlab", tmp_path / "out", robot=str(mine))
    (xml,) = (name for name in written.files if name.endswith(".xml"))
    text = (tmp_path / "out" / xml).read_text()
    assert "of the workshop, 2024" in text and text.count("<motor ") == 3
    model = mjlab_model(configuration(tmp_path / "out" / written.files[0], mjlab()))
    assert model.nu == 3
    places = [model.joint(name).dofadr[0] for name in given.robot.joint_names]
    np.testing.assert_array_equal(model.dof_damping[places], given.term("viscous"))
    np.testing.assert_array_equal(model.dof_armature[places], given.term("armature"))


def test_a_result_in_memory_gives_the_files_of_the_one_on_disk(tmp_path: Path) -> None:
    given = known("ur10", tmp_path)
    found = identification_of(given.robot, given.parameters, given.drives)
    excite.write_simulator_model(tmp_path, "usda", tmp_path / "disk")
    for out, robot in (("named", "ur10"), ("loaded", given.robot), ("unsaid", None)):
        excite.write_simulator_model(found, "usda", tmp_path / out, robot=robot)
        assert (tmp_path / out / "ur10.usda").read_bytes() == (tmp_path / "disk" / "ur10.usda").read_bytes()
    with pytest.raises(InputError, match="of another robot than go2"):
        excite.write_simulator_model(found, "usda", tmp_path / "other", robot="go2")
