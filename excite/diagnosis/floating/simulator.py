"""The augmented simulator of robots with a free base, and its roll-outs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.answer import Rollout
from excite.diagnosis.answer.gap import RolloutPath
from excite.diagnosis.floating.hypotheses import Fitted, Placed, apply_all, refine_fit
from excite.diagnosis.floating.problem import Problem
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.registry import EVERY_FORM
from excite.diagnosis.floating.spectrum import BAND_HZ
from excite.diagnosis.floating.state import State
from excite.diagnosis.simulator.augmented_plant import (
    MODEL,
    NOTE,
    AugmentedModel,
    PhysicalBodies,
    describe_left_out,
    describe_mismatch,
    load_model,
    model_notes,
    nearest_bodies,
    refused_model_error,
)
from excite.errors import InputError
from excite.motion.content import BASE_POSE
from excite.progress import step
from excite.robot.robot import Robot
from excite.simulation.coordinates import body_name
from excite.simulation.mjcf import World, build_spec, mujoco_quaternion
from excite.simulation.true_parameters import MASSLESS_KG, Drives, nominal_drives

if TYPE_CHECKING:
    import mujoco

# Effects written beside a model that cannot express them, and read again.


def describe_effect(state: State, item: Placed, theta: Array) -> str:
    """An effect's parameters by name, SI, and what it has learnt beside these, as JSON.

    Args:
        state: the nominal state.
        theta: its parameters.
    """
    names = [parameter.name for parameter in item.effect.parameters_at(state, item.location)]
    parameters = dict(zip(names, theta.tolist(), strict=True))
    return json.dumps({"parameters": parameters, **item.effect.stored_data(state.record)})


def read_notes(model: mujoco.MjModel, record: FloatingRecord) -> tuple[tuple[Placed, ...], tuple[Array, ...]]:
    """The effects noted in a loaded model, in order, and their parameters.

    Args:
        record: the record that it is run on.

    Raises:
        InputError: a note is of no effect that is known.
    """
    found = []
    for rest, data in model_notes(model):
        number, word, location = rest.split(".", 2)
        said = json.loads(data)
        if word not in EVERY_FORM:
            raise InputError(
                f"the model has a note of no effect that is known ({NOTE}.{rest})",
                field=word,
                remedy="name it by a form that `excite effects` lists",
            )
        effect = EVERY_FORM[word].with_stored_data(said, record)
        found.append((int(number), Placed(effect, location), np.array([*said["parameters"].values()])))
    found.sort(key=lambda item: item[0])
    return tuple(item for _, item, _ in found), tuple(theta for *_, theta in found)


# The nominal simulator of a standing robot with the accepted effects in it: a MuJoCo model, and notes beside
# it.

_NO_LIMIT = 1e6
_TIMESTEP = 1e-3


def standing_model(problem: Problem, fitted: Fitted) -> AugmentedModel:
    """The simulator with a fit's inertial parameters and effects.

    Args:
        fitted: the fit; without effects it gives the nominal simulator.

    Raises:
        InputError: MuJoCo takes no such model.
    """
    state = apply_all(problem.state_with_errors(fitted.delta), fitted.placed, fitted.theta)
    phi, mismatch = _physical_parameters(problem, state)
    try:
        spec = build_spec(
            _with_lengths(problem.record.robot, state), phi, _stated_drives(problem), World(_TIMESTEP)
        )
        spec.option.gravity = problem.record.tree.gravity
        _add_sensors(spec, problem, state.placements)
        for number, (item, theta) in enumerate(zip(fitted.placed, fitted.theta, strict=True)):
            if not item.effect.mujoco_part:
                # The number keeps the order.
                name = f"{NOTE}.{number}.{item.effect.form_name}.{item.location}"
                spec.add_text(name=name, data=describe_effect(problem.nominal, item, theta))
        spec.compile()
    except ValueError as error:
        raise refused_model_error(error) from error
    return AugmentedModel(spec.to_xml(), describe_mismatch(mismatch, "noise"))


def _physical_parameters(problem: Problem, state: State) -> tuple[Array, float]:
    """Parameters of bodies that can exist, and by how many times the noise they are off the fitted ones (RMS)."""
    nominal = problem.record.tree.phi
    massive = np.repeat(nominal[::10] > 0.0, 10)
    bodies = PhysicalBodies(nominal[massive], np.zeros(0))
    wish = bodies.to_coordinates(state.phi[massive])
    if bodies.is_feasible(wish):
        return state.phi, 0.0
    rows = problem.whitening(state.regressor)[:, massive] @ bodies.map
    found, off = nearest_bodies(bodies, rows, wish, bodies.to_coordinates(nominal[massive]))
    phi = state.phi.copy()
    phi[massive] = bodies.map @ found
    return phi, off


def _with_lengths(robot: Robot, state: State) -> Robot:
    """The robot with its joints where a state has them."""
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        model.jointPlacements[joint] = pin.SE3(state.tree.rotations[joint], state.tree.translations[joint])
    return replace(robot, model=model)


def _stated_drives(problem: Problem) -> Drives:
    """The robot's own; gains and limits that it does not state are zero and none."""
    drives = nominal_drives(problem.record.robot)
    return replace(
        drives,
        kp=np.nan_to_num(drives.kp),
        kd=np.nan_to_num(drives.kd),
        torque_limit=np.nan_to_num(drives.torque_limit, nan=_NO_LIMIT, posinf=_NO_LIMIT),
    )


