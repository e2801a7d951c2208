"""Closed loops in MuJoCo, which keeps them as constraints."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pinocchio as pin

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


def compiled(text: str) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 2e-4
    model.opt.jacobian, model.opt.tolerance, model.opt.iterations = mujoco.mjtJacobian.mjJAC_DENSE, 0.0, 100
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.eq_solimp[:, :2], model.eq_solref[:, 0] = 0.9999, 0.002
    return model


@cache
def simulated(text: str, free: bool) -> tuple[np.ndarray, ...]:
    """States, accelerations and motor torques of MuJoCo's own forward dynamics under sums of sines; to be read only."""
    model = compiled(text)
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
