"""Columns beside the rigid bodies' in the joint torque equation: drives, sensors, geometry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.regressor.contact_forces import motor_torques
from excite.robot.prismatic import is_prismatic
from excite.robot.robot import Robot

_STEP = 1e-5
# What turns speeds of sliding joints into those of turning ones [m].
_DRUM_M = 0.1


@dataclass(frozen=True, eq=False)
class JointSamples:
    """Samples at which columns are wanted.

    Attributes:
        robot: the robot in the log.
        q: ``(m, nq)``.
        v: ``(m, nv)``.
        a: ``(m, nv)``.
        joints: indices into ``v`` of the joints that have rows, ``(n_joints,)``.
        width: velocity over which Coulomb friction changes sign [rad/s]; joints that slide take a tenth of it in
            m/s, as if they were driven over a drum of 10 cm.
        motors: matrix ``C`` from joint to motor velocities, ``(n_joints, n_joints)``; None for the identity.
        load: makes torques of the nominal bodies, of forces at the feet too, ``(m, n_joints)`` [N·m or N], when a term
            asks for them; None for a robot that has no feet.
        rate: of the logged torques, likewise [N·m/s or N/s]; None where no term needs it.
    """

    robot: Robot
    q: Array
    v: Array
    a: Array
    joints: list[int]
    width: float
    motors: Array | None = None
    load: Callable[[], Array] | None = None
    rate: Array | None = None

    @property
    def widths(self) -> Array:
        """Velocities over which the joints' Coulomb friction changes sign, ``(n_joints,)`` [rad/s, m/s]."""
        model = self.robot.model
        return self.width * np.where([is_prismatic(model, column) for column in self.joints], _DRUM_M, 1.0)

    @property
    def velocity(self) -> Array:
        """Velocities of the joints' motors through their gears, ``(m, n_joints)``."""
        return self.v[:, self.joints] if self.motors is None else self.v[:, self.joints] @ self.motors.T

    @property
    def acceleration(self) -> Array:
        """Accelerations of the motors likewise, ``(m, n_joints)``."""
        return self.a[:, self.joints] if self.motors is None else self.a[:, self.joints] @ self.motors.T

    @property
    def shared_velocity(self) -> Array:
        """Velocities of the joints whose motor also turns with another, zero for others, ``(m, n_joints)``."""
        return np.where(self._shared, self.v[:, self.joints], 0.0)

    @property
    def shared_acceleration(self) -> Array:
        """Accelerations of those joints likewise, ``(m, n_joints)``."""
        return np.where(self._shared, self.a[:, self.joints], 0.0)

    @property
    def _shared(self) -> Array:
        if self.motors is None:
            return np.zeros(len(self.joints), dtype=bool)
        return np.asarray(np.count_nonzero(self.motors, axis=1) > 1)

    def own(self, values: Array) -> Array:
        """Columns that act on their own joint only: ``(m, n_joints)`` → ``(m, n_joints, n_joints)``."""
        columns = np.zeros((*values.shape, values.shape[1]))
        diagonal = np.arange(values.shape[1])
        columns[:, diagonal, diagonal] = values
        return columns

    def driven(self, values: Array) -> Array:
        """Columns of torques at the motors, brought to the joints by ``Cᵀ``, ``(m, n_joints, n_joints)``."""
        if self.motors is None:
            return self.own(values)
        return self.motors.T[None] * values[:, None, :]


@dataclass(frozen=True)
class DriveTerm:
    """A term of the joint torques that is linear in its parameters.

    Attributes:
        name: first part of its parameters' names, ``NAME.JOINT`` or ``NAME.JOINT.AXIS``.
        unit: unit of the parameters for a revolute joint.
        effects: words of ``modelled`` in ``log.yaml`` that ask for it.
        columns: torques ``(m, n_joints, n_parameters)`` per unit of each parameter.
        axes: names of the parameters of one joint, where it has more than one.
        spread: standard deviation that the parameters are expected to have; None where anything goes.
    """

    name: str
    unit: str
    effects: tuple[str, ...]
    columns: Callable[[JointSamples], Array]
    axes: tuple[str, ...] = ("",)
    spread: float | None = None

    def parameter_names(self, joints: tuple[str, ...]) -> tuple[str, ...]:
        """Names of all its parameters, joint by joint."""
        return tuple(f"{self.name}.{joint}{axis}" for joint in joints for axis in self.axes)


def smooth_sign(velocity: Array, width: float | Array) -> Array:
    """``tanh(velocity / width)``, the plain sign for width 0; one width for all or one a column.

    Args:
        velocity: ``(…, n_joints)`` [rad/s or m/s].
        width: a number or ``(n_joints,)`` [as the velocity].

    Returns:
        Of the velocity's shape, within ±1.
    """
    return np.where(np.equal(width, 0.0), np.sign(velocity), np.tanh(velocity / np.maximum(width, 1e-300)))


def encoder_columns(samples: JointSamples) -> Array:
    """Change of the rigid bodies' torques per unit of encoder offset, ``(m, n_joints, n_joints)`` [N·m/rad].

    The true position is the logged one and the offset.

    Taken at the nominal parameters: a first-order correction, whose own error is that of a few milliradians
    of the difference between nominal and true torques.
    """
    base = samples.q.shape[1] - samples.v.shape[1]
    columns = []
    for joint in samples.joints:
        torques = []
        for step in (_STEP, -_STEP):
            q = samples.q.copy()
            q[:, joint + base] += step
            v, a = samples.v, samples.a
            if samples.robot.mechanism is not None:
                q, v, a = samples.robot.mechanism.complete_motion(q, v, a)
            torques.append(motor_torques(samples.robot, q, v, a)[:, samples.joints])
        columns.append((torques[0] - torques[1]) / (2.0 * _STEP))
    return np.stack(columns, axis=2)


