"""A leg of two joints on a stiff servo, simulated by MuJoCo: its log has commands and what encoders read, no torque."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from excite.logs.files import load_log
from excite.logs.log import Log

RATE_HZ, SECONDS, STEP_S = 500, 12.0, 2e-4
KP, KD, JOINTS = np.array([900.0, 700.0]), np.array([6.3, 5.1]), ("hip", "knee")
LINKS = ((2.1, 0.31, 0.14, 0.021), (0.9, 0.29, 0.11, 0.008))

URDF = '<robot name="leg"><link name="trunk"/>' + "".join(
    f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{joint}_link"/>'
    f'<origin xyz="0 0 {-height}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="60" velocity="20"/></joint>'
    f'<link name="{joint}_link"><inertial><origin xyz="0 0 {-centre}"/><mass value="{mass}"/>'
    f'<inertia ixx="{turn}" iyy="{turn}" izz="{turn / 10}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    for joint, parent, height, (mass, _, centre, turn) in zip(
        JOINTS, ("trunk", "hip_link"), (0.0, LINKS[0][1]), LINKS, strict=True
    )
)
URDF += "</robot>"


def _model(friction: float) -> mujoco.MjModel:
    bodies = "".join(
        f'<body pos="0 0 {-height}"><joint axis="0 1 0" armature="0.012" damping="0.12" frictionloss="{friction}"/>'
        f'<inertial pos="0 0 {-centre}" mass="{mass}" diaginertia="{turn} {turn} {turn / 10}"/>'
        for height, (mass, _, centre, turn) in zip((0.0, LINKS[0][1]), LINKS, strict=True)
    )
    options = f'<option timestep="{STEP_S}" integrator="implicitfast"/>'
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{options}<worldbody>{bodies}</body></body></worldbody></mujoco>"
    )


def _trial(seed: int, model: mujoco.MjModel, hertz: float, bits: int) -> np.ndarray:
    """Stamps, readings and commands; a cycle of the servo a millisecond."""
    rng = np.random.default_rng(seed)
    turns = np.linspace(0.1, 1.0, 5) * hertz * rng.uniform(0.9, 1.1, (2, 5))
    size = rng.normal(size=(2, 5)) / np.arange(1, 6)
    size *= np.array([[0.6], [0.8]]) / np.abs(size).sum(axis=1, keepdims=True)
    phase, step = rng.uniform(0.0, 6.28, (2, 5)), 2.0 * np.pi / 2**bits

    def command(t: float) -> np.ndarray:
        grown = min(1.0, t / 0.8) ** 2
        return np.array([0.1, -1.0]) + grown * (size * np.sin(2.0 * np.pi * turns * t + phase)).sum(axis=1)

    data, rows = mujoco.MjData(model), []
    data.qpos[:] = command(0.0)
    for k in range(round(1000 * SECONDS)):
        asked = command(1e-3 * k)
        if k % (1000 // RATE_HZ) == 0:
            rows.append(np.concatenate([[1e-3 * k], step * np.round(data.qpos / step), asked]))
        data.qfrc_applied[:] = KP * (asked - data.qpos) - KD * data.qvel
        for _ in range(round(1e-3 / STEP_S)):
            mujoco.mj_step(model, data)
    return np.array(rows)


def leg_log(
    folder: Path, *, bits: int = 15, digits: int = 5, hertz: float = 0.16, friction: float = 0.0
) -> Log:
    """The log of four trials as a CSV of few decimals, read back.

    Args:
        folder: that it is written to.
        bits: of the encoders, a turn.
        digits: of the file, after the point.
        hertz: the fastest part of the motion.
        friction: dry friction [N·m].
    """
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    names = ",".join(["time", *(f"q.{j}" for j in JOINTS), *(f"q_cmd.{j}" for j in JOINTS)])
    for k in range(4):
        rows = _trial(k, _model(friction), hertz, bits)
        np.savetxt(
            folder / f"t{k}.csv",
            rows,
            delimiter=",",
            header=names,
            comments="",
            fmt=["%.4f"] + 4 * [f"%.{digits}f"],
        )
    gains = [
        "{" + ", ".join(f"{j}: {g}" for j, g in zip(JOINTS, values, strict=True)) + "}" for values in (KP, KD)
    ]
    lines = [
        "schema: excite.log/1",
        "robot: robot.urdf",
        "base: fixed",
        f"rate_hz: {RATE_HZ}",
        f"joints: [{', '.join(JOINTS)}]",
        "torque: none",
        f"controller: {{mode: position, kp: {gains[0]}, kd: {gains[1]}, rate_hz: 1000}}",
        "modelled: [rigid_body_fixed, viscous_friction, coulomb_friction, armature]",
        "trials:",
        *(f"  - {{file: t{k}.csv, role: {'validation' if k == 3 else 'identification'}}}" for k in range(4)),
    ]
    (folder / "log.yaml").write_text("\n".join(lines) + "\n")
    return load_log(folder)
