"""Runs an augmented model: MuJoCo for what its XML says, this runner for the effects noted in it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.form import DEFLECTION
from excite.diagnosis.effects.note import JointStep
from excite.diagnosis.simulator.model_text import load_model
from excite.diagnosis.simulator.notes import read_notes
from excite.diagnosis.simulator.rollout_drives import Drive, LoggedTorque, PositionServo, Window
from excite.diagnosis.simulator.rollout_friction import JointFriction
from excite.divergence import diverged, without_log_file


class Simulator:
    """A loaded model.

    At every step the runner does what the notes in it say: friction of the coming step goes to ``dof_frictionloss`` and
    ``dof_damping``, torques go to ``qfrc_applied``. A torque channel that is late is read at a later time.
    """

    def __init__(self, xml: str, joints: tuple[str, ...]):
        """Load a model.

        Args:
            xml: the model's text.
            joints: joints in the order of all arrays.
        """
        import mujoco

        self.model = load_model(xml)
        self.data = mujoco.MjData(self.model)
        self.joints = joints
        self._qpos = np.array([self.model.joint(name).qposadr[0] for name in joints])
        self._dof = np.array([self.model.joint(name).dofadr[0] for name in joints])
        self._motor = np.array([self.model.actuator(name).id for name in joints])
        self._constant: list[float] = self.model.dof_frictionloss[self._dof].tolist()
        self._damping = self.model.dof_damping.copy()
        # MuJoCo's own arrays: asking for them at every step would take as long as the step.
        self._levels, self._dampings = self.model.dof_frictionloss, self.model.dof_damping
        self._applied = self.data.qfrc_applied
        every = read_notes(self.model)
        self._notes = [(joints.index(item.place), item.note) for item in every if item.place in joints]
        self._delay = sum(item.note.late_by for item in every)
        self._before = sum(item.note.filter_before for item in every)
        self._logged = np.zeros(len(joints))
        for j, note in self._notes:
            self._logged[j] += note.log_offset
        self._stepwise = any(note.every_step for _, note in self._notes)
        self._steps = tuple(JointStep(partial(self._carried_by, j)) for j in range(len(joints)))
        # Joints of which a note may ask.
        self._asked = sorted({j for j, _ in self._notes})
        self._dry = JointFriction(self._notes, self._steps)
        self._load = np.zeros(len(joints))
        self._borne: list[float] | None = None

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
        self._deflect(window)
        self._dry.start(window)
        for j in self._asked:
            self._steps[j].growth = window.growth.get(self.joints[j])
        delay = self._delay if isinstance(drive, LoggedTorque) else 0.0
        filtered, lagged = self._filtered(window, drive, delay)
        if model.na:
            data.act[:] = lagged[: model.na]
        drive, held = self._damped(drive)
        model.dof_damping[:] = held
        share = _share(model.opt.timestep, self._before)
        with without_log_file():
            offered = drive.offers(window.time + delay)
            known = self._controls(offered, filtered, share) if isinstance(drive, LoggedTorque) else None
            if known is not None and not self._stepwise:
                return self._open_loop(window, known, keep)
            kept, positions, velocities = [window.q], data.qpos, data.qvel
            for step, elapsed in enumerate((window.time - window.time[0]).tolist()):
                if known is None:
                    answer = drive.answer(
                        offered[step], positions[self._qpos] - self._logged, velocities[self._dof]
                    )
                    filtered = filtered + share * (answer - filtered)
                    data.ctrl[self._motor] = filtered
                else:
                    data.ctrl[:] = known[step]
                if self._stepwise:
                    self._apply(window, elapsed, held)
                mujoco.mj_step(model, data)
                if self._dry.bristles:
                    self._dry.move(velocities[self._dof].tolist(), model.opt.timestep)
                if (step + 1) % keep == 0:
                    kept.append(positions[self._qpos])
        if diverged(data):
            kept[-1] = np.full(len(self.joints), np.nan)
        return np.array(kept)

    def _damped(self, drive: Drive) -> tuple[Drive, Array]:
        """A drive without the damping that the implicit step may do for it, and the damping of that step, ``(nv,)``."""
        # Behind a lag the servo damps late: that is no part of the implicit step.
        if not isinstance(drive, PositionServo) or self.model.na:
            return drive, self._damping
        held = self._damping.copy()
        held[self._dof] += drive.kd * self.model.actuator_gainprm[self._motor, 0]
        return replace(drive, undamped=True), held

    def _controls(self, torques: Array, filtered: Array, share: float) -> Array:
        """What the motors are told at every step where nothing is fed back, ``(n_steps, nu)``."""
        control = np.zeros((len(torques), self.model.nu))
        if share == 1.0:
            control[:, self._motor] = torques
            return control
        for k, torque in enumerate(torques):
            filtered = filtered + share * (torque - filtered)
            control[k, self._motor] = filtered
        return control

    def _open_loop(self, window: Window, control: Array, keep: int) -> Array:
        """:meth:`run` where nothing has to be looked at on the way: all steps at once."""
        import mujoco
        from mujoco.rollout import rollout

        whole = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(mujoco.mj_stateSize(self.model, whole))
        mujoco.mj_getState(self.model, self.data, start, whole)
        states, _ = rollout(self.model, self.data, start, control)
        # A state is the time, then the positions.
        kept = np.vstack([window.q, states[0][keep - 1 :: keep][:, 1 + self._qpos]])
        if diverged(self.data):
            kept[-1] = np.nan
        return kept

    def _filtered(self, window: Window, drive: Drive, delay: float) -> tuple[Array, Array]:
        """What the two filters of a lag have come to at the window's start: before the motor, in the motor."""
        past = window.past
        slow = float(self.model.actuator_dynprm[self._motor[0], 0]) if self.model.na else 0.0
        if past is None or not self.model.na:
            now = drive.answer(drive.offers(window.time[:1] + delay)[0], window.q, window.v)
            return now, now
        period = float(past.time[1] - past.time[0])
        first, second = _share(period, self._before), _share(period, slow)
        one = two = drive.answer(drive.offers(past.time[:1] + delay)[0], past.q[0], past.v[0])
        # Half a period on: the command of an interval, not of its start.
        times = past.time[:-1] + 0.5 * period + delay
        for torque in drive.answer(drive.offers(times), past.q[:-1], past.v[:-1]):
            one = one + first * (torque - one)
            two = two + second * (one - two)
        return one, two

    def _deflect(self, window: Window) -> None:
        """Soft and loose gears start as they are said to swing, or where their load puts them."""
        for j, note in self._notes:
            resting = note.deflection(float(window.load[j]))
            if resting is None:
                continue
            joint = self.model.joint(self.joints[j] + DEFLECTION)
            angle, speed = window.deflected.get(self.joints[j], (resting, 0.0))
            self.data.qpos[joint.qposadr[0]], self.data.qvel[joint.dofadr[0]] = angle, speed

    def _apply(self, window: Window, elapsed: float, held: Array) -> None:
        """Set friction and torques of the coming step; ``held`` is the damping that does not change."""
        dof, bent = self._dof, dict.fromkeys(self._asked, 0.0)
        trial_s, session_s = float(window.time[0]) + elapsed, window.session_s + elapsed
        # Numbers of a list are reckoned with sooner than those of an array.
        positions, speeds = self.data.qpos[self._qpos].tolist(), self.data.qvel[dof].tolist()
        self._borne = None
        for j in self._asked:
            step = self._steps[j]
            step.q, step.v, step.trial_s, step.session_s = positions[j], speeds[j], trial_s, session_s
        for rubbing in self._dry.acting(self._constant, speeds, self.model.opt.timestep):
            j = rubbing.joint
            self._levels[dof[j]] = rubbing.level
            self._dampings[dof[j]] = held[dof[j]] + rubbing.damping
            bent[j] = rubbing.force
        # What gears carry is asked for on the way: the last step's torques stay until all notes have spoken.
        for j, note in self._notes:
            bent[j] += note.torque(self._steps[j])
        for j, torque in bent.items():
            self._applied[dof[j]] = torque

    def _carried_by(self, j: int) -> float:
        # All notes of a step ask for the last one's torques.
        if self._borne is None:
            self._borne = self._carried().tolist()
        return self._borne[j]

    def _carried(self) -> Array:
        """Torques that the gears carry: what the last step's motors gave less friction and rotors."""
        data, dof = self.data, self._dof
        if data.time == 0.0:
            return self._load
        force = data.qfrc_actuator[dof] + data.qfrc_passive[dof] + data.qfrc_constraint[dof]
        return force + data.qfrc_applied[dof] - self.model.dof_armature[dof] * data.qacc[dof]


def _share(period: float, time_constant: float) -> float:
    """Share of a step that a first-order filter follows within a period."""
    return float(-np.expm1(-period / time_constant)) if time_constant > 0.0 else 1.0
