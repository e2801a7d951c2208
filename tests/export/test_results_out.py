"""Written models in other people's simulators: their mass matrices are those of the identified parameters."""

from __future__ import annotations

import difflib
import json
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.cli import main as command_line
from excite.export.models.simulator_model import write_models
from excite.logs.files import save_log
from excite.robot.catalogue import bundled_robots
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import build_robot, load_robot, model_file
from excite.robot.robot import Robot
from excite.simulation.true_parameters import scattered_parameters
from tests.export.identified import identification_of
from tests.identification.practice_log import arm_log

pytestmark = pytest.mark.usefixtures("readers_here")

# A user's own model: defaults, geometry, comments and names that no converter would write.
MINE = """<mujoco model="mine">
  <!-- of the workshop, 2024 -->
  <compiler angle="radian" autolimits="true"/>
  <default><geom density="1200" rgba=".8 .8 .8 1"/></default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="base">
      <geom name="foot" type="cylinder" size=".1 .05"/>
      <body name="upper" pos="0 0 .1">
        <joint name="lift" axis="0 1 0" range="-2 2" damping="0.2"/>
        <geom name="tube" type="capsule" fromto="0 0 0 0 0 .4" size=".04"/>  <!-- aluminium -->
        <body name="lower" pos="0 0 .4" euler="0 0 .3">
          <inertial pos="0.01 0 .15" mass="1.2" fullinertia=".02 .021 .003 .0005 0 .0002"/>
          <joint name="elbow" axis="0 1 0" range="-2 2"/>
          <geom name="shell" type="box" size=".03 .03 .15" pos="0 0 .15"/>
          <body name="tool" pos="0 0 .3">
            <joint name="roll" axis="0 0 1" range="-3 3"/>
            <geom type="box" size=".05 .02 .06" pos="0 .01 .05"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="lift" gear="50"/><motor joint="elbow" gear="50"/><motor joint="roll" gear="20"/>
  </actuator>
</mujoco>
"""


def mass_matrix(robot: Robot, parameters: np.ndarray, q: np.ndarray) -> np.ndarray:
    """From the parameters alone: the torques that unit accelerations ask for without gravity, ``(nv, nv)``."""
    model = robot.model.copy()
    model.gravity = pin.Motion.Zero()
    data, still = model.createData(), np.zeros(model.nv)
    columns = [
        pin.computeJointTorqueRegressor(model, data, q, still, unit) @ parameters for unit in np.eye(model.nv)
    ]
    return np.array(columns).T


def positions(robot: Robot) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    found = []
    for _ in range(3):
        q = pin.neutral(robot.model)
        q[-robot.n_joints :] = rng.uniform(-1.5, 1.5, robot.n_joints)
        found.append(q)
    return found


def mass_matrix_in_mujoco(path: Path, robot: Robot, q: np.ndarray) -> np.ndarray:
    """What MuJoCo makes of a file, without rotor inertia; the base where the robot's is, unturned."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    model.dof_armature[:] = 0.0
    joints = [model.joint(name) for name in robot.joint_names]
    data.qpos[[joint.qposadr[0] for joint in joints]] += q[-robot.n_joints :]
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    order = [*range(6 if robot.floating else 0), *(int(joint.dofadr[0]) for joint in joints)]
    return full[np.ix_(order, order)]


def reloaded(robot: Robot, path: Path) -> Robot:
    model = robot.description.model.model_copy(update={"package": None, "path": str(path)})
    return build_robot(robot.description.model_copy(update={"model": model}), robot.source)


def check_mass_matrices(robot: Robot, parameters: np.ndarray, urdf: Path, mjcf: Path) -> None:
    again = reloaded(robot, urdf).model
    for q in positions(robot):
        expected = mass_matrix(robot, parameters, q)
        size = np.abs(expected).max()
        upper = np.triu(pin.crba(again, again.createData(), q))
        np.testing.assert_allclose(upper, np.triu(expected), atol=1e-9 * size)
        np.testing.assert_allclose(mass_matrix_in_mujoco(mjcf, robot, q), expected, atol=1e-9 * size)


@pytest.mark.parametrize("name", bundled_robots())
def test_mass_matrices_of_written_models_are_those_of_the_parameters(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    parameters = scattered_parameters(robot, np.random.default_rng(0), scatter=0.1).phi
    assert not np.allclose(parameters, robot.nominal_parameters)
    files = write_models(robot, identification_of(robot, parameters), tmp_path)
    assert files.refused == () and files.urdf is not None and files.mjcf is not None
    check_mass_matrices(robot, parameters, files.urdf.path, files.mjcf.path)
    assert len(files.differences.read_text().splitlines()) > len(robot.segments)


def identified_parameters(document: dict, robot: Robot) -> np.ndarray:
    """From the document, whose inertias stand as Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""
    found = []
    for segment in robot.segments:
        entry = document["standard_parameters"][segment.link]
        xx, yy, zz, xy, xz, yz = entry["inertia"]
        found += [entry["mass"], *entry["first_moment"], xx, xy, yy, xz, yz, zz]
    return np.array(found)


