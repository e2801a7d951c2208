"""Closed loops against MuJoCo, which keeps them as constraints: what its motors exert is what the cut tree says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.errors import MotionError
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.mechanisms.closures import Loop
from excite.robot.mechanisms.mechanism import Mechanism, build_mechanism

# A crank, a coupler and a rocker whose end meets the ground again: three hinges, one of them driven.
FOUR_BAR = """<mujoco model="four_bar"><compiler angle="radian"/><worldbody><body name="base">
 <geom type="box" size=".02 .02 .02" mass="1"/>
 <body name="crank"><joint name="crank" axis="0 1 0"/><inertial pos=".01 .002 .05" mass=".4"
   fullinertia=".002 .0018 .0004 .0001 .0002 .0001"/>
  <body name="coupler" pos="0 0 .1"><joint name="coupler" axis="0 1 0"/><inertial pos=".12 .001 .02" mass=".7"
    fullinertia=".001 .004 .0038 .0001 -.0002 .0001"/>
   <body name="rocker" pos=".25 0 .05"><joint name="rocker" axis="0 1 0"/><inertial pos=".01 0 -.06" mass=".5"
     fullinertia=".002 .0019 .0005 0 .0001 0"/></body></body></body></body></worldbody>
 <equality><connect body1="rocker" body2="base" anchor="0.02 0 -.15"/></equality>
 <actuator><motor joint="crank"/></actuator></mujoco>"""

# An ankle that pitches and rolls, pushed by two rods from cranks on the shank: eight hinges, two of them driven.
_SIDE = """<body name="{s}_crank" pos="-.02 {y} .2"><joint name="{s}_crank" axis="0 1 0"/>
  <inertial pos="-.02 0 0" mass=".1" diaginertia=".0001 .0002 .0002"/>
  <body name="{s}_rod" pos="-.05 0 0"><joint name="{s}_rod_pitch" axis="0 1 0"/>
   <joint name="{s}_rod_roll" axis="1 0 0"/>
   <inertial pos="0 0 -.1" mass=".15" diaginertia=".0006 .0006 .00002"/></body></body>"""
ANKLE = f"""<mujoco model="ankle"><compiler angle="radian"/><worldbody><body name="shank" pos="0 0 1">
 {{free}}<inertial pos="0 0 .1" mass="2" diaginertia=".02 .02 .003"/>
 <body name="cross"><joint name="ankle_pitch" axis="0 1 0"/>
  <inertial pos="0 0 0" mass=".05" diaginertia=".00002 .00002 .00002"/>
  <body name="foot"><joint name="ankle_roll" axis="1 0 0"/>
   <inertial pos=".03 .002 -.03" mass=".8" fullinertia=".0012 .004 .0045 .0001 .0003 0"/></body></body>
 {_SIDE.format(s="left", y=".04")}{_SIDE.format(s="right", y="-.04")}</body></worldbody>
 <equality><connect body1="left_rod" body2="foot" anchor="0 0 -.2"/>
  <connect body1="right_rod" body2="foot" anchor="0 0 -.2"/></equality>
 <actuator><motor joint="left_crank"/><motor joint="right_crank"/></actuator></mujoco>"""


def _compiled(text: str) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2e-4
    model.opt.jacobian, model.opt.tolerance, model.opt.iterations = mujoco.mjtJacobian.mjJAC_DENSE, 0.0, 100
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.eq_solimp[:, :2], model.eq_solref[:, 0] = 0.9999, 0.002
    return model


def _tree(model: mujoco.MjModel) -> tuple[pin.Model, dict[int, tuple[int, pin.SE3]]]:
    """The tree of a MuJoCo model, body by body, in pinocchio."""
    tree, joints = pin.Model(), {0: (0, pin.SE3.Identity())}
    for body in range(1, model.nbody):
        parent, offset = joints[int(model.body_parentid[body])]
        pose = offset * pin.XYZQUATToSE3(np.r_[model.body_pos[body], model.body_quat[body][[1, 2, 3, 0]]])
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
            kind = (
                pin.JointModelFreeFlyer() if free else pin.JointModelRevoluteUnaligned(model.jnt_axis[joint])
            )
            placement = pin.SE3.Identity() if free else pose
            parent = tree.addJoint(parent, kind, placement, model.joint(joint).name or "root")
            pose = pin.SE3.Identity()
        joints[body] = (parent, pose)
        turn = pin.Quaternion(model.body_iquat[body][[1, 2, 3, 0]]).matrix()
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        tree.appendBodyToJoint(
            parent, pin.Inertia(model.body_mass[body], model.body_ipos[body], inertia), pose
        )
    return tree, joints


def _mechanism(model: mujoco.MjModel) -> Mechanism:
    tree, joints = _tree(model)
    loops = []
    for number in range(model.neq):
        bodies = (int(model.eq_obj1id[number]), int(model.eq_obj2id[number]))
        anchors = model.eq_data[number][:6].reshape(2, 3)
        places = [joints[b][1] * pin.SE3(np.eye(3), p) for b, p in zip(bodies, anchors, strict=True)]
        loops.append(
            Loop(f"loop_{number}", (joints[bodies[0]][0], joints[bodies[1]][0]), (places[0], places[1]))
        )
    driven = {model.joint(int(j)).name for j in model.actuator_trnid[:, 0]}
    return build_mechanism(tree, loops, [n for n in list(tree.names)[1:] if n not in driven and n != "root"])


@cache
def _simulated(text: str, free: bool) -> tuple[np.ndarray, ...]:
    """States, accelerations and motor torques of MuJoCo's own forward dynamics under sums of sines; to be read only."""
    model = _compiled(text)
    data, random = mujoco.MjData(model), np.random.default_rng(3)
    size = np.array([3.0, 2.0])[: model.nu, None] * random.uniform(0.3, 1.0, (model.nu, 3))
    phase, seen = random.uniform(0.0, 6.0, (model.nu, 3)), []
    for step in range(2000):
        t = 2e-4 * step
        data.ctrl[:] = (size * np.sin(np.array([30.0, 47.0, 71.0]) * t + phase)).sum(axis=1)
        if step % 40 == 39:
            mujoco.mj_forward(model, data)
            q, v, a = data.qpos.copy(), data.qvel.copy(), data.qacc.copy()
            if free:
                q[3:7] = q[[4, 5, 6, 3]]
                turn = pin.Quaternion(q[3:7]).matrix()
                # MuJoCo's linear acceleration is that of the world, pinocchio's turns with the base.
                a[:3] = turn.T @ a[:3] - np.cross(v[3:6], turn.T @ v[:3])
                v[:3] = turn.T @ v[:3]
            seen.append((q, v, a, data.ctrl.copy()))
        mujoco.mj_step(model, data)
    columns = tuple(np.array(column) for column in zip(*seen, strict=True))
    for column in columns:
        column.flags.writeable = False
    return columns


