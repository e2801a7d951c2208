"""Mechanisms as people bring them: a model in, motions, logs and parameters out, against MuJoCo's constraints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml

import excite
from excite.campaign.expected import predict_statistics
from excite.errors import MotionError, RobotError
from excite.export.export import export_motion
from excite.identification.identify import identify
from excite.motion.files import load_motion
from excite.motion.generators.mixture import plan_candidates
from excite.motion.motion import Motion
from excite.regressor.base_parameters import structural_base_parameters
from excite.regressor.contact_forces import motor_regressor, motor_torques
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot as load_described
from excite.robot.mechanisms.closures import Loop
from excite.robot.robot import Robot
from excite.safety.check import check_motion
from excite.safety.filter import filter_candidate
from excite.simulation.simulate import run_experiment
from excite.simulation.virtual_robot import changed_robot
from tests.robot.mechanisms.closed_loops import ANKLE, FOUR_BAR, compiled, simulated
from tests.robot.small import ARM, ELBOW_LIMIT, spoiled

pytestmark = pytest.mark.usefixtures("readers_here")

# The four-bar with shapes, a crank that turns half a turn, and motors' limits.
_SHAPES = {
    "crank": '<geom type="box" size=".01 .01 .03" pos="0 0 .05" mass="0"/>',
    "coupler": '<geom type="box" size=".1 .01 .01" pos=".125 0 .02" mass="0"/>',
    "rocker": '<geom type="box" size=".01 .01 .05" pos="0 0 -.06" mass="0"/>',
}


def shaped_four_bar() -> str:
    text = FOUR_BAR.replace('<motor joint="crank"/>', '<motor joint="crank" ctrlrange="-9 9"/>')
    text = text.replace('name="crank" axis="0 1 0"/>', 'name="crank" axis="0 1 0" range="-0.6 0.6"/>', 1)
    for joint, geom in _SHAPES.items():
        end = text.index("/>", text.index(f'<joint name="{joint}"')) + 2
        text = text[:end] + geom + text[end:]
    return text


# By text and changes: several tests look at one robot.
BROUGHT: dict[tuple[str, str], Robot] = {}


def brought(text: str, folder: Path, **changes: object) -> Robot:
    """A robot from a model's text by its first description, with some of that changed."""
    if (text, str(changes)) not in BROUGHT:
        BROUGHT[text, str(changes)] = described(text, folder, changes)
    return BROUGHT[text, str(changes)]


def described(text: str, folder: Path, changes: dict[str, object]) -> Robot:
    suffix = "xml" if text.lstrip().startswith("<mujoco") else "urdf"
    (folder / f"model.{suffix}").write_text(text, encoding="utf-8")
    file = write_scaffold(folder / f"model.{suffix}", folder / "robot").description
    if changes:
        content = yaml.safe_load(file.read_text()) | changes
        file.write_text(yaml.safe_dump(content))
    return load_described(file)


@pytest.mark.parametrize(
    ("text", "free"),
    [(FOUR_BAR, False), (ANKLE.format(free=""), False), (ANKLE.format(free="<freejoint/>"), True)],
    ids=["four_bar", "parallel_ankle", "parallel_ankle_in_the_air"],
)
def test_torques_and_regressors_of_a_model_brought_are_mujocos(text: str, free: bool, tmp_path: Path) -> None:
    robot = brought(text, tmp_path, **({"base": "suspended"} if free else {}))
    model = compiled(text)
    names = [model.joint(int(j)).name for j in model.actuator_trnid[:, 0]]
    assert sorted(robot.driven_names) == sorted(names)
    q, v, a, tau = simulated(text, free)
    order = [model.joint(name).dofadr[0] for name in robot.joint_names]
    base = list(range(6 * free))
    q = np.hstack([q[:, : 7 * free], q[:, [int(k) + free for k in order]]])
    v, a = v[:, base + [int(k) for k in order]], a[:, base + [int(k) for k in order]]
    wanted = np.zeros((len(q), robot.model.nv))
    for column, name in enumerate(names):
        wanted[:, robot.n_base_v + robot.joint_index(name)] = tau[:, column]
    assert np.abs(motor_torques(robot, q, v, a) - wanted).max() < 1e-6
    rows = motor_regressor(robot, q, v, a)
    assert np.abs(rows @ robot.nominal_parameters - wanted).max() < 1e-6