def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, *arguments: object
) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", ["excite", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        command_line.main()
    return int(ended.value.code or 0), capsys.readouterr().err


def test_identify_writes_back_into_a_users_mjcf(tmp_path: Path, monkeypatch, capsys) -> None:
    """From a MuJoCo model of one's own to the same text with identified inertials, by the command line."""
    mine = tmp_path / "mine.xml"
    mine.write_text(MINE, encoding="utf-8")
    description = write_scaffold(mine, tmp_path / "robot").description
    robot = load_robot(str(description))
    log = replace(arm_log(robot, 1, torque="link_side", trials=2), robot_text="<robot/>")
    arguments = ["identify", description, save_log(log, tmp_path / "log"), "--method", "cls3"]
    out = tmp_path / "out"
    code, said = run(monkeypatch, capsys, *arguments, "--out", out, "--template", mine)
    assert code == 0, said
    document = json.loads((out / "identification.json").read_text())
    parameters = identified_parameters(document, robot)
    assert np.abs(parameters - robot.nominal_parameters).max() > 0.01
    check_mass_matrices(robot, parameters, out / "identified.urdf", out / "identified.xml")
    lines = list(difflib.ndiff(MINE.splitlines(), (out / "identified.xml").read_text().splitlines()))
    assert all("<inertial " in line for line in lines if line[0] in "+-")
    assert sum(line[0] == "+" for line in lines) == 3 and sum(line[0] == "-" for line in lines) == 1
    table = (out / "differences.csv").read_text()
    assert all(link in table for link in ("upper", "lower", "tool"))
    before = model_file(robot).read_text().splitlines()
    after = (out / "identified.urdf").read_text().splitlines()
    changed = [line for line in difflib.ndiff(before, after) if line[0] in "+-"]
    assert changed and all(any(t in line for t in ("<origin", "<mass", "<inertia")) for line in changed)


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (("--template", "no.xml", "--out", "o"), "no.xml: is no file"),
        (("--template", "{mine}"), "--out DIR"),
        (("--template", "{empty}", "--out", "o"), "empty.xml: is not valid XML"),
        (("--template", "{binary}", "--out", "o"), "binary.xml: is not valid XML"),
        (("--template", "{entities}", "--out", "o"), "declares XML entities"),
        (("--template", "{urdf}", "--out", "o"), "is no MuJoCo model"),
    ],
)
def test_a_template_that_cannot_be_used_is_refused_first(tmp_path, monkeypatch, capsys, extra, says) -> None:
    monkeypatch.chdir(tmp_path)
    contents = {
        "mine": MINE.encode(),
        "empty": b"",
        "binary": bytes(range(256)),
        "entities": b'<!DOCTYPE m [<!ENTITY a "aa">]><mujoco><worldbody>&a;</worldbody></mujoco>',
        "urdf": b'<robot name="x"><link name="a"/></robot>',
    }
    files = {name: tmp_path / f"{name}.xml" for name in contents}
    for name, content in contents.items():
        files[name].write_bytes(content)
    log = save_log(
        replace(arm_log(load_robot("ur10"), 0, trials=1, duration=2.0), robot_text="<robot/>"), tmp_path / "l"
    )
    code, said = run(monkeypatch, capsys, "identify", "ur10", log, *(text.format(**files) for text in extra))
    assert code == 4 and said.count("\n") == 1 and says in said
