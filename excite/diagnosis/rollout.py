"""Runs an augmented model: MuJoCo for what its XML says, this runner for the effects noted in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from excite.diagnosis.augmented_effects import DEFLECTION, NOTE
from excite.robot.robot import Array

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of a record to be simulated.

    Attributes:
        q: ``(n_joints,)`` positions at its start [rad].
        v: velocities at its start [rad/s].
        load: torque that the links need at its start [N·m]; sets how far soft and loose gears are deflected.
        time: ``(n_steps,)`` of the steps [s] since the trial's start.
        session_s: time of its start within the session [s].
        growth: by joint, how far friction that drifts has come at its start; from the session's clock where it
            is not given.
    """

    q: Array
    v: Array
    load: Array
    time: Array
    session_s: float
    growth: Mapping[str, float] = field(default_factory=dict)


class Drive(Protocol):
    """Where a simulation's torques come from."""

    def torque(self, time: float, q: Array, v: Array) -> Array:
        """Torques of the motors [N·m] at a time of the trial [s] and a state, all ``(n_joints,)``."""
        ...


@dataclass(frozen=True, eq=False)
class LoggedTorque:
    """The record's own torques, no feedback.

    Attributes:
        time: ``(n,)`` [s].
        tau: ``(n, n_joints)`` [N·m].
    """

    time: Array
    tau: Array

    def torque(self, time: float, q: Array, v: Array) -> Array:
        k = min(max(int(np.searchsorted(self.time, time)) - 1, 0), len(self.time) - 2)
        share = min(max((time - self.time[k]) / (self.time[k + 1] - self.time[k]), 0.0), 1.0)
        return (1.0 - share) * self.tau[k] + share * self.tau[k + 1]


@dataclass(frozen=True, eq=False)
class PositionServo:
    """``kp (q_cmd − q) + kd (v_cmd − v) + feedforward``, commands interpolated.

    Attributes:
        time: ``(n,)`` [s].
        q_cmd: ``(n, n_joints)``, v_cmd and feedforward alike.
        v_cmd: commanded velocities [rad/s].
        feedforward: torque added to it [N·m].
        kp: ``(n_joints,)`` [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
        undamped: leave ``−kd v`` to the one who asks.
    """

    time: Array
    q_cmd: Array
    v_cmd: Array
    feedforward: Array
    kp: Array
    kd: Array
    undamped: bool = False

    def torque(self, time: float, q: Array, v: Array) -> Array:
        k = min(max(int(np.searchsorted(self.time, time)) - 1, 0), len(self.time) - 2)
        share = min(max((time - self.time[k]) / (self.time[k + 1] - self.time[k]), 0.0), 1.0)
        qc, vc, ff = (
            (1.0 - share) * x[k] + share * x[k + 1] for x in (self.q_cmd, self.v_cmd, self.feedforward)
        )
        return self.kp * (qc - q) + self.kd * (vc if self.undamped else vc - v) + ff


