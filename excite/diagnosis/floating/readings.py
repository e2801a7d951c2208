"""Effects of sensor readings on a floating base: gains, biases, cross-talk, frames, delays, offsets."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.friction import CoulombFriction, ViscousFriction
from excite.diagnosis.effects.gears.gear_effect import Armature
from excite.diagnosis.effects.readings import TorqueBias, TorqueGain
from excite.diagnosis.floating.effect import Beyond, FloatingEffect, Parameter, Part, Reads, joint_of, joints
from excite.diagnosis.floating.record import TORQUE, FloatingRecord
from excite.diagnosis.floating.state import State, drive_shapes, joint_turn
from excite.doctor.doubt import Doubt
from excite.logs.columns import WRENCH_AXES

# A sensor reads a constant that is not there.


class SensorBias(FloatingEffect):
    """Logged = true + bias, all six axes."""

    name: ClassVar[str] = "sensor_bias"
    reads_as: ClassVar[str] = "constant external force, inertials, base orientation; the unloaded foot tells"
    confusable_with: ClassVar[tuple[str, ...]] = ("external_force", "link_inertia", "base_orientation_bias")
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors."""
        return tuple(state.readings)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The bias of each axis."""
        return tuple(
            Parameter(axis, "N" if axis[0] == "f" else "N·m", 15.0 if axis[0] == "f" else 3.0, 1.0)
            for axis in WRENCH_AXES
        )

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Subtract it."""
        return state.replace(readings=state.readings | {location: state.readings[location] - theta})


# The logged orientation of the base is off by a constant rotation.


