"""Roll-outs of an arm's augmented model: MuJoCo for what its XML says, a runner for the effects noted in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.form import DEFLECTION, JointStep, Note
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.simulator.augmented_plant import load_model, read_notes
from excite.logs.signals.butterworth import central_differences, lowpass
from excite.mujoco_warnings import has_diverged, without_log_file

if TYPE_CHECKING:
    import mujoco

# What a simulation starts from and what drives it.


@dataclass(frozen=True, eq=False)
class WindowHistory:
    """The record before a window: what bristles, filters and soft gears remember.

    Attributes:
        time: ``(n,)`` of the trial [s], evenly spaced; the last one is the window's start.
        q: ``(n, n_joints)`` positions [rad].
        v: ``(n, n_joints)`` velocities [rad/s].
    """

    time: Array
    q: Array
    v: Array


@dataclass(frozen=True, eq=False)
class Window:
    """A piece of a record to be simulated.

    Attributes:
        q: ``(n_joints,)`` positions at its start [rad].
        v: velocities at its start [rad/s].
        load: torque that the links need at its start [N·m]; sets how far soft and loose gears are deflected of which
            that is not told.
        time: ``(n_steps,)`` of the steps [s] since the trial's start.
        session_s: time of its start within the session [s].
        growth: by joint, how far friction that drifts has come at its start; from the session's clock where it
            is not given.
        past: the record before it; without it the robot was at rest.
        deflected: by joint, how far a soft or loose gear is deflected at its start [rad] and how fast it moves
            [rad/s]; it rests under its load where that is not given.
    """

    q: Array
    v: Array
    load: Array
    time: Array
    session_s: float
    growth: Mapping[str, float] = field(default_factory=dict)
    past: WindowHistory | None = None
    deflected: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Drive:
    """Torques of a trial's motors, ``torque(t) − kp q − kd v``; the record's own, no feedback, where kp is None.

    Attributes:
        time: ``(n,)`` [s].
        torque: ``(n, n_joints)`` in the zero position at rest [N·m].
        kp: ``(n_joints,)`` [N·m/rad].
        kd: ``(n_joints,)`` [N·m·s/rad].
    """

    time: Array
    torque: Array
    kp: Array | None = None
    kd: Array | None = None

    def at_times(self, times: Array) -> Array:
        """Rows of the torque at times of the trial, the first and last one beyond, ``(n, n_joints)``."""
        k = np.clip(np.searchsorted(self.time, times) - 1, 0, len(self.time) - 2)
        share = np.clip((times - self.time[k]) / (self.time[k + 1] - self.time[k]), 0.0, 1.0)[:, None]
        return (1.0 - share) * self.torque[k] + share * self.torque[k + 1]

    def motor_torque(self, torque: Array, q: Array, v: Array) -> Array:
        """What the motors are asked for at positions and velocities, all ``(…, n_joints)``."""
        return torque if self.kp is None or self.kd is None else torque - self.kp * q - self.kd * v


# Runs of a loaded model.


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
        self._delay = sum(item.note.late_by for item in every)
        self._filter_s = sum(item.note.filter_before for item in every)
        self._logged = np.zeros(len(joints))
        self._steps = tuple(JointStep(partial(self._carried_by, j)) for j in range(len(joints)))
        # By joint, its notes with the bristles of each, and the bristles that hold all of its dry friction.
        self._notes: dict[int, list[tuple[Note, Bristle | None]]] = {}
        self._whole: dict[int, Bristle] = {}
        for item in every:
            if item.place not in joints:
                continue
            j, note, bristle = joints.index(item.place), item.note, item.note.make_bristle()
            self._logged[j] += note.log_offset
            if bristle is not None and note.takes_all:
                self._whole[j], bristle, self._steps[j].bends = bristle, None, True
            self._notes.setdefault(j, []).append((note, bristle))
        for j, whole in self._whole.items():
            whole.static = next(
                (n.static_friction for n, own in self._notes[j] if n.static_friction and own is None), None
            )
        self._stepwise = any(note.every_step for notes in self._notes.values() for note, _ in notes)
        self.runs: list[mujoco.MjData] = []
        self._load = np.zeros((0, len(joints)))
        self._borne: Array | None = None

    def run_window(self, window: Window, drive: Drive, keep: int) -> Array:
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
        import mujoco

        self.model.opt.timestep = float(windows[0].time[1] - windows[0].time[0])
        while len(self.runs) < len(windows):
            self.runs.append(mujoco.MjData(self.model))
        self._load = np.array([window.load for window in windows])
        for run, window in zip(self.runs, windows, strict=False):
            self._place_run(run, window)
        self._start_notes(windows)
        late = self._delay if drives[0].kp is None else 0.0
        filtered = np.array(
            [self._start_filters(*pair, late) for pair in zip(self.runs, windows, drives, strict=False)]
        )
        asked = np.stack([d.at_times(w.time + late) for w, d in zip(windows, drives, strict=True)], axis=1)
        with without_log_file():
            if drives[0].kp is None and not self._stepwise:
                kept = self._run_open(windows, asked, filtered, keep)
            else:
                kept = self._run_stepwise(windows, drives[0], asked, filtered, keep)
        for path, run in zip(kept, self.runs, strict=False):
            if has_diverged(run):
                path[-1] = np.nan
        return kept

    def _place_run(self, run: mujoco.MjData, window: Window) -> None:
        """Put a run where its window begins; gears start as they are said to swing, or where their load puts them."""
        import mujoco

        mujoco.mj_resetData(self.model, run)
        run.qpos[self._qpos], run.qvel[self._dof] = window.q, window.v
        for j, notes in self._notes.items():
            for note, _ in notes:
                resting = note.resting_deflection(float(window.load[j]))
                if resting is not None:
                    joint = self.model.joint(self.joints[j] + DEFLECTION)
                    angle, speed = window.deflected.get(self.joints[j], (resting, 0.0))
                    run.qpos[joint.qposadr[0]], run.qvel[joint.dofadr[0]] = angle, speed

    def _start_notes(self, windows: Sequence[Window]) -> None:
        """Bristles are bent as the record before each window did; drifts have come as far as that is known."""
        for j in self._notes:
            told = [window.growth[self.joints[j]] for window in windows if self.joints[j] in window.growth]
            self._steps[j].growth = np.array(told) if len(told) == len(windows) else None
        for j, bristle in self._all_bristles():
            bristle.start_runs(
                [
                    (np.zeros(0), 0.0)
                    if (past := window.past) is None
                    else (np.ascontiguousarray(past.v[:, j]), float(past.time[1] - past.time[0]))
                    for window in windows
                ]
            )

    def _all_bristles(self) -> list[tuple[int, Bristle]]:
        own = [(j, own) for j, notes in self._notes.items() for _, own in notes if own is not None]
        return [*self._whole.items(), *own]

    def _start_filters(self, run: mujoco.MjData, window: Window, drive: Drive, late: float) -> Array:
        """What the filter before the motors has come to at a window's start, ``(n_joints,)``; sets the model's own."""
        past = window.past
        if past is None or not self.model.na:
            one = two = drive.motor_torque(drive.at_times(window.time[:1] + late)[0], window.q, window.v)
        else:
            period = float(past.time[1] - past.time[0])
            within = float(self.model.actuator_dynprm[self._motor[0], 0])
            first, second = _step_share(period, self._filter_s), _step_share(period, within)
            one = two = drive.motor_torque(drive.at_times(past.time[:1] + late)[0], past.q[0], past.v[0])
            # Half a period on: the command of an interval, not of its start.
            times = past.time[:-1] + 0.5 * period + late
            for torque in drive.motor_torque(drive.at_times(times), past.q[:-1], past.v[:-1]):
                one = one + first * (torque - one)
                two = two + second * (one - two)
        run.act[:] = two[: self.model.na]
        return one

    def _run_open(self, windows: Sequence[Window], asked: Array, filtered: Array, keep: int) -> Array:
        """:meth:`run_all` where nothing has to be looked at on the way: all steps at once."""
        import mujoco
        from mujoco.rollout import rollout

        model, whole = self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS
        model.dof_damping[:] = self._damping
        control = np.zeros((asked.shape[1], len(asked), model.nu))
        share = _step_share(model.opt.timestep, self._filter_s)
        for k, torque in enumerate(asked):
            filtered = filtered + share * (torque - filtered)
            control[:, k, self._motor] = filtered
        kept, start = [], np.empty(mujoco.mj_stateSize(model, whole))
        for run, window, told in zip(self.runs, windows, control, strict=False):
            mujoco.mj_getState(model, run, start, whole)
            states, _ = rollout(model, run, start, told)
            # A state is the time, then the positions.
            kept.append(np.vstack([window.q, states[0][keep - 1 :: keep][:, 1 + self._qpos]]))
        return np.array(kept)

    def _run_stepwise(
        self, windows: Sequence[Window], drive: Drive, asked: Array, filtered: Array, keep: int
    ) -> Array:
        """:meth:`run_all` where something has to be looked at on the way.

        Args:
            drive: one of the drives; they differ by their torques alone.
            asked: ``(n_steps, n_runs, n_joints)`` torques of the motors in the zero position at rest [N·m].
            filtered: ``(n_runs, n_joints)`` what the filter before the motors has come to [N·m].
            keep: as there.
        """
        import mujoco

        model, runs = self.model, self.runs[: len(windows)]
        share = _step_share(model.opt.timestep, self._filter_s)
        damping, kd = self._damping.copy(), np.zeros(len(self.joints)) if drive.kd is None else drive.kd
        if drive.kp is not None and not model.na:
            # The implicit step damps for the servo; behind a lag the servo damps late, which is no part of it.
            damping[self._dof] += kd * model.actuator_gainprm[self._motor, 0]
            drive = Drive(drive.time, drive.torque, drive.kp, np.zeros_like(kd))
        q, v = np.array([window.q for window in windows]), np.array([window.v for window in windows])
        kept = [q]
        clocks = [(float(window.time[0]), window.session_s) for window in windows]
        # To ask MuJoCo for an array takes as long as a step.
        states = [(run, run.qpos, run.qvel, run.ctrl, run.qfrc_applied) for run in runs]
        friction, damped = model.dof_frictionloss, model.dof_damping
        friction[:], damped[:] = self._friction, damping
        for step, elapsed in enumerate((windows[0].time - windows[0].time[0]).tolist()):
            filtered = filtered + share * (drive.motor_torque(asked[step], q - self._logged, v) - filtered)
            acting = (
                self._acting_forces(q, v, np.array(clocks) + elapsed, damping) if self._stepwise else None
            )
            for k, (run, _, _, control, applied) in enumerate(states):
                control[self._motor] = filtered[k]
                if acting is not None:
                    friction[:], damped[:], applied[:] = acting[:, k]
                mujoco.mj_step(model, run)
            q = np.array([state[1] for state in states])[:, self._qpos]
            v = np.array([state[2] for state in states])[:, self._dof]
            for j, bristle in self._all_bristles():
                bristle.advance_deflection(v[:, j], model.opt.timestep)
            if (step + 1) % keep == 0:
                kept.append(q)
        return np.stack(kept, axis=1)

    def _acting_forces(self, q: Array, v: Array, clocks: Array, damping: Array) -> Array:
        """Dry friction, damping and torques of the coming step, ``(3, n_runs, nv)``.

        Args:
            q: ``(n_runs, n_joints)`` positions [rad].
            v: velocities [rad/s].
            clocks: ``(n_runs, 2)`` time since the trial's and since the session's start [s].
            damping: ``(nv,)`` that does not change [N·m·s/rad].
        """
        n, step = len(v), self.model.opt.timestep
        made = np.zeros((3, n, len(damping)))
        made[0], made[1] = self._friction, damping
        self._borne = None
        for j, notes in self._notes.items():
            at, dof = self._steps[j], self._dof[j]
            at.q, at.v, at.trial_s, at.session_s = q[:, j], v[:, j], clocks[:, 0], clocks[:, 1]
            level, held = np.full(n, self._friction[dof]), []
            for note, bristle in notes:
                if bristle is not None:
                    held.append((bristle, note.held_friction(level)))
                level, viscous = note.joint_friction(level, at)
                made[1, :, dof] += viscous
                made[2, :, dof] += note.joint_torque(at)
            level = np.maximum(level, 0.0)
            if j in self._whole:
                held, level = [(self._whole[j], level), *held], np.zeros(n)
            made[0, :, dof] = level
            for bristle, size in held:
                force, more = bristle.friction_force(np.maximum(size, 0.0), v[:, j], step)
                made[1, :, dof] += more
                made[2, :, dof] += force
        return made

    def _carried_by(self, j: int) -> Array:
        """Torque that a joint's gear carries, ``(n_runs,)``: of the last step's motor, less friction and rotor."""
        # All notes of a step ask for the last one's torques, and few notes ask.
        if self._borne is None:
            runs = self.runs[: len(self._load)]
            self._borne = self._load
            if runs[0].time > 0.0:
                rotor = self.model.dof_armature
                now = [
                    r.qfrc_actuator + r.qfrc_passive + r.qfrc_constraint + r.qfrc_applied - rotor * r.qacc
                    for r in runs
                ]
                self._borne = np.array(now)[:, self._dof]
        return np.asarray(self._borne[:, j])


def _step_share(period: float, time_constant: float) -> float:
    """Share of a step that a first-order filter follows within a period."""
    return float(-np.expm1(-period / time_constant)) if time_constant > 0.0 else 1.0


# Which pieces of a record are simulated.

HORIZON_S = 0.5
_TOTAL_S = 16.0
_STEP_S = 1.25e-3
_START_HZ = 10.0
_EDGE_S = 0.3
_PAST_S = 2.0
# Where torques were beyond their range all pieces without such are simulated, or this share with the fewest.
_KNOWN = 0.25


@dataclass(frozen=True, eq=False)
class Plan:
    """How roll-outs are run.

    Attributes:
        horizon_s: length of one [s].
        drives: by name of the trial, where its torques come from.
        driven_by: the same in words.
        total_s: simulated time at most: roll-outs are spread evenly over longer records [s].
        growth: by joint, how far friction that drifts has come, one ``(n,)`` a trial.
        deflections: by joint, deflection of a soft or loose gear and its speed, one ``(n, 2)`` a trial.
        fitted: simulate the identification trials, not the validation trials.
        least_gain: share of some joint's squared error that each effect after the first has to take away.
        all_effects: whether errors with all effects are wanted where some do not help.
        noise: ``(n_joints,)`` standard deviation of the filtered positions' noise [rad or m]; None where it is unknown.
    """

    horizon_s: float
    drives: Mapping[str, Drive]
    driven_by: str
    total_s: float = _TOTAL_S
    growth: Mapping[str, list[Array]] = field(default_factory=dict)
    deflections: Mapping[str, list[Array]] = field(default_factory=dict)
    fitted: bool = False
    least_gain: float = 0.0
    all_effects: bool = False
    noise: Array | None = None


@dataclass(frozen=True, eq=False)
class Piece:
    """A window with the torques that drive it and the positions that were recorded.

    Attributes:
        window: where it starts.
        drive: what drives it.
        recorded: ``(n_kept, n_joints)`` [rad].
        keep: steps between recorded positions.
        trial: index of its trial.
        first: sample of the trial at which it starts.
    """

    window: Window
    drive: Drive
    recorded: Array
    keep: int
    trial: int
    first: int


def cut_pieces(samples: ArmSamples, rigid: Array, plan: Plan) -> list[Piece]:
    """Windows of the trials that the plan asks for, of all trials where there are no such ones.

    Args:
        rigid: ``(n_samples, n_joints)`` torque that the gears carry, for their deflection [N·m].
        plan: horizon and drives.
    """
    rate, trials = samples.rate_hz, samples.trials
    n, edge = round(plan.horizon_s * rate), round(_EDGE_S * rate)
    wanted = [k for k, t in enumerate(trials) if t.identification == plan.fitted] or list(range(len(trials)))
    starts = [(k, i) for k in wanted for i in range(edge, len(trials[k].time) - edge - n, n)]
    if starts and any(trial.beyond is not None for trial in trials):
        # Nobody knows what drove the robot where a torque was beyond its range.
        guessed = np.array(
            [
                0.0 if (b := trials[k].beyond) is None else b[i : i + n + 1].any(axis=1).mean()
                for k, i in starts
            ]
        )
        starts = [starts[p] for p in np.flatnonzero(guessed <= np.quantile(guessed, _KNOWN))]
    most = max(1, int(plan.total_s / plan.horizon_s))
    pick = np.unique(np.linspace(0, len(starts) - 1, min(most, len(starts))).round().astype(int))
    loads, cut, index = samples.by_trial(rigid), min(_START_HZ, 0.2 * rate), list(samples.index)
    smooth = {
        k: central_differences(lowpass(trials[k].q[:, index], rate, cut), rate)
        for k in {starts[p][0] for p in pick}
    }
    period = 1.0 / rate
    keep = max(1, int(np.ceil(period / _STEP_S - 1e-9)))
    step = period / keep
    found = []
    for k, i in (starts[p] for p in pick):
        trial, t0 = trials[k], float(trials[k].time[i])
        half = t0 - 0.5 * step
        before = slice(max(0, i - round(_PAST_S * rate)), i + 1)

        window = Window(
            smooth[k].value[i],
            np.array([np.interp(half, trial.time, column) for column in smooth[k].first.T]),
            loads[k][i],
            np.asarray(t0 + step * np.arange(n * keep), dtype=np.float64),
            float(trial.session_s[i]),
            {joint: float(values[k][i]) for joint, values in plan.growth.items()},
            WindowHistory(trial.time[before], smooth[k].value[before], trial.v[before][:, index]),
            {
                joint: (float(values[k][i, 0]), float(np.interp(half, trial.time, values[k][:, 1])))
                for joint, values in plan.deflections.items()
            },
        )
        recorded = trial.q[i : i + n + 1][:, index]
        found.append(Piece(window, plan.drives[trial.name], recorded, keep, k, i))
    return found