def _add_sensors(spec: mujoco.MjSpec, problem: Problem, placements: dict[str, pin.SE3]) -> None:
    """A site for each sensor, where its readings are expressed; of plates in the world."""
    robot = problem.record.robot
    for sensor in robot.sensors:
        body = spec.body(body_name(robot.segments[sensor.joint - 1].link)) if sensor.joint else spec.worldbody
        placement = placements[sensor.name]
        body.add_site(name=sensor.name, pos=placement.translation, quat=mujoco_quaternion(placement.rotation))


# Runs the simulator of a standing robot: joints as recorded, the ground's wrenches as logged, the base free.


class Simulator:
    """A loaded model.

    MuJoCo gives mass matrix and bias forces at every sample; the base's rows of the equation of motion, with
    the joints' accelerations and the sensors' wrenches, its acceleration. The base has no feedback: what the model
    has wrong grows with the square of time. Contacts, joint limits and drives are out of play.
    """

    def __init__(self, xml: str, record: FloatingRecord):
        """Load a model.

        Args:
            xml: the model's text.
            record: the record that it is compared with.
        """
        import mujoco

        self.model = load_model(xml)
        self.data = mujoco.MjData(self.model)
        self.record = record
        self.placed, self.theta = read_notes(self.model, record)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        # What is beyond a sensor is not part of what its reading moves.
        for segment in record.unmeasured:
            body = self.model.body(body_name(record.robot.segments[segment].link)).id
            self.model.body_mass[body] = MASSLESS_KG
            self.model.body_inertia[body] = 1e-3 * MASSLESS_KG
        names = record.robot.joint_names
        self._q = np.array([self.model.joint(name).qposadr[0] for name in names])
        self._v = np.array([self.model.joint(name).dofadr[0] for name in names])
        self._from = np.array([record.tree.names.index(name) for name in names])
        self._sites = {s.name: self.model.site(s.name).id for s in record.robot.sensors}

    @cached_property
    def driving_state(self) -> State:
        """The record as the model's notes say that it truly was, of the robot that the model says."""
        state = apply_all(self._state_of_model(), self.placed, self.theta)
        return state.replace(extra=np.broadcast_to(np.asarray(state.extra, dtype=float), (len(state.q), 6)))

    def _state_of_model(self) -> State:
        """The logged motion and readings of the robot with the model's bodies, lengths and sensors."""
        record, model = self.record, self.model
        phi, translations = np.zeros_like(record.tree.phi), record.tree.translations.copy()
        for k, segment in enumerate(record.robot.segments):
            body = model.body(body_name(segment.link))
            axes = pin.Quaternion(*body.iquat).matrix()
            inertia = pin.Inertia(float(body.mass[0]), body.ipos, axes @ np.diag(body.inertia) @ axes.T)
            phi[10 * k : 10 * k + 10] = inertia.toDynamicParameters()
            translations[segment.joint] = body.pos
        placements = {
            sensor.name: pin.SE3(pin.Quaternion(*site.quat).matrix(), site.pos)
            for sensor in record.robot.sensors
            for site in (model.site(sensor.name),)
        }
        tree = replace(record.tree, translations=translations)
        return State.from_log(record).replace(tree=tree, phi=phi, placements=placements)

    def run_window(self, window: slice, noise: Array | None = None, start: Array | None = None) -> Array:
        """Where the base ends up, less where it is, at each sample of a window, ``(n, 6)`` [m, rad].

        Second order in the step (velocity Verlet, with a predicted velocity in the bias forces).

        Args:
            window: its samples.
            noise: ``(n_samples, 6)`` wrench that is added, base frame.
            start: ``(6,)`` velocity that is added at the start, base frame.
        """
        state, step, first = self.driving_state, 1.0 / self.record.rate_hz, window.start
        extra = np.asarray(state.extra if noise is None else state.extra + noise)
        recorded = state.poses.rotation[:, 1]
        rotation = recorded[first]
        place, speed = state.q[first, :3].copy(), rotation @ state.v[first, :3]
        turning = state.v[first, 3:6].copy()
        if start is not None:
            speed, turning = speed + rotation @ start[:3], turning + start[3:]
        linear, angular = self._base_accelerations(extra, first, place, rotation, speed, turning)
        out = [np.zeros(6)]
        for k in range(window.start + 1, window.stop):
            place = place + step * speed + 0.5 * step**2 * linear
            rotation = rotation @ pin.exp3(step * turning + 0.5 * step**2 * angular)
            guess, guessed = speed + step * linear, turning + step * angular
            ahead = self._base_accelerations(extra, k, place, rotation, guess, guessed)
            speed = speed + 0.5 * step * (linear + ahead[0])
            turning = turning + 0.5 * step * (angular + ahead[1])
            linear, angular = ahead
            out.append(np.concatenate([place - state.q[k, :3], pin.log3(recorded[k].T @ rotation)]))
        return np.array(out)

    def _base_accelerations(
        self,
        extra: Array,
        k: int,
        place: Array,
        rotation: Array,
        speed: Array,
        turning: Array,
    ) -> tuple[Array, Array]:
        """Acceleration of the base's origin, world, and of its rotation, base frame, at a sample."""
        import mujoco

        model, data, state, tree = self.model, self.data, self.driving_state, self.record.tree
        quaternion = pin.Quaternion(rotation)
        data.qpos[:3] = place
        data.qpos[3:7] = quaternion.w, quaternion.x, quaternion.y, quaternion.z
        data.qvel[:3], data.qvel[3:6] = speed, turning
        data.qpos[self._q] = state.q[k, tree.idx_q[self._from]]
        data.qvel[self._v] = state.v[k, tree.idx_v[self._from]]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        # The base's unit accelerations, and those of the joints.
        moves, forces = np.eye(7, model.nv), np.zeros((7, model.nv))
        moves[6] = 0.0
        moves[6, self._v] = state.a[k, tree.idx_v[self._from]]
        for move, needed in zip(moves, forces, strict=True):
            mujoco.mj_mulM(model, data, needed, move)
        force, moment = rotation @ extra[k, :3], rotation @ extra[k, 3:]
        for name, site in self._sites.items():
            axes = data.site_xmat[site].reshape(3, 3)
            pull = axes @ state.readings[name][k, :3]
            force = force + pull
            moment = moment + axes @ state.readings[name][k, 3:]
            moment = moment + np.cross(data.site_xpos[site] - place, pull)
        wrench = np.concatenate([force, rotation.T @ moment])
        found = np.linalg.solve(forces[:6, :6].T, wrench - data.qfrc_bias[:6] - forces[6, :6])
        return found[:3], found[3:]