@pytest.mark.parametrize("text", [FOUR_BAR, ANKLE.format(free="")], ids=["four_bar", "parallel_ankle"])
def test_passive_joints_follow_from_the_motors(text: str, tmp_path: Path) -> None:
    """Positions, velocities and accelerations, against finite differences and MuJoCo's own constraint."""
    robot, model = brought(text, tmp_path), compiled(text)
    closed, data = robot.mechanism, mujoco.MjData(model)
    assert closed is not None
    order = [int(model.joint(name).dofadr[0]) for name in robot.joint_names]
    time = np.arange(0.0, 0.5, 1e-3)
    q = np.zeros((len(time), model.nq))
    for k, column in enumerate(closed.driven):
        q[:, column] = 0.3 * np.sin(7.0 * time + 2.0 * k) - 0.3 * np.sin(2.0 * k)
    q = closed.close_configurations(q)
    assert closed.closure_gaps(q).max() < 1e-9
    rough = np.gradient(q, time, axis=0, edge_order=2)
    v = closed.follow_driven(q, rough, rough).v
    assert np.abs(v - rough)[2:-2].max() < 1e-3
    slow = np.gradient(v, time, axis=0, edge_order=2)
    a = closed.follow_driven(q, v, slow).a
    assert np.abs(a - slow)[2:-2].max() < 2e-2
    for i in range(2, len(time), 50):
        data.qpos[order], data.qvel[order] = q[i], v[i]
        mujoco.mj_forward(model, data)
        jacobian = data.efc_J.reshape(-1, model.nv)[: 3 * model.neq]
        assert np.abs(data.efc_pos[: 3 * model.neq]).max() < 1e-9
        assert np.abs(jacobian @ data.qvel).max() < 1e-9


def test_a_loop_out_of_reach_is_named(tmp_path: Path) -> None:
    closed = brought(shaped_four_bar(), tmp_path).mechanism
    assert closed is not None and isinstance(closed.closures[0], Loop)
    (first, second), near = closed.closures[0].joints, closed.closures[0].placements[0]
    far = Loop("far", (first, second), (near, pin.SE3(np.eye(3), np.ones(3))))
    with pytest.raises(MotionError, match=r"loops\.far"):
        replace(closed, closures=(far,)).close_configurations(np.zeros((1, 3)))


def test_a_four_bar_from_its_file_to_its_parameters(tmp_path: Path) -> None:
    """Plan, check, simulate with other parameters and identify: the motors' equations are all that is used."""
    robot = brought(shaped_four_bar(), tmp_path)
    assert robot.driven_names == ("crank",)
    motions = []
    for candidate in plan_candidates(robot, 3, np.random.SeedSequence(1)):
        outcome = filter_candidate(robot, candidate)
        if outcome.motion is not None:
            motions.append(outcome.motion)
    assert len(motions) >= 2
    for motion in motions:
        assert check_motion(robot, motion).safe
        assert robot.mechanism is not None and robot.mechanism.closure_gaps(motion.q).max() < 1e-9
        assert np.ptp(motion.joint_positions(), axis=0).min() > 0.1
    file = export_motion(motions[0], robot, "csv", tmp_path / "command.csv")
    assert "q.rocker" not in file.read_text().splitlines()[0]
    again = load_motion(file, robot)
    np.testing.assert_allclose(again.q, motions[0].q, atol=1e-6)
    assert check_motion(robot, again).safe
    virtual = changed_robot(robot, np.random.default_rng(2))
    log = run_experiment(virtual, motions, seed=3, roles={motions[-1].name: "validation"}).log
    assert log.header.joints == ("crank",)
    found = identify(robot, log)
    fit = found.validation["crank"]
    assert fit.rmse < 0.5 * fit.reference_rmse


def test_an_open_mechanism_is_not_safe(tmp_path: Path) -> None:
    robot = brought(shaped_four_bar(), tmp_path)
    n = 201
    time = np.linspace(0.0, 2.0, n)
    q = np.zeros((n, 3))
    q[:, 0] = 0.1 * (1.0 - np.cos(np.pi * time))
    v = np.gradient(q, time, axis=0)
    motion = Motion("open", robot.name, robot.joint_names, time, q, v, np.gradient(v, time, axis=0))
    verdict = check_motion(robot, motion)
    assert not verdict.safe
    assert "mechanism_open" in {violation.kind for violation in verdict.violations}


MIMIC = '<mimic joint="shoulder" multiplier="-0.5" offset="0.1"/>'