def bending_columns(samples: JointSamples) -> Array:
    """What a joint's torque sensor reads of the moments across its axis, per unit of cross-talk.

    The moments are those that the nominal model has at the joint, in two directions that stay with the link
    before it, where the sensor sits: ``(m, n_joints, 2·n_joints)`` [N·m per N·m].
    """
    model = samples.robot.model
    data = model.createData()
    pin.rnea(model, data, samples.q[0], samples.v[0], samples.a[0])
    indices = [int(np.searchsorted(model.idx_vs, v, side="right")) - 1 for v in samples.joints]
    across = np.array([_vectors_across(np.reshape(data.joints[i].S, (6, -1))[3:, 0]) for i in indices])
    moments = np.empty((len(samples.q), len(indices), 3))
    turns = np.empty((len(samples.q), len(indices), 3, 3))
    for k in range(len(samples.q)):
        pin.rnea(model, data, samples.q[k], samples.v[k], samples.a[k])
        for place, joint in enumerate(indices):
            moments[k, place] = data.f[joint].angular
            turns[k, place] = data.liMi[joint].rotation
    # From the joint's own frame into the one that it turns in.
    fixed = np.array([model.jointPlacements[i].rotation for i in indices])
    readings = np.einsum("jax,jyx,kjyz,kjz->kja", across, fixed, turns, moments, optimize=True)
    columns = np.zeros((len(samples.q), len(indices), 2 * len(indices)))
    for place in range(len(indices)):
        columns[:, place, 2 * place : 2 * place + 2] = readings[:, place]
    return columns


def nominal_torques(samples: JointSamples) -> Array:
    """Torques of the nominal bodies, ``(m, n_joints)`` [N·m or N]."""
    if samples.load is not None:
        return samples.load()
    whole = motor_torques(samples.robot, samples.q, samples.v, samples.a)
    return np.asarray(whole[:, samples.joints])


def load_friction_columns(samples: JointSamples) -> Array:
    """Friction that grows with the load, by the nominal bodies' torques, ``(m, n_joints, n_joints)``."""
    load = np.abs(nominal_torques(samples))
    return samples.own(smooth_sign(samples.v[:, samples.joints], samples.widths) * load)


def late_columns(samples: JointSamples) -> Array:
    """Rate of what the log says of each torque, at its own joint, ``(m, n_joints, n_joints)``."""
    return samples.own(np.zeros_like(samples.velocity) if samples.rate is None else samples.rate)


def _vectors_across(axis: Array) -> Array:
    """Two unit vectors across an axis, ``(2, 3)``; zeros for a joint that does not turn."""
    if not axis.any():
        return np.zeros((2, 3))
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


DRIVE_TERMS: dict[str, DriveTerm] = {
    term.name: term
    for term in (
        DriveTerm("viscous", "N·m·s/rad", ("viscous_friction",), lambda s: s.driven(s.velocity)),
        DriveTerm(
            "coulomb", "N·m", ("coulomb_friction",), lambda s: s.driven(smooth_sign(s.velocity, s.widths))
        ),
        DriveTerm(
            "offset",
            "N·m",
            ("torque_bias", "coulomb_asymmetry"),
            lambda s: s.driven(np.ones_like(s.velocity)),
        ),
        DriveTerm("armature", "kg·m²", ("armature",), lambda s: s.driven(s.acceleration)),
        # Concave growth with speed, which viscous friction alone cannot follow.
        DriveTerm(
            "root",
            "N·m·(s/rad)^½",
            (),
            lambda s: s.driven(smooth_sign(s.velocity, s.widths) * np.sqrt(np.abs(s.velocity))),
        ),
        # Friction behind a gear that two motors drive, which turns with the joint and not with its motor.
        DriveTerm("joint_viscous", "N·m·s/rad", (), lambda s: s.own(s.shared_velocity)),
        DriveTerm("joint_coulomb", "N·m", (), lambda s: s.own(smooth_sign(s.shared_velocity, s.widths))),
        # Likewise the inertia of that gear's wheels.
        DriveTerm("joint_armature", "kg·m²", (), lambda s: s.own(s.shared_acceleration)),
        # Zero of an encoder as it is calibrated, about a quarter of a degree.
        DriveTerm("encoder", "rad", ("encoder_offset",), encoder_columns, spread=5e-3),
        # Cross-talk as data sheets of torque sensors state it, some tenths of a per cent.
        DriveTerm("bending", "1", (), bending_columns, axes=(".x", ".y"), spread=3e-3),
        # What a torque is wrong by in proportion: real arms come with constants off by a tenth to two thirds.
        DriveTerm("gain", "1", (), lambda s: s.own(nominal_torques(s)), spread=0.3),
        # By how much what arrives of a torque is late.
        DriveTerm("late", "s", (), late_columns, spread=0.02),
        # Harmonic drives of cobots lose 0.05 to 0.1 N·m per N·m of load.
        DriveTerm("load_friction", "1", (), load_friction_columns, spread=0.05),
    )
}

EXTENSIONS = ("gain", "load_friction", "bending")
"""Terms that the method ``adaptive`` tries beside those of the log: what drives and sensors add to rigid bodies."""
