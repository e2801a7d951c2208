"""Runs an augmented model: MuJoCo for what its XML says, this runner for the effects noted in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.form import DEFLECTION, JointStep, Note
from excite.diagnosis.simulator.model_text import load_model, read_notes
from excite.diagnosis.simulator.rollout_windows import Drive, LoggedTorque, Past, PositionServo, Window
from excite.mujoco_warnings import has_diverged, without_log_file

if TYPE_CHECKING:
    import mujoco


class Simulator:
    """A loaded model.

    At every step the runner does what the notes in it say: friction of the coming step goes to ``dof_frictionloss`` and
    ``dof_damping``, torques go to ``qfrc_applied``. A torque channel that is late is read at a later time. Runs of
    equal length go step by step together, so that what the notes say is reckoned for all of them at once.

    Attributes:
        model: the model, with the friction of the last step.
        joints: joints in the order of all arrays.
        runs: states of the last runs.
    """

    def __init__(self, xml: str, joints: tuple[str, ...]):
        """Load a model.

        Args:
            xml: the model's text.
            joints: joints in the order of all arrays.
        """
        self.model = load_model(xml)
        self.joints = joints
        self._qpos = np.array([self.model.joint(name).qposadr[0] for name in joints])
        self._dof = np.array([self.model.joint(name).dofadr[0] for name in joints])
        self._motor = np.array([self.model.actuator(name).id for name in joints])
        self._friction = self.model.dof_frictionloss.copy()
        self._damping = self.model.dof_damping.copy()
        every = read_notes(self.model)
        self._notes = [(joints.index(item.place), item.note) for item in every if item.place in joints]
        self._delay = sum(item.note.late_by for item in every)
        within = float(self.model.actuator_dynprm[self._motor[0], 0]) if self.model.na else None
        self._lag = MotorLag(sum(item.note.filter_before for item in every), within)
        self._logged = np.zeros(len(joints))
        for j, note in self._notes:
            self._logged[j] += note.log_offset
        self._stepwise = any(note.every_step for _, note in self._notes)
        self._steps = tuple(JointStep(partial(self._carried_by, j)) for j in range(len(joints)))
        # Joints of which a note may ask.
        self._asked = sorted({j for j, _ in self._notes})
        self._dry = JointFriction(self._notes, self._steps)
        self.runs: list[Run] = []
        self._load = np.zeros((0, len(joints)))
        self._borne: Array | None = None

    def run(self, window: Window, drive: Drive, keep: int) -> Array:
        """:meth:`run_all` of one window, ``(n_kept, n_joints)`` [rad]."""
        return np.asarray(self.run_all([window], [drive], keep)[0])

    def run_all(self, windows: Sequence[Window], drives: Sequence[Drive], keep: int) -> Array:
        """Positions at each window's start and after every ``keep`` steps, ``(n_windows, n_kept, n_joints)`` [rad].

        The step is symplectic, so that velocities belong half a step before positions; the first ones are put
        there. A run that diverges ends in what is not finite.

        Args:
            windows: as many steps of the same length each.
            drives: of them, all of one kind.
            keep: steps from one position to the next.
        """
        model = self.model
        model.opt.timestep = float(windows[0].time[1] - windows[0].time[0])
        while len(self.runs) < len(windows):
            self.runs.append(Run(model))
        runs = self.runs[: len(windows)]
        self._load = np.array([window.load for window in windows])
        for run, window in zip(runs, windows, strict=True):
            self._reset(run, window)
        self._dry.start(windows)
        for j in self._asked:
            known = [window.growth.get(self.joints[j]) for window in windows]
            told = [growth for growth in known if growth is not None]
            self._steps[j].growth = np.array(told) if len(told) == len(known) else None
        open_loop = isinstance(drives[0], LoggedTorque)
        delay = self._delay if open_loop else 0.0
        begun = [self._lag.begun(w, d, delay) for w, d in zip(windows, drives, strict=True)]
        if model.na:
            for run, (_, lagged) in zip(runs, begun, strict=True):
                run.data.act[:] = lagged[: model.na]
        filtered = np.array([first for first, _ in begun])
        offered = np.stack([d.offers(w.time + delay) for w, d in zip(windows, drives, strict=True)], axis=1)
        with without_log_file():
            if open_loop and not self._stepwise:
                model.dof_damping[:] = self._damping
                controls = self._controls(offered, filtered)
                kept = np.array(
                    [self._open_loop(r, w, c, keep) for r, w, c in zip(runs, windows, controls, strict=True)]
                )
            else:
                kept = self._step_by_step(runs, windows, drives, offered, filtered, keep)
        for path, run in zip(kept, runs, strict=True):
            if has_diverged(run.data):
                path[-1] = np.nan
        return kept

    def _reset(self, run: Run, window: Window) -> None:
        """Put a run where its window begins; gears start as they are said to swing, or where their load puts them."""
        import mujoco

        data = run.data
        mujoco.mj_resetData(self.model, data)
        data.qpos[self._qpos], data.qvel[self._dof] = window.q, window.v
        for j, note in self._notes:
            resting = note.deflection(float(window.load[j]))
            if resting is None:
                continue
            joint = self.model.joint(self.joints[j] + DEFLECTION)
            angle, speed = window.deflected.get(self.joints[j], (resting, 0.0))
            data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = angle, speed

    def _step_by_step(
        self,
        runs: Sequence[Run],
        windows: Sequence[Window],
        drives: Sequence[Drive],
        offered: Array,
        filtered: Array,
        keep: int,
    ) -> Array:
        """:meth:`run_all` where something has to be looked at on the way.

        Args:
            runs: the runs, reset.
            windows, drives: of them.
            offered: ``(n_steps, n_runs, n_joints)`` torques of the motors in the zero position at rest [N·m].
            filtered: ``(n_runs, n_joints)`` what the filter before the motors has come to [N·m].
            keep: as there.
        """
        import mujoco

        model, share = self.model, self._lag.share(self.model.opt.timestep)
        open_loop = isinstance(drives[0], LoggedTorque)
        driven = [self._damped(drive) for drive in drives]
        held = np.array([damping for _, damping in driven])
        # Trials have several windows each: what answers is asked once for all of them.
        rows = {id(drive): [k for k, d in enumerate(drives) if d is drive] for drive in drives}
        answering = [(driven[of[0]][0], of) for of in rows.values()]
        trial_s = np.array([float(window.time[0]) for window in windows])
        session_s = np.array([window.session_s for window in windows])
        friction, damping = model.dof_frictionloss, model.dof_damping
        control = np.zeros((len(runs), model.nu))
        answer = np.empty_like(filtered)
        kept = [np.array([window.q for window in windows])]
        acting = Acting(np.tile(self._friction, (len(runs), 1)), held, np.zeros_like(held))
        position, velocity = motion(runs, self._qpos, self._dof)
        for step, elapsed in enumerate((windows[0].time - windows[0].time[0]).tolist()):
            if open_loop:
                answer = offered[step]
            else:
                for drive, of in answering:
                    answer[of] = drive.answer(offered[step, of], position[of] - self._logged, velocity[of])
            filtered = filtered + share * (answer - filtered)
            control[:, self._motor] = filtered
            if self._stepwise:
                for j in self._asked:
                    at = self._steps[j]
                    at.q, at.v = position[:, j], velocity[:, j]
                    at.trial_s, at.session_s = trial_s + elapsed, session_s + elapsed
                acting = self._acting(velocity, held)
            for k, run in enumerate(runs):
                friction[:], damping[:] = acting.friction[k], acting.damping[k]
                run.applied[:], run.ctrl[:] = acting.applied[k], control[k]
                mujoco.mj_step(model, run.data)
            position, velocity = motion(runs, self._qpos, self._dof)
            if self._dry.bristles:
                self._dry.move(velocity, model.opt.timestep)
            if (step + 1) % keep == 0:
                kept.append(position)
        return np.stack(kept, axis=1)

    def _damped(self, drive: Drive) -> tuple[Drive, Array]:
        """A drive without the damping that the implicit step may do for it, and the damping of that step, ``(nv,)``."""
        # Behind a lag the servo damps late: that is no part of the implicit step.
        if not isinstance(drive, PositionServo) or self.model.na:
            return drive, self._damping
        held = self._damping.copy()
        held[self._dof] += drive.kd * self.model.actuator_gainprm[self._motor, 0]
        return replace(drive, undamped=True), held

    def _controls(self, torques: Array, filtered: Array) -> Array:
        """What the motors are told at every step where nothing is fed back, ``(n_runs, n_steps, nu)``."""
        share = self._lag.share(self.model.opt.timestep)
        control = np.zeros((torques.shape[1], len(torques), self.model.nu))
        if share == 1.0:
            control[:, :, self._motor] = torques.swapaxes(0, 1)
            return control
        for k, torque in enumerate(torques):
            filtered = filtered + share * (torque - filtered)
            control[:, k, self._motor] = filtered
        return control

    def _open_loop(self, run: Run, window: Window, control: Array, keep: int) -> Array:
        """:meth:`run` where nothing has to be looked at on the way: all steps at once."""
        import mujoco
        from mujoco.rollout import rollout

        whole = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.empty(mujoco.mj_stateSize(self.model, whole))
        mujoco.mj_getState(self.model, run.data, start, whole)
        states, _ = rollout(self.model, run.data, start, control)
        # A state is the time, then the positions.
        return np.vstack([window.q, states[0][keep - 1 :: keep][:, 1 + self._qpos]])

    def _acting(self, velocity: Array, held: Array) -> Acting:
        """Friction and torques of the coming step, at speeds ``(n_runs, n_joints)``.

        Args:
            velocity: of the joints [rad/s].
            held: ``(n_runs, nv)`` damping that does not change.
        """
        acting = Acting(np.tile(self._friction, (len(held), 1)), held.copy(), np.zeros_like(held))
        self._borne = None
        for rubbing in self._dry.acting(self._friction[self._dof], velocity, self.model.opt.timestep):
            dof = self._dof[rubbing.joint]
            acting.friction[:, dof] = rubbing.level
            acting.damping[:, dof] += rubbing.damping
            acting.applied[:, dof] = rubbing.force
        for j, note in self._notes:
            acting.applied[:, self._dof[j]] += note.torque(self._steps[j])
        return acting

    def _carried_by(self, j: int) -> Array:
        # All notes of a step ask for the last one's torques, and few notes ask.
        if self._borne is None:
            now = [run.carried() for run in self.runs[: len(self._load)]]
            self._borne = self._load if self.runs[0].data.time == 0.0 else np.array(now)[:, self._dof]
        return np.asarray(self._borne[:, j])


# Friction of simulated joints at every step, as notes and bristles have it.


@dataclass(eq=False)
class _Part:
    """A note of a joint's friction.

    Attributes:
        joint: index of the joint.
        note: the note.
        bristle: bristles of its own; None where it has none, or where they hold all of the joint's dry friction.
    """

    joint: int
    note: Note
    bristle: Bristle | None = None


class Rubbing(NamedTuple):
    """Friction of a joint over a step, in every run: all but the joint ``(n_runs,)``.

    Attributes:
        joint: index of the joint.
        level: dry friction that no bristles hold [N·m].
        damping: viscous friction and damping of bristles, beside the joint's constant damping [N·m·s/rad].
        force: torque of bristles [N·m].
    """

    joint: int
    level: Array
    damping: Array
    force: Array


class JointFriction:
    """Friction levels of all joints at every step, and the bristles of those that have some.

    Attributes:
        bristles: by joint, those of all joints.
    """

    def __init__(self, notes: Sequence[tuple[int, Note]], steps: Sequence[JointStep]):
        """Pick what is friction from a model's notes.

        Args:
            notes: all notes, each with the index of its joint.
            steps: the joints; which of them bend is noted there.
        """
        self._steps = steps
        every = [_Part(j, note) for j, note in notes if note.rubs]
        # Bristles that hold all of a joint's dry friction.
        self._whole: dict[int, Bristle] = {}
        for part in every:
            bristle = part.note.bristle()
            if bristle is not None and part.note.takes_all:
                self._whole[part.joint] = bristle
            else:
                part.bristle = bristle
        for part in every:
            if part.bristle is None and part.note.static is not None and part.joint in self._whole:
                self._whole[part.joint].static = part.note.static
        for j in self._whole:
            steps[j].bends = True
        own = ((part.joint, part.bristle) for part in every if part.bristle is not None)
        self.bristles = (*self._whole.items(), *own)
        self._by_joint: dict[int, list[_Part]] = {}
        for part in every:
            self._by_joint.setdefault(part.joint, []).append(part)

    def start(self, windows: Sequence[Window]) -> None:
        """Begin a window in every run, bristles bent as the record before it did."""
        for j, bristle in self.bristles:
            bristle.start([_before(window.past, j) for window in windows])

    def acting(self, level: Array, v: Array, step: float) -> Iterator[Rubbing]:
        """What rubs at each joint that a note is about, over the coming step.

        Args:
            level: constant levels of dry friction, ``(n_joints,)`` [N·m].
            v: speeds of the joints, ``(n_runs, n_joints)`` [rad/s].
            step: length of the step [s].
        """
        for j, parts in self._by_joint.items():
            here, viscous = np.full(len(v), level[j]), np.zeros(len(v))
            held: list[tuple[Bristle, Array]] = []
            for part in parts:
                if part.bristle is not None:
                    held.append((part.bristle, part.note.held(here)))
                here, more = part.note.friction(here, self._steps[j])
                viscous = viscous + more
            here = np.maximum(here, 0.0)
            force = damping = np.zeros(len(v))
            whole = self._whole.get(j)
            if whole is not None:
                force, damping = whole.force(here, v[:, j], step)
                here = np.zeros(len(v))
            for bristle, size in held:
                f, d = bristle.force(np.maximum(size, 0.0), v[:, j], step)
                force, damping = force + f, damping + d
            yield Rubbing(j, here, viscous + damping, force)

    def move(self, v: Array, step: float) -> None:
        """Bend all bristles by the step that was made at speeds of all joints, ``(n_runs, n_joints)`` [rad/s]."""
        for j, bristle in self.bristles:
            bristle.move(v[:, j], step)


def _before(past: Past | None, j: int) -> tuple[Array, float]:
    """Speeds of a joint in the record before a window, and the period of these [s]."""
    if past is None:
        return np.zeros(0), 0.0
    return np.ascontiguousarray(past.v[:, j]), float(past.time[1] - past.time[0])


# The lag of simulated motors: a filter before them, and one that the model has in them.


@dataclass(frozen=True)
class MotorLag:
    """First-order filters of what motors are told.

    Attributes:
        before: time constant of the filter before the motors [s]; 0 without one.
        within: of the one that the model has [s]; None without one.
    """

    before: float
    within: float | None

    def share(self, step: float) -> float:
        """Share of what it is told that the filter before the motors follows in a step [s]."""
        return _share(step, self.before)

    def begun(self, window: Window, drive: Drive, delay: float) -> tuple[Array, Array]:
        """What the filters have come to at a window's start, before the motors and in them, ``(n_joints,)`` [N·m].

        Args:
            window: with the record before it; without that the motors have been told the same for long.
            drive: what tells them.
            delay: by which that is read later [s].
        """
        past = window.past
        if past is None or self.within is None:
            now = drive.answer(drive.offers(window.time[:1] + delay)[0], window.q, window.v)
            return now, now
        period = float(past.time[1] - past.time[0])
        first, second = _share(period, self.before), _share(period, self.within)
        one = two = drive.answer(drive.offers(past.time[:1] + delay)[0], past.q[0], past.v[0])
        # Half a period on: the command of an interval, not of its start.
        times = past.time[:-1] + 0.5 * period + delay
        for torque in drive.answer(drive.offers(times), past.q[:-1], past.v[:-1]):
            one = one + first * (torque - one)
            two = two + second * (one - two)
        return one, two


def _share(period: float, time_constant: float) -> float:
    """Share of a step that a first-order filter follows within a period."""
    return float(-np.expm1(-period / time_constant)) if time_constant > 0.0 else 1.0


# MuJoCo's state of a run, and what acts in a step of several of them.


class Run:
    """State of a run of a model, and MuJoCo's own arrays in it, which to ask for takes as long as a step.

    Attributes:
        data: the state.
        qpos: ``(nq,)`` positions in it.
        qvel: ``(nv,)`` velocities.
        ctrl: ``(nu,)`` what the motors are told.
        applied: ``(nv,)`` torques that are applied [N·m].
    """

    def __init__(self, model: mujoco.MjModel):
        """Make the state of a run of a model."""
        import mujoco

        self.data = mujoco.MjData(model)
        self.qpos, self.qvel, self.ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self.applied = self.data.qfrc_applied
        self._forces = (self.data.qfrc_actuator, self.data.qfrc_passive, self.data.qfrc_constraint)
        self._armature, self._acceleration = model.dof_armature, self.data.qacc

    def carried(self) -> Array:
        """Torques that the gears carry, ``(nv,)``: what the last step's motors gave less friction and rotors [N·m]."""
        motor, passive, constraint = self._forces
        return motor + passive + constraint + self.applied - self._armature * self._acceleration


def motion(runs: Sequence[Run], positions: Array, velocities: Array) -> tuple[Array, Array]:
    """Positions [rad] and velocities [rad/s] of joints in all runs, ``(n_runs, n_joints)`` each.

    Args:
        runs: the runs.
        positions: ``(n_joints,)`` places of the joints' positions in the state.
        velocities: of their velocities.
    """
    q, v = np.array([run.qpos for run in runs]), np.array([run.qvel for run in runs])
    return q[:, positions], v[:, velocities]


class Acting(NamedTuple):
    """What acts in a step of several runs, each ``(n_runs, nv)``.

    Attributes:
        friction: levels of dry friction [N·m].
        damping: [N·m·s/rad].
        applied: torques beside the motors' [N·m].
    """

    friction: Array
    damping: Array
    applied: Array
