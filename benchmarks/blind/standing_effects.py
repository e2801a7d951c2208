"""Effects hidden in a standing robot: their magnitudes, and exact inverse dynamics with the share of the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from benchmarks.blind.standing_case import Pull, Stand
from excite.arrays import Array, Moved
from excite.motion.generators.generator import leg_joints
from excite.motion.motion import Motion
from excite.robot.robot import Foot, Robot
from excite.safety.ground_forces import distribute_wrench, wrench_at_world_origin
from excite.simulation.sensing import sensor_wrenches
from excite.simulation.virtual_robot import Reading, Recording

# What really happens when a standing robot runs a motion: exact inverse dynamics, and the ground's share of
# it.

# Time over which a foot is unloaded before it is lifted [s].
_UNLOADING_S = 0.25


@dataclass(frozen=True, eq=False)
class Truth:
    """A standing robot with what is hidden in it.

    Attributes:
        stand: the robot as the log tells it, and its session.
        model: true kinematics.
        phi: ``(10·n_segments,)`` true inertial parameters.
        pulls: forces that the log does not know.
        readings: what sits between the physics and the log, in order; may replace q and the wrenches.
    """

    stand: Stand
    model: pin.Model
    phi: Array
    pulls: tuple[Pull, ...] = ()
    readings: tuple[Reading, ...] = ()

    def logged(self) -> list[Recording]:
        """All trials as perfect sensors would log them."""
        recordings = []
        for k, motion in enumerate(self.stand.motions):
            # The repeated command is another trial.
            recording = true_recording(self, motion, k)
            for reading in self.readings:
                recording = reading(recording)
            recordings.append(recording)
        return recordings


def truth_of(stand: Stand) -> Truth:
    """The robot with nothing hidden in it."""
    return Truth(stand, stand.robot.model, stand.phi)


def true_recording(truth: Truth, motion: Motion, trial: int) -> Recording:
    """One trial before any sensor looks at it.

    The base's rows of inverse dynamics hold contacts and pulls alone (Jovic et al. 2016, eq. 2); what the pulls
    leave is shared among the soles as the ground's forces can.

    Args:
        truth: the robot.
        motion: where soles and base go; where a leg differs from its model, the leg's joints follow.
        trial: number of the trial.

    Returns:
        The recording; ``tau_link`` are the joints' torques.
    """
    robot, model = truth.stand.robot, _with_inertials(truth.model, truth.phi)
    q, v, a = plant_feet(robot, model, motion)
    acting = {1, *(foot.joint for foot in robot.feet), *(pull.joint for pull in truth.pulls)}
    rotation, position, speeds = _link_poses(model, q, v, acting)
    outside = {joint: np.zeros((len(q), 6)) for joint in range(1, model.njoints)}
    for pull in truth.pulls:
        j = pull.joint
        arm = np.einsum("nij,j->ni", rotation[:, j], np.array(pull.point))
        place = position[:, j] + arm
        speed = speeds[:, j, :3] + np.cross(speeds[:, j, 3:], arm)
        force = pull.force(motion.time - motion.time[0], place, speed, trial)
        outside[j] += np.hstack([force, np.cross(place, force)])
    needed = _inverse_dynamics(model, q, v, a, outside, rotation, position)
    wrench = wrench_at_world_origin(needed[:, :6], rotation[:, 1], position[:, 1])
    contacts = _share_wrench(robot, motion, wrench, rotation, position)
    for sensor_foot, share in contacts.items():
        outside[_foot_of(robot, sensor_foot).joint] += share
    torques = _inverse_dynamics(model, q, v, a, outside, rotation, position)[:, 6:]
    return Recording(
        name=motion.name,
        time=motion.time - motion.time[0],
        q=q,
        v=v,
        a=a,
        q_cmd=q[:, 7:],
        tau_motor=torques,
        tau_link=torques,
        clipped=np.zeros(torques.shape, dtype=bool),
        contacts=contacts,
        wrenches=sensor_wrenches(replace(robot, model=model), truth.phi, q, v, a, contacts),
        touches=np.zeros(len(q)),
    )


def _with_inertials(model: pin.Model, phi: Array) -> pin.Model:
    changed = model.copy()
    for joint in range(1, model.njoints):
        block = phi[10 * joint - 10 : 10 * joint]
        if block.any():
            changed.inertias[joint] = pin.Inertia.FromDynamicParameters(block)
    return changed


def _foot_of(robot: Robot, link: str) -> Foot:
    return next(foot for foot in robot.feet if foot.link == link)


class _Poses(NamedTuple):
    """World rotations, positions, and velocities (linear, angular, of the joint's origin) of some joints."""

    rotation: Array
    position: Array
    speeds: Array


def _link_poses(model: pin.Model, q: Array, v: Array, joints: set[int]) -> _Poses:
    data, n = model.createData(), model.njoints
    rotation, position = np.zeros((len(q), n, 3, 3)), np.zeros((len(q), n, 3))
    speeds = np.zeros((len(q), n, 6))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k], v[k])
        for j in joints:
            pose, twist = data.oMi[j], data.v[j]
            rotation[k, j], position[k, j] = pose.rotation, pose.translation
            speeds[k, j, :3], speeds[k, j, 3:] = pose.rotation @ twist.linear, pose.rotation @ twist.angular
    return _Poses(rotation, position, speeds)