@pytest.mark.parametrize(
    ("text", "free"),
    [
        (FOUR_BAR, False),
        (ANKLE.format(free=""), False),
        (ANKLE.format(free="<freejoint/>"), True),
    ],
    ids=["four_bar", "parallel_ankle", "parallel_ankle_in_the_air"],
)
def test_motors_torques_and_regressors_are_those_of_constrained_dynamics(text: str, free: bool) -> None:
    model = _compiled(text)
    closed = _mechanism(model)
    q, v, a, tau = _simulated(text, free)
    assert np.ptp(q[:, 7 * free :], axis=0).min() > 0.02
    forces = inverse_dynamics(closed.model, q, v, a)
    # The cut tree's own equations are not these torques: cuts carry forces.
    assert np.abs(forces[:, closed.passive]).max() > 0.1
    maps = closed.motion_maps(q)
    predicted = np.einsum("nij,ni->nj", maps, forces)
    wanted = np.hstack([np.zeros((len(q), 6 * free)), tau])
    assert np.abs(predicted - wanted).max() < 1e-6
    phi = np.concatenate([inertia.toDynamicParameters() for inertia in list(closed.model.inertias)[1:]])
    rows = np.einsum("nij,nik->njk", maps, joint_torque_regressor(closed.model, q, v, a))
    assert np.abs(rows @ phi - wanted).max() < 1e-6


@pytest.mark.parametrize("text", [FOUR_BAR, ANKLE.format(free="")], ids=["four_bar", "parallel_ankle"])
def test_passive_joints_follow_from_the_motors(text: str) -> None:
    """Positions, velocities and accelerations, against finite differences and MuJoCo's own constraint."""
    model = _compiled(text)
    closed, data = _mechanism(model), mujoco.MjData(model)
    time = np.arange(0.0, 0.5, 1e-3)
    q = np.zeros((len(time), model.nq))
    for k, column in enumerate(closed.driven):
        q[:, column] = 0.3 * np.sin(7.0 * time + 2.0 * k) - 0.3 * np.sin(2.0 * k)
    q = closed.closed(q)
    assert closed.gaps(q).max() < 1e-9
    rough = np.gradient(q, time, axis=0, edge_order=2)
    v = closed.following(q, rough, rough).v
    assert np.abs(v - rough)[2:-2].max() < 1e-3
    slow = np.gradient(v, time, axis=0, edge_order=2)
    a = closed.following(q, v, slow).a
    assert np.abs(a - slow)[2:-2].max() < 2e-2
    for i in range(2, len(time), 50):
        data.qpos[:], data.qvel[:] = q[i], v[i]
        mujoco.mj_forward(model, data)
        jacobian = data.efc_J.reshape(-1, model.nv)[: 3 * model.neq]
        assert np.abs(data.efc_pos[: 3 * model.neq]).max() < 1e-9
        assert np.abs(jacobian @ v[i]).max() < 1e-9


def test_what_no_loop_determines_is_named() -> None:
    closed = _mechanism(_compiled(FOUR_BAR))
    loose = replace(closed, passive=np.array([0, 1, 2]))
    with pytest.raises(MotionError, match="3 passive joints, and the loops determine 2"):
        loose.motion_maps(np.zeros((1, 3)))


def test_a_loop_out_of_reach_is_named() -> None:
    closed = _mechanism(_compiled(FOUR_BAR))
    far = Loop(
        "far", closed.closures[0].joints, (closed.closures[0].placements[0], pin.SE3(np.eye(3), np.ones(3)))
    )
    with pytest.raises(MotionError, match=r"loops\.far"):
        replace(closed, closures=(far,)).closed(np.zeros((1, 3)))
