"""Effects of sensor readings on a floating base: gains, biases, cross-talk, frames, delays, offsets."""

from __future__ import annotations

from itertools import permutations
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
from excite.diagnosis.floating.effect import (
    FloatingEffect,
    Parameter,
    joint_of,
    sensor_names,
    visible_joints,
)
from excite.diagnosis.floating.record import TORQUE, FloatingRecord
from excite.diagnosis.floating.state import State, drive_shapes, joint_turn
from excite.doctor.doubt import Doubt
from excite.logs.columns import WRENCH_AXES

# A sensor reads a constant that is not there.


class SensorBias(FloatingEffect):
    """Logged = true + bias, all six axes."""

    name = "sensor_bias"
    reads_as = "constant external force, inertials, base orientation; the unloaded foot tells"
    changes = "readings"

    places = staticmethod(sensor_names)
    own = Parameter.of_names(WRENCH_AXES[:3], "N", 15.0, 1.0) + Parameter.of_names(
        WRENCH_AXES[3:], "N·m", 3.0, 1.0
    )

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Subtract it."""
        return state.replace(readings=state.readings | {location: state.readings[location] - theta})


# The logged orientation of the base is off by a constant rotation.


class BaseOrientationBias(FloatingEffect):
    """True orientation = logged · exp(rotation), the rotation in the base frame.

    With foot sensors a tilt of gravity in the base frame (``base_tilt``) is the same thing.
    """

    name = "base_orientation_bias"
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    reads_as = "constant horizontal sensor bias or external force; bending forward and turning"
    changes = "q"

    own = Parameter.of_names(("rx", "ry", "rz"), "rad", 0.03, 1e-3)
    # Logged against true.
    counts = -1.0

    def locations(self, state: State) -> tuple[str, ...]:
        """The base."""
        return ("base",)

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Turn the base; its rates, logged in the base frame, turn back."""
        turn = pin.exp3(theta)
        x, y, z, w = pin.Quaternion(turn).coeffs()
        q, v, a = state.q.copy(), state.v.copy(), state.a.copy()
        # The product of quaternions from the right, x y z w.
        q[:, 3:7] = q[:, 3:7] @ np.array([[w, -z, y, -x], [z, w, -x, -y], [-y, x, w, -z], [x, y, z, w]])
        for first in (0, 3):
            v[:, first : first + 3] = v[:, first : first + 3] @ turn
            a[:, first : first + 3] = a[:, first : first + 3] @ turn
        return state.replace(q=q, v=v, a=a)


# A joint's encoder is off by a constant.


class EncoderOffset(FloatingEffect):
    """True position = logged + offset."""

    name = "encoder_offset"
    in_torques = True
    observed_by = frozenset({Doubt.POSITION, Doubt.GRAVITY})
    reads_as = "link length and inertia beyond the joint; postures that turn it against gravity"
    changes = "q"

    places = staticmethod(visible_joints)
    # The offset, true less logged; the contract counts the opposite.
    own = (Parameter("offset", "rad", 0.05, 1e-3),)
    counts = -1.0

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Turn the joint."""
        return state.move_joint(joint_of(state, location), q=theta[0])

    def residual_columns(self, state: State, location: str, theta: Array) -> Array:
        """The joint's own column: it turns, and no more."""
        turned = self.apply_to(state, location, theta) if theta.any() else state
        return -joint_turn(turned, joint_of(state, location)).by_q(state.readings)[:, :, None]


# One channel of a sensor leaks into another.