# Short roll-outs of a standing robot's nominal and augmented simulator against the record.

HORIZON_S = 0.5
CHANNELS = ("base.px", "base.py", "base.pz", "base.rx", "base.ry", "base.rz")
# Roll-outs by which it is told whether an effect helps.
_CHECKED = 40


@dataclass(frozen=True, eq=False)
class Noise:
    """A draw of the record's noise.

    Attributes:
        wrench: ``(n_samples, 6)`` [N, N·m], base frame.
        start: ``(n_samples, 6)`` of a velocity, should a roll-out start there [m/s, rad/s].
    """

    wrench: Array
    start: Array


class Reloaded:
    """The simulator of a fit, its model written and loaded again.

    Attributes:
        problem: the problem.
        fitted: the fit.
        model: the model as written.
    """

    def __init__(self, problem: Problem, fitted: Fitted):
        """Write the model and load it; InputError where MuJoCo refuses it."""
        self.problem, self.fitted = problem, fitted
        self.model = standing_model(problem, fitted)
        self._simulator = Simulator(self.model.xml, problem.record)

    def rollout_errors(self, windows: Sequence[slice], noise: Noise | None = None) -> Array:
        """Where the base ends up less where it was, ``(n_windows, n_samples, 6)`` [m, rad]."""
        if noise is None:
            return np.array([self._simulator.run_window(window) for window in windows])
        return np.array([self._simulator.run_window(w, noise.wrench, noise.start[w.start]) for w in windows])