def test_a_mimic_joint_moves_with_its_master(tmp_path: Path) -> None:
    """Torque and regressor of the master, against MuJoCo's inverse of two joints tied by hand: τ₁ + k τ₂."""
    robot = brought(spoiled(ELBOW_LIMIT, ELBOW_LIMIT + MIMIC), tmp_path)
    assert robot.driven_names == ("shoulder",)
    rng = np.random.default_rng(0)
    q, v, a = (np.zeros((20, 2)) for _ in range(3))
    for values in (q, v, a):
        values[:, 0] = rng.uniform(-0.8, 0.8, 20)
        values[:, 1] = -0.5 * values[:, 0]
    q[:, 1] += 0.1
    assert robot.mechanism is not None
    for mine, wanted in zip(
        robot.mechanism.complete_motion(q * [1, 0], v * [1, 0], a * [1, 0]), (q, v, a), strict=True
    ):
        np.testing.assert_allclose(mine, wanted, atol=1e-9)
    model = mujoco.MjModel.from_xml_string(ARM)
    data, tau = mujoco.MjData(model), np.zeros((20, 2))
    for i in range(20):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], v[i], a[i]
        mujoco.mj_inverse(model, data)
        tau[i] = data.qfrc_inverse
    found = motor_torques(robot, q, v, a)
    np.testing.assert_allclose(found[:, 0], tau[:, 0] - 0.5 * tau[:, 1], atol=1e-9)
    assert not found[:, 1].any()
    assert structural_base_parameters(robot).rank < 8


def test_mimic_faults_name_the_joint(tmp_path: Path) -> None:
    text = spoiled(ELBOW_LIMIT, ELBOW_LIMIT + MIMIC)
    file = write_scaffold(_written(text, tmp_path), tmp_path / "robot").description
    (tmp_path / "model.urdf").write_text(
        text.replace('joint="shoulder" multiplier', 'joint="gone" multiplier')
    )
    with pytest.raises(RobotError, match=r"joint 'elbow'/mimic: follows joint 'gone', which is not there"):
        load_described(file)


def test_passive_joints_that_no_loop_determines_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "model.urdf"
    file.write_text(ARM, encoding="utf-8")
    description = write_scaffold(file, tmp_path / "robot").description
    content = yaml.safe_load(description.read_text())
    loop = {
        "name": "strut",
        "kind": "rod",
        "ends": [{"link": "world", "xyz": [0.2, 0, 0.1]}, {"link": "lower", "xyz": [0, 0, 0.1]}],
        "source": "test",
    }
    description.write_text(yaml.safe_dump(content | {"loops": [{**loop, "passive": ["shoulder", "elbow"]}]}))
    with pytest.raises(RobotError, match="2 passive joints, and the loops determine 1"):
        load_described(description)
    description.write_text(yaml.safe_dump(content | {"loops": [{**loop, "passive": ["elbow"]}]}))
    robot = load_described(description)
    assert robot.driven_names == ("shoulder",)
    assert isinstance(excite.load_robot(description), Robot)


def _written(text: str, folder: Path) -> Path:
    file = folder / "model.urdf"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("model", ["four_bar", "parallel_ankle_in_the_air"])
def test_a_plan_of_a_mechanism_says_how_certain_its_parameters_will_be(model: str, tmp_path: Path) -> None:
    """As identification says afterwards; joints that follow have no torque whose noise could be stated."""
    hangs = model != "four_bar"
    text = ANKLE.format(free="<freejoint/>") if hangs else shaped_four_bar()
    robot = brought(text, tmp_path, **({"base": "suspended"} if hangs else {}))
    plan = excite.plan(robot, n_candidates=3 if hangs else 2, seed=1)
    assert plan.forecast is not None and "predicted RSD" in plan.summary()
    predicted = predict_statistics(robot, list(plan.motions))
    roles = dict.fromkeys([motion.name for motion in plan.motions], "identification")
    log = excite.simulate(robot, list(plan.motions), nominal=True, roles=roles).log
    said = {
        one["expression"].split(" ")[0]: one["std"]
        for one in identify(robot, log, "wls").to_json()["base_parameters"]
    }
    ratios = [
        std / said[name]
        for name, std in zip(predicted.base.labels, predicted.std, strict=True)
        if name in said
    ]
    # What hangs swings, which plans do not count on: its log says more than they promise.
    assert len(ratios) >= 5 and 0.5 < min(ratios) and (hangs or max(ratios) < 2.0)