class SensorCrosstalk(FloatingEffect):
    """Logged B = true B + c · true A, at ``SENSOR.A->B``."""

    name = "sensor_crosstalk"
    reads_as = "a turn of the sensor's frame, which couples A to B and B to A"
    changes = "readings"

    def locations(self, state: State) -> tuple[str, ...]:
        """Every ordered pair of axes of every sensor."""
        return tuple(
            f"{name}.{source}->{target}"
            for name in state.readings
            for source, target in permutations(WRENCH_AXES, 2)
        )

    def parameters_at(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The coefficient."""
        source, target = location.partition(".")[2].split("->")
        kinds = {"ft": ("m", 0.03, 1e-3), "tf": ("1/m", 0.3, 1e-2)}
        return (Parameter("coefficient", *kinds.get(source[0] + target[0], ("1", 0.05, 1e-3))),)

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Subtract the leak; the source's channel is right as logged."""
        name, _, pair = location.partition(".")
        source, target = (WRENCH_AXES.index(axis) for axis in pair.split("->"))
        reading = state.readings[name].copy()
        reading[:, target] -= theta[0] * reading[:, source]
        return state.replace(readings=state.readings | {name: reading})


# A sensor sits elsewhere than declared.


class SensorFrameOffset(FloatingEffect):
    """True pose = declared · (translation, exp(rotation))."""

    name = "sensor_frame_offset"
    reads_as = "cross-talk between force axes; the last link's length for a foot sensor"
    changes = "placements"
    places = staticmethod(sensor_names)
    # Translation and rotation vector, in the declared frame.
    own = Parameter.of_names("xyz", "m", 0.01, 1e-3) + Parameter.of_names(
        ("rx", "ry", "rz"), "rad", 0.02, 1e-3
    )

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Move the sensor."""
        moved = state.placements[location] * pin.SE3(pin.exp3(theta[3:]), theta[:3])
        return state.replace(placements=state.placements | {location: moved})


# A sensor's channel reads too much or too little.


class SensorGain(FloatingEffect):
    """Logged = gain × true, on one axis or on all six."""

    name = "sensor_gain"
    observed_by = frozenset({Doubt.CLOCK, Doubt.SIZE})
    reads_as = "with free inertials a gain common to all sensors is invisible"
    changes = "readings"
    own = (Parameter("gain_error", "1", 0.1, 1e-3),)

    def locations(self, state: State) -> tuple[str, ...]:
        """Sensors, and each of their axes."""
        names = sensor_names(state)
        return names + tuple(f"{name}.{axis}" for name in names for axis in WRENCH_AXES)

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Divide by the gain."""
        name, _, axis = location.partition(".")
        reading = state.readings[name].copy()
        reading[:, WRENCH_AXES.index(axis) if axis else slice(None)] /= 1.0 + theta[0]
        return state.replace(readings=state.readings | {name: reading})

    def report_parameters(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The gain itself."""
        return {"gain": Estimate(1.0 + float(theta[0]), float(std[0]), "1")}


# The wrench channels are logged late.


class TimeDelay(FloatingEffect):
    """reading(t) = true(t − delay), all sensors."""

    name = "time_delay"
    in_torques = True
    observed_by = frozenset({Doubt.CLOCK, Doubt.DELAY})
    reads_as = "nothing else follows the wrench's rate"
    changes = "readings"
    own = (Parameter("delay", "s", 0.02, 1e-3),)

    def locations(self, state: State) -> tuple[str, ...]:
        """The wrench channels, or the torques, as a whole."""
        return ("wrench",) if state.record.robot.sensors else (TORQUE,)

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """Read ahead, trial by trial, by cubic Hermite interpolation."""
        record = state.record
        first, u = _interpolation_points(record, float(theta[0]) * record.rate_hz)
        readings = {}
        for name, logged in record.readings.items():
            rise = logged[first + 1] - logged[first]
            slope = record.readings_rate[name] / record.rate_hz
            bend = slope[first] * (1.0 - u) - slope[first + 1] * u + (2.0 * u - 1.0) * rise
            there = logged[first] + u * rise + u * (1.0 - u) * bend
            readings[name] = state.readings[name] + there - logged
        return state.replace(readings=readings)


def _interpolation_points(record: FloatingRecord, samples: float) -> tuple[NDArray[np.int64], Array]:
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
    changes = "readings"
    exact = True
    in_torques = True

    def __init_subclass__(cls) -> None:
        """Name, words and doubts are those of the law."""
        cls.name, cls.observed_by = cls.law.name, cls.law.observed_by
        cls.reads_as = f"{', '.join(cls.law.confusable_with)}; {cls.law.separating_motion}"

    def is_seen(self, record: FloatingRecord) -> bool:
        """In torques alone."""
        return not record.robot.sensors

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return tuple(state.record.robot.joint_names)

    def parameters_at(self, state: State, location: str) -> tuple[Parameter, ...]:
        """The law's own."""
        (own,), joint = self.law.linear, _torque_index(state, location)
        load, size = (
            float(np.sqrt((x**2).mean()))
            for x in (state.readings[TORQUE][:, joint], self._unit_torque(state, joint))
        )
        scale = _SHARE * load / max(size, 1e-6)
        return (Parameter(own.name, own.unit, scale, 1e-3 * scale),)

    def apply_to(self, state: State, location: str, theta: Array) -> State:
        """What the joint carries is what is read less this."""
        torque, joint = state.readings[TORQUE].copy(), _torque_index(state, location)
        torque[:, joint] = self._carried_torque(
            torque[:, joint], self._unit_torque(state, joint), float(theta[0])
        )
        return state.replace(readings={TORQUE: torque})

    def _unit_torque(self, state: State, joint: int) -> Array:
        """``(n,)`` torque of a unit [N·m]."""
        return drive_shapes(state)[self.law.name][:, joint]

    def _carried_torque(self, read: Array, shape: Array, size: float) -> Array:
        return read - size * shape


def _torque_index(state: State, joint: str) -> int:
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

    def _unit_torque(self, state: State, joint: int) -> Array:
        return state.readings[TORQUE][:, joint]

    def _carried_torque(self, read: Array, shape: Array, size: float) -> Array:
        return read / (1.0 + size)

    def report_parameters(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The gain itself."""
        return {"gain": Estimate(1.0 + float(theta[0]), float(std[0]), "1")}