def _inverse_dynamics(
    model: pin.Model,
    q: Array,
    v: Array,
    a: Array,
    outside: Mapping[int, Array],
    rotation: Array,
    position: Array,
) -> Array:
    """``(n, nv)`` with outside wrenches (about the world's origin) on some joints' bodies."""
    data = model.createData()
    out = np.empty_like(v)
    local = np.zeros((len(q), model.njoints, 6))
    acting = [j for j, wrench in outside.items() if wrench.any()]
    for j in acting:
        force, about = outside[j][:, :3], outside[j][:, 3:]
        moment = about - np.cross(position[:, j], force)
        local[:, j, :3] = np.einsum("nji,nj->ni", rotation[:, j], force)
        local[:, j, 3:] = np.einsum("nji,nj->ni", rotation[:, j], moment)
    forces = pin.StdVec_Force()
    forces.extend([pin.Force.Zero() for _ in range(model.njoints)])
    for k in range(len(q)):
        for j in acting:
            forces[j] = pin.Force(local[k, j])
        out[k] = pin.rnea(model, data, q[k], v[k], a[k], forces)
    return out


def _share_wrench(
    robot: Robot, motion: Motion, wrench: Array, rotation: Array, position: Array
) -> dict[str, Array]:
    """Contact wrench of each foot by its link, about the world's origin; together they are ``wrench (n, 6)``.

    A foot that is about to leave the ground is unloaded before; what no admissible forces supply is put on the
    feet that stand, as if their soles were wider.
    """
    weights = {foot.name: _foot_loading(motion, foot.name) for foot in robot.feet}
    parts = {foot.link: np.zeros((len(wrench), 6)) for foot in robot.feet}
    for standing, share in _support_sets(robot, motion, weights):
        rows = np.flatnonzero(share > 0.0)
        corners = np.concatenate(
            [
                position[rows, foot.joint][:, None]
                + foot.sole @ rotation[rows, foot.joint].transpose(0, 2, 1)
                for foot in standing
            ],
            axis=1,
        )
        friction = np.concatenate([np.full(len(foot.sole), foot.friction) for foot in standing])
        forces = distribute_wrench(wrench[rows], corners, friction).forces
        moments = np.cross(corners, forces)
        each, start = [], 0
        for foot in standing:
            own = slice(start, start + len(foot.sole))
            each.append(np.hstack([forces[:, own].sum(axis=1), moments[:, own].sum(axis=1)]))
            start += len(foot.sole)
        left = (wrench[rows] - sum(each)) / len(standing)
        for foot, part in zip(standing, each, strict=True):
            parts[foot.link][rows] += share[rows, None] * (part + left)
    return parts


def _foot_loading(motion: Motion, foot: str) -> Array:
    """1 where a foot carries, falling smoothly to 0 before it is lifted, and rising after it is put down."""
    flags = np.asarray(motion.contacts[foot], dtype=bool)
    step = float(motion.time[1] - motion.time[0])
    away = np.flatnonzero(~flags)
    if not len(away):
        return np.ones(len(flags))
    index = np.arange(len(flags))
    after = np.searchsorted(away, index).clip(0, len(away) - 1)
    near = np.minimum(np.abs(index - away[after]), np.abs(index - away[np.maximum(after - 1, 0)]))
    s = np.clip(near * step / _UNLOADING_S, 0.0, 1.0)
    return np.asarray(s**2 * (3.0 - 2.0 * s))


def _support_sets(
    robot: Robot, motion: Motion, weights: Mapping[str, Array]
) -> list[tuple[list[Foot], Array]]:
    """Sets of standing feet and the share of each in time; the shares add up to one."""
    both = np.min([weights[foot.name] for foot in robot.feet], axis=0)
    sets = [(list(robot.feet), both)]
    for foot in robot.feet:
        others = [weights[other.name] for other in robot.feet if other.name != foot.name]
        sets.append(([foot], np.where(np.min(others, axis=0) < weights[foot.name], 1.0 - both, 0.0)))
    return sets


# Legs that differ from their model, and soles that stay where they stand all the same.

_MOST_STEPS, _CLOSE = 20, 1e-10