class BaseOrientationBias(FloatingEffect):
    """True orientation = logged · exp(rotation), the rotation in the base frame.

    With foot sensors a tilt of gravity in the base frame (``base_tilt``) is the same thing.
    """

    name: ClassVar[str] = "base_orientation_bias"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    reads_as: ClassVar[str] = "constant horizontal sensor bias or external force; bending forward and turning"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_bias", "external_force")
    says = Beyond.MOTION

    def locations(self, state: State) -> tuple[str, ...]:
        """The base."""
        return ("base",)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Rotation vector."""
        return tuple(Parameter(axis, "rad", 0.03, 1e-3) for axis in ("rx", "ry", "rz"))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the base; its rates, logged in the base frame, turn back."""
        turn = pin.exp3(theta)
        x, y, z, w = pin.Quaternion(turn).coeffs()
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        a0, a1, a2, a3 = q[:, 3].copy(), q[:, 4].copy(), q[:, 5].copy(), q[:, 6].copy()
        q[:, 3] = a3 * x + a0 * w + a1 * z - a2 * y
        q[:, 4] = a3 * y - a0 * z + a1 * w + a2 * x
        q[:, 5] = a3 * z + a0 * y - a1 * x + a2 * w
        q[:, 6] = a3 * w - a0 * x - a1 * y - a2 * z
        for first in (0, 3):
            v[:, first : first + 3] = v[:, first : first + 3] @ turn
            a[:, first : first + 3] = a[:, first : first + 3] @ turn
        return state.replace(q=q, v=v, a=a)

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Logged against true."""
        return super().report(state, location, -theta, std)


# A joint's encoder is off by a constant.


class EncoderOffset(FloatingEffect):
    """True position = logged + offset."""

    name: ClassVar[str] = "encoder_offset"
    seen_by = frozenset(Reads)
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    reads_as: ClassVar[str] = (
        "link length and inertia beyond the joint; postures that turn it against gravity"
    )
    confusable_with: ClassVar[tuple[str, ...]] = ("link_length_error", "link_inertia")
    says = Beyond.MOTION

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return joints(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The offset, true less logged."""
        return (Parameter("offset", "rad", 0.05, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Turn the joint."""
        q = state.q.copy()
        q[:, state.tree.idx_q[joint_of(state, location)]] += theta[0]
        return state.replace(q=q)

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's own column: it turns, and no more."""
        turned = self.apply(state, location, theta) if theta.any() else state
        return -joint_turn(turned, joint_of(state, location)).by_q(state.readings)[:, :, None]

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """Logged less true, as the contract counts it."""
        return super().report(state, location, -theta, std)


# One channel of a sensor leaks into another.


class SensorCrosstalk(FloatingEffect):
    """Logged B = true B + c · true A, at ``SENSOR.A->B``."""

    name: ClassVar[str] = "sensor_crosstalk"
    reads_as: ClassVar[str] = "a turn of the sensor's frame, which couples A to B and B to A"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_frame_offset",)
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """Every ordered pair of axes of every sensor."""
        return tuple(
            f"{name}.{source}->{target}"
            for name in state.readings
            for source in WRENCH_AXES
            for target in WRENCH_AXES
            if source != target
        )

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The coefficient."""
        source, target = location.partition(".")[2].split("->")
        if source[0] == target[0]:
            return (Parameter("coefficient", "1", 0.05, 1e-3),)
        return (
            Parameter("coefficient", "m", 0.03, 1e-3)
            if source[0] == "f"
            else Parameter("coefficient", "1/m", 0.3, 1e-2),
        )

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Subtract the leak; the source's channel is right as logged."""
        name, _, pair = location.partition(".")
        source, target = (WRENCH_AXES.index(axis) for axis in pair.split("->"))
        reading = state.readings[name].copy()
        reading[:, target] -= theta[0] * reading[:, source]
        return state.replace(readings=state.readings | {name: reading})


# A sensor sits elsewhere than declared.


class SensorFrameOffset(FloatingEffect):
    """True pose = declared · (translation, exp(rotation))."""

    name: ClassVar[str] = "sensor_frame_offset"
    reads_as: ClassVar[str] = "cross-talk between force axes; the last link's length for a foot sensor"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_crosstalk", "link_length_error")
    says = Part.SENSORS
    mujoco: ClassVar[str] = "pos and quat of the site that is the sensor"

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors."""
        return tuple(state.readings)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Translation and rotation vector, in the declared frame."""
        shift = tuple(Parameter(axis, "m", 0.01, 1e-3) for axis in "xyz")
        return shift + tuple(Parameter(axis, "rad", 0.02, 1e-3) for axis in ("rx", "ry", "rz"))

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Move the sensor."""
        moved = state.placements[location] * _offset(theta)
        return state.replace(placements=state.placements | {location: moved})

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """What it makes of the reading in the declared frame, by finite differences; the lever is the same."""
        here, turned = _offset(theta).toDualActionMatrix(), []
        for i, parameter in enumerate(self.parameters(state, location)):
            ahead = theta.copy()
            ahead[i] += parameter.step
            turned.append((_offset(ahead).toDualActionMatrix() - here) / parameter.step)
        changes = np.einsum("kij,nj->nik", turned, state.readings[location])
        return -state.levers[location] @ changes


def _offset(theta: Array) -> pin.SE3:
    return pin.SE3(pin.exp3(theta[3:]), theta[:3])


# A sensor's channel reads too much or too little.


class SensorGain(FloatingEffect):
    """Logged = gain × true, on one axis or on all six."""

    name: ClassVar[str] = "sensor_gain"
    told_by = frozenset({Doubt.CLOCK, Doubt.SIZE})
    reads_as: ClassVar[str] = "with free inertials a gain common to all sensors is invisible"
    confusable_with: ClassVar[tuple[str, ...]] = ("link_inertia",)
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors, and each of their axes."""
        names = tuple(state.readings)
        return names + tuple(f"{name}.{axis}" for name in names for axis in WRENCH_AXES)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Gain less one."""
        return (Parameter("gain_error", "1", 0.1, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Divide by the gain."""
        name, _, axis = location.partition(".")
        reading = state.readings[name].copy()
        reading[:, WRENCH_AXES.index(axis) if axis else slice(None)] /= 1.0 + theta[0]
        return state.replace(readings=state.readings | {name: reading})

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The gain itself."""
        return {"gain": Estimate(1.0 + float(theta[0]), float(std[0]), "1")}


# The wrench channels are logged late.


class TimeDelay(FloatingEffect):
    """reading(t) = true(t − delay), all sensors."""

    name: ClassVar[str] = "time_delay"
    seen_by = frozenset(Reads)
    told_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    reads_as: ClassVar[str] = "nothing else follows the wrench's rate"
    says = Beyond.READINGS

    def locations(self, state: State) -> tuple[str, ...]:
        """The wrench channels, or the torques, as a whole."""
        return ("wrench",) if state.record.robot.sensors else (TORQUE,)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The delay."""
        return (Parameter("delay", "s", 0.02, 1e-3),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Read ahead, trial by trial, by cubic Hermite interpolation."""
        record = state.record
        first, u = _ahead(record, float(theta[0]) * record.rate_hz)
        readings = {}
        for name, logged in record.readings.items():
            rise = logged[first + 1] - logged[first]
            slope = record.readings_rate[name] / record.rate_hz
            bend = slope[first] * (1.0 - u) - slope[first + 1] * u + (2.0 * u - 1.0) * rise
            there = logged[first] + u * rise + u * (1.0 - u) * bend
            readings[name] = state.readings[name] + there - logged
        return state.replace(readings=readings)


def _ahead(record: FloatingRecord, samples: float) -> tuple[NDArray[np.int64], Array]:
    """For each sample, the one before where it is read, ``(n,)``, and how far after that, ``(n, 1)`` from 0 to 1.

    Beyond a trial's ends nothing is known: there the ends are read.
    """
    first, u = np.empty(record.n_samples, dtype=int), np.empty(record.n_samples)
    for span in record.spans:
        n = span.stop - span.start
        place = np.clip(np.arange(n) + samples, 0, n - 1)
        before = np.minimum(place.astype(int), n - 2)
        first[span], u[span] = span.start + before, place - before
    return first, u[:, None]


# Effects of drives on a robot that stands without wrench sensors: what a torque reads beyond what its joint
# carries.
#
# Laws, names and what they look like are those of arms.

# What an effect is expected to take, in units of its torque's root mean square.
_SHARE = 0.2


class DriveTerm(FloatingEffect):
    """``τ_logged = τ + β s``, s the shape of the arm's effect of that name.

    Attributes:
        law: the arm's effect.
    """

    law: ClassVar[Effect]
    says = Beyond.READINGS
    exact = True
    seen_by = frozenset({Reads.TORQUES})

    def __init_subclass__(cls) -> None:
        """Name, words and doubts are those of the law."""
        cls.name, cls.confusable_with, cls.told_by = cls.law.name, cls.law.confusable_with, cls.law.told_by
        cls.reads_as = f"{', '.join(cls.law.confusable_with)}; {cls.law.separating_motion}"

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return tuple(state.record.robot.joint_names)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The law's own."""
        (own,), joint = self.law.linear, _index(state, location)
        load, size = (
            float(np.sqrt((x**2).mean()))
            for x in (state.readings[TORQUE][:, joint], self._shape(state, joint))
        )
        scale = _SHARE * load / max(size, 1e-6)
        return (Parameter(own.name, own.unit, scale, 1e-3 * scale),)

    def apply(self, state: State, location: str, theta: Array) -> State:
        """What the joint carries is what is read less this."""
        torque, joint = state.readings[TORQUE].copy(), _index(state, location)
        torque[:, joint] = self._carried(torque[:, joint], self._shape(state, joint), float(theta[0]))
        return state.replace(readings={TORQUE: torque})

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's torque in the rows."""
        joint, step = _index(state, location), self.parameters(state, location)[0].step
        read, shape = state.readings[TORQUE][:, joint], self._shape(state, joint)
        here, ahead = (self._carried(read, shape, float(theta[0]) + by) for by in (0.0, step))
        return np.asarray((state.levers[TORQUE][:, :, joint] * ((here - ahead) / step)[:, None])[:, :, None])

    def _shape(self, state: State, joint: int) -> Array:
        """``(n,)`` torque of a unit [N·m]."""
        return drive_shapes(state)[self.law.name][:, joint]

    def _carried(self, read: Array, shape: Array, size: float) -> Array:
        return read - size * shape


def _index(state: State, joint: str) -> int:
    """A joint's place among the torques."""
    return int(state.tree.idx_v[joint_of(state, joint)]) - 6


class DriveViscous(DriveTerm):
    """``τ_logged = τ + f_v v``."""

    law = ViscousFriction()


class DriveCoulomb(DriveTerm):
    """``τ_logged = τ + f_c sign(v)``."""

    law = CoulombFriction()


class DriveArmature(DriveTerm):
    """``τ_logged = τ + I_a a``."""

    law = Armature()


class DriveBias(DriveTerm):
    """``τ_logged = τ + b``."""

    law = TorqueBias()


class DriveGain(DriveTerm):
    """``τ_logged = g τ``: a drive that is weaker than its log says has a gain above one."""

    law = TorqueGain()

    def _shape(self, state: State, joint: int) -> Array:
        return state.readings[TORQUE][:, joint]

    def _carried(self, read: Array, shape: Array, size: float) -> Array:
        return read / (1.0 + size)

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The gain itself."""
        return {"gain": Estimate(1.0 + float(theta[0]), float(std[0]), "1")}