NO_ROLLOUTS = Rollout(
    {},
    {},
    HORIZON_S,
    None,
    warnings=("no roll-outs: the forces at the feet, which drive them, are not measured",),
)


@step("roll out in the simulator")
def simulate_effects(
    problem: Problem, before: Fitted, after: Fitted, rng: np.random.Generator, out: Path | None
) -> Rollout:
    """Roll-outs of the validation trials; the augmented model is written where there is a folder.

    The base starts where the record has it and is moved by the wrenches that the sensors read, while the joints do what
    they did. Effects that bring the roll-outs of the identification trials no nearer to the record are left out of the
    model, the last first, and a warning says so.

    Args:
        before: the baseline's fit to the identification trials.
        after: that of the accepted effects.
        rng: of the replicas.
        out: folder of the model.
    """
    try:
        found, xml = _compare_rollouts(problem, before, after, rng)
    except InputError as error:
        # A body that no simulator has is no reason to say nothing else.
        return Rollout({}, {}, HORIZON_S, None, warnings=(f"no roll-outs: {error}",))
    if out is None:
        return found
    write_text(out / MODEL, xml)
    return replace(found, model=MODEL)


def _compare_rollouts(
    problem: Problem, before: Fitted, after: Fitted, rng: np.random.Generator
) -> tuple[Rollout, str]:
    """The comparison and the augmented model; InputError where there can be no roll-outs."""
    record = problem.record
    windows = _rollout_windows(record, validation=True) or _rollout_windows(record, validation=False)
    if not windows:
        raise InputError(f"no trial is as long as a roll-out of {HORIZON_S:g} s", remedy="record longer ones")
    nominal = Reloaded(problem, before)
    plain, noise = nominal.rollout_errors(windows), _draw_noise(problem, rng)
    made = _keep_helpful_effects(nominal, after)
    moved = made.rollout_errors(windows) if made.fitted.placed else plain
    left = [f"{p.effect.name} at {p.location}" for p in after.placed[len(made.fitted.placed) :]]
    found = Rollout(
        before=_channel_rms(plain),
        after=_channel_rms(moved),
        horizon_s=(windows[0].stop - windows[0].start - 1) / record.rate_hz,
        model=None,
        driven_by="the sensors' wrenches and the joints' motion, the base free",
        warnings=(*made.model.warnings, *describe_left_out(left)),
        floor=_channel_rms(nominal.rollout_errors(windows, noise) - plain),
        path=base_path(record, windows, plain, moved),
    )
    return found, made.model.xml


def _rollout_windows(record: FloatingRecord, *, validation: bool) -> list[slice]:
    """Roll-outs, one after the other, of the trials of a role."""
    length = round(HORIZON_S * record.rate_hz)
    return [
        slice(first, first + length + 1)
        for span, held_out in zip(record.spans, record.validation, strict=True)
        if held_out is validation
        for first in range(span.start, span.stop - length, length)
    ]