class Simulator:
    """A loaded model.

    The runner applies, at every step: Stribeck and load-dependent friction and friction that drifts, by setting
    ``dof_frictionloss`` and ``dof_damping``; periodic torques (ripple; a tilted base's part on the first joint)
    in ``qfrc_applied``; a delay of the torque channel, by taking the logged torque of a later time.
    """

    def __init__(self, xml: str, joints: tuple[str, ...]):
        """Load a model.

        Args:
            xml: the model's text.
            joints: joints in the order of all arrays.
        """
        import mujoco

        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.joints = joints
        self._qpos = np.array([self.model.joint(name).qposadr[0] for name in joints])
        self._dof = np.array([self.model.joint(name).dofadr[0] for name in joints])
        self._motor = np.array([self.model.actuator(name).id for name in joints])
        self._friction = self.model.dof_frictionloss.copy()
        self._damping = self.model.dof_damping.copy()
        self._notes = [
            (effect, place, values)
            for effect, place, values in _notes(self.model)
            if effect != "time_delay" and (place in joints)
        ]
        self._delay = sum(v["delay"] for effect, _, v in _notes(self.model) if effect == "time_delay")
        self._before = sum(v["before"] for e, _, v in _notes(self.model) if e == "actuator_lag")
        self._load = np.zeros(len(joints))

    def run(self, window: Window, drive: Drive, keep: int) -> Array:
        """Positions at the window's start and after every ``keep`` steps, ``(n_kept, n_joints)`` [rad].

        The step is symplectic, so that velocities belong half a step before positions; the first ones are put
        there. A run that diverges ends in what is not finite.
        """
        import mujoco

        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        model.opt.timestep = float(window.time[1] - window.time[0])
        data.qpos[self._qpos], data.qvel[self._dof] = window.q, window.v
        self._load = window.load.copy()
        self._deflect(window.load)
        # Damping by the servo is part of the implicit step where no lag stands between it and the joint.
        implicit = isinstance(drive, PositionServo) and model.na == 0
        added = np.zeros(model.nv)
        if isinstance(drive, PositionServo) and implicit:
            added[self._dof] = drive.kd * model.actuator_gainprm[self._motor, 0]
            drive = replace(drive, undamped=True)
        model.dof_damping[:] = self._damping + added
        delay = self._delay if isinstance(drive, LoggedTorque) else 0.0
        share = -np.expm1(-model.opt.timestep / self._before) if self._before > 0.0 else 1.0
        filtered = drive.torque(float(window.time[0]), window.q, window.v)
        if model.na:
            data.act[:] = drive.torque(float(window.time[0]), window.q, window.v)[: model.na]
        kept = [window.q]
        for step, time in enumerate(window.time):
            q, v = data.qpos[self._qpos], data.qvel[self._dof]
            asked = drive.torque(float(time) + delay, q, v)
            data.ctrl[self._motor] = filtered = (
                asked if self._before == 0.0 else filtered + share * (asked - filtered)
            )
            if self._notes:
                self._apply(q, v, window, float(time - window.time[0]), added)
            mujoco.mj_step(model, data)
            if (step + 1) % keep == 0:
                kept.append(data.qpos[self._qpos].copy())
        return np.array(kept)

    def _deflect(self, load: Array) -> None:
        """Soft and loose gears start where their load puts them."""
        for effect, place, values in self._notes:
            if effect not in {"joint_elasticity", "backlash"}:
                continue
            address = self.model.joint(place + DEFLECTION).qposadr[0]
            torque = load[self.joints.index(place)]
            soft = effect == "joint_elasticity"
            self.data.qpos[address] = (
                -torque / values["stiffness"] if soft else -0.5 * np.sign(torque) * values["width"]
            )

    def _apply(self, q: Array, v: Array, window: Window, elapsed: float, added: Array) -> None:
        model, data = self.model, self.data
        model.dof_frictionloss[:] = self._friction
        model.dof_damping[:] = self._damping + added
        data.qfrc_applied[:] = 0.0
        for effect, place, p in self._notes:
            j = self.joints.index(place)
            dof = self._dof[j]
            if effect == "stribeck":
                model.dof_frictionloss[dof] += p["excess"] * np.exp(
                    -(abs(v[j] / p["velocity"]) ** p.get("exponent", 2.0))
                )
            elif effect == "load_dependent_friction":
                model.dof_frictionloss[dof] += p["coefficient"] * abs(self._carried(j))
            elif effect == "friction_drift":
                session, slow = window.session_s + elapsed, p["time_constant"]
                clock = np.expm1(-session / slow) / np.expm1(-p["session_end"] / slow)
                growth = window.growth.get(place, clock)
                model.dof_frictionloss[dof] += growth * p["coulomb_change"]
                model.dof_damping[dof] += growth * p["viscous_change"]
            elif "periods_per_rev" in p:
                data.qfrc_applied[dof] -= self._wave(j, q[j], p)
            elif effect == "joint_spring":
                model.dof_frictionloss[dof] += abs(p.get("rubbing", 0.0))
                data.qfrc_applied[dof] -= (
                    p.get("quadratic", 0.0) * q[j] ** 2 + p.get("cubic", 0.0) * q[j] ** 3
                )
        np.maximum(model.dof_frictionloss, 0.0, out=model.dof_frictionloss)

    def _wave(self, j: int, q: float, p: dict[str, float]) -> float:
        """Periodic torque of a joint, with its second harmonic and the part that grows with the load."""
        phase = p["periods_per_rev"] * q
        c, s = np.cos(phase), np.sin(phase)
        wave = p["cosine"] * c + p["sine"] * s
        if "cosine_2" in p:
            wave += p["cosine_2"] * np.cos(2.0 * phase) + p["sine_2"] * np.sin(2.0 * phase)
            wave += abs(self._carried(j)) * (p["cosine_load"] * c + p["sine_load"] * s)
        return float(wave)

    def _carried(self, j: int) -> float:
        """Torque that a joint's gear carries: what the last step's motor gave less friction and rotor."""
        data, dof = self.data, self._dof[j]
        if data.time == 0.0:
            return float(self._load[j])
        force = data.qfrc_actuator[dof] + data.qfrc_passive[dof] + data.qfrc_constraint[dof]
        return float(force - self.model.dof_armature[dof] * data.qacc[dof])


def _notes(model: mujoco.MjModel) -> list[tuple[str, str, dict[str, float]]]:
    """Effects noted in a model: name, place, values."""
    import mujoco

    found = []
    for k in range(model.ntext):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, k)
        parts = name.split(".", 2)
        if len(parts) == 3 and parts[0] == NOTE:
            first, size = int(model.text_adr[k]), int(model.text_size[k])
            data = bytes(model.text_data[first : first + size]).decode().rstrip("\0")
            pairs = (item.split("=") for item in data.split())
            found.append((parts[1], parts[2], {key: float(value) for key, value in pairs}))
    return found