def plant_feet(robot: Robot, model: pin.Model, motion: Motion) -> Moved:
    """The motion with the legs' joints such that base and soles go where they were planned to go."""
    nominal = robot.model
    moved = {
        j
        for j in range(2, model.njoints)
        if not model.jointPlacements[j].isApprox(nominal.jointPlacements[j])
    }
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    for foot in robot.feet:
        if not moved & {int(j) for j in nominal.supports[foot.joint]}:
            continue
        chain = [index + 2 for index in leg_joints(robot, foot)]
        shift = np.array(_leg_shift(nominal, model, foot.joint, chain, motion.q))
        columns = [model.idx_vs[j] for j in chain]
        rates = _finite_differences(motion.time, shift)
        for k, column in enumerate(columns):
            q[:, column + 1] += shift[:, k]
            v[:, column] += rates[0][:, k]
            a[:, column] += rates[1][:, k]
    return Moved(q, v, a)


def _leg_shift(nominal: pin.Model, model: pin.Model, foot: int, chain: list[int], plan: Array) -> list[Array]:
    """By sample, what the joints of a chain turn beyond the plan so that the foot is where it was planned."""
    wanted, data = nominal.createData(), model.createData()
    columns = [model.idx_vs[j] for j in chain]
    shifts, shift = [], np.zeros(len(chain))
    for row in plan:
        pin.forwardKinematics(nominal, wanted, row)
        q = row.copy()
        for _ in range(_MOST_STEPS):
            q[[column + 1 for column in columns]] = row[[column + 1 for column in columns]] + shift
            jacobian = pin.computeJointJacobian(model, data, q, foot)[:, columns]
            pin.forwardKinematics(model, data, q)
            error = pin.log6(data.oMi[foot].actInv(wanted.oMi[foot])).vector
            if error @ error < _CLOSE**2:
                break
            # A little damping where the leg cannot reach.
            normal = jacobian.T @ jacobian + 1e-8 * np.eye(len(chain))
            shift = shift + np.linalg.solve(normal, jacobian.T @ error)
        shifts.append(shift.copy())
    return shifts


def _finite_differences(time: Array, values: Array) -> tuple[Array, Array]:
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(time, values, k=5, axis=0)
    return spline.derivative(1)(time), spline.derivative(2)(time)


# What a standing robot's sensors make of what happens.


@dataclass(frozen=True)
class Mixed:
    """A wrench sensor whose channels are scaled or leak into each other.

    Attributes:
        sensor: its name.
        matrix: logged = matrix · true, six rows of six.
    """

    sensor: str
    matrix: tuple[tuple[float, ...], ...]

    def __call__(self, recording: Recording) -> Recording:
        """The recording with it."""
        wrench = recording.wrenches[self.sensor] @ np.array(self.matrix).T
        return replace(recording, wrenches={**recording.wrenches, self.sensor: wrench})


@dataclass(frozen=True)
class Bent:
    """A joint with a soft gear: the encoder sits on the motor's side.

    Attributes:
        joint: index of the actuated joint.
        stiffness: [N·m/rad]
        hardening: relative growth of the stiffness per N·m of load; 0 for a linear gear.
    """

    joint: int
    stiffness: float
    hardening: float = 0.0

    def __call__(self, recording: Recording) -> Recording:
        """Logged = true angle + torque / stiffness."""
        torque = recording.tau_link[:, self.joint]
        bend = torque / (self.stiffness * (1.0 + self.hardening * np.abs(torque)))
        q = recording.q.copy()
        q[:, 7 + self.joint] += bend
        return replace(recording, q=q)


@dataclass(frozen=True, eq=False)
class Wobbly:
    """Markers on soft tissue: a damped oscillator that the segment's own acceleration drives.

    Attributes:
        model: kinematics.
        joint: index of the actuated joint, the segment's first.
        gain: angle by acceleration, static, along the segment's axes, ``(3,)`` [rad·s²/m].
        hertz: of the tissue on the bone.
        ratio: its damping ratio.
    """

    model: pin.Model
    joint: int
    gain: tuple[float, float, float]
    hertz: float
    ratio: float

    def __call__(self, recording: Recording) -> Recording:
        """Logged = true angle + the tissue's."""
        from scipy.signal import cont2discrete, lfilter

        omega = 2.0 * np.pi * self.hertz
        step = float(recording.time[1] - recording.time[0])
        top, bottom, _ = cont2discrete(
            ([omega**2], [1.0, 2.0 * self.ratio * omega, omega**2]), step, method="bilinear"
        )
        q = recording.q.copy()
        q[:, 7 + self.joint] -= lfilter(np.ravel(top), bottom, self._pull(recording) @ np.array(self.gain))
        return replace(recording, q=q)

    def _pull(self, recording: Recording) -> Array:
        """World acceleration of the joint's origin, ``(n, 3)``."""
        data, rows = self.model.createData(), []
        # The universe and the free base come before the actuated joints.
        joint = self.joint + 2
        for q, v, a in zip(recording.q, recording.v, recording.a, strict=True):
            pin.forwardKinematics(self.model, data, q, v, a)
            spin, linear = data.v[joint].angular, data.v[joint].linear
            rows.append(data.oMi[joint].rotation @ (data.a[joint].linear + np.cross(spin, linear)))
        return np.array(rows)