def _keep_helpful_effects(nominal: Reloaded, after: Fitted) -> Reloaded:
    """The simulator with as many effects as bring roll-outs of the identification trials nearer.

    The last of them has to do so as well. Where all trials are for validation, these tell.
    """
    problem, made = nominal.problem, [nominal]
    for count in range(1, len(after.placed) + 1):
        fitted = after
        if count < len(after.placed):
            placed, theta = after.placed[:count], after.theta[:count]
            fitted = refine_fit(problem.identification_only, placed, theta, after)
        made.append(Reloaded(problem, fitted))
    if len(made) > 1:
        windows = _rollout_windows(problem.record, validation=False) or _rollout_windows(
            problem.record, validation=True
        )
        windows = windows[:: max(1, len(windows) // _CHECKED)]
        left = [np.square(each.rollout_errors(windows)).mean(axis=(0, 1)) for each in made]
        for count in range(len(after.placed), 0, -1):
            # In proportion: metres and radians do not add.
            if all(float(np.mean(left[count] / left[other])) < 1.0 for other in (0, count - 1)):
                return made[count]
    return nominal


def _draw_noise(problem: Problem, rng: np.random.Generator) -> Noise:
    """Wrenches as the whitening takes them away; velocities of what is above the motion's band, and noise alone."""
    whitening, record = problem.whitening, problem.record
    wrench = np.zeros((record.n_samples, 6))
    for span, factor in zip(record.spans, whitening.factors, strict=True):
        n, bins = span.stop - span.start, len(factor)
        white = rng.standard_normal((2, bins, 6, 1))
        white[1, 0] = 0.0
        real, imaginary = np.linalg.solve(factor, white)[..., 0]
        spectrum = np.zeros((n // 2 + 1, 6), dtype=complex)
        spectrum[:bins] = np.sqrt(n) * (real + 1j * imaginary)
        wrench[span] = np.fft.irfft(spectrum, n, axis=0)
    twist = record.v[:, :6]
    fast = (twist - record.smooth_signal(twist, BAND_HZ)).std(axis=0)
    return Noise(wrench, fast * rng.standard_normal((record.n_samples, 6)))


def _channel_rms(values: Array) -> dict[str, float]:
    return dict(zip(CHANNELS, np.sqrt(np.square(values).mean(axis=(0, 1))).tolist(), strict=True))


# Roll-outs of a standing robot's base put back where they lie in a trial, for a picture in motion.


def base_path(record: FloatingRecord, windows: Sequence[slice], before: Array, after: Array) -> RolloutPath:
    """The trial of which most was simulated: its base's poses and its joints.

    Args:
        record: the trials.
        windows: samples of the roll-outs.
        before: where the base ends up less where it was, ``(n_windows, n_samples, 6)`` [m, rad], of the nominal
            simulator, turns in the base's frame.
        after: of the one with the effects, likewise.
    """
    ends = [span.stop for span in record.spans]
    inside = np.searchsorted(ends, [window.start for window in windows], side="right")
    trial = int(np.bincount(inside).argmax())
    span = record.spans[trial]
    recorded = record.q[span]
    paths = [recorded.copy(), recorded.copy()]
    for where, window, *both in zip(inside, windows, before, after, strict=True):
        if where != trial:
            continue
        first = window.start - span.start
        for path, error in zip(paths, both, strict=True):
            # Of two windows that meet, the last sample is the first one's, which strayed for longest.
            for k, moved in enumerate(error[1:], start=first + 1):
                if k < len(path):
                    path[k, :7] = _displace_pose(recorded[k, :7], moved)
    names = (*BASE_POSE, *record.robot.joint_names)
    columns = [
        *range(7),
        *(record.robot.n_base_q + record.robot.joint_index(n) for n in record.robot.joint_names),
    ]
    time = np.arange(len(recorded)) / record.rate_hz
    return RolloutPath(
        record.trials[trial], names, time, recorded[:, columns], *(path[:, columns] for path in paths)
    )


def _displace_pose(pose: Array, error: Array) -> Array:
    """A pose, x y z qx qy qz qw, displaced in the world and turned in its own frame."""
    x, y, z, w = pose[3:]
    turned = pin.Quaternion(pin.Quaternion(w, x, y, z).matrix() @ pin.exp3(error[3:]))
    return np.concatenate([pose[:3] + error[:3], [turned.x, turned.y, turned.z, turned.w]])
