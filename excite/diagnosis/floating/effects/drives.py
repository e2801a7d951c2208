"""Effects of drives on a robot that stands without wrench sensors: what a torque reads beyond what its joint carries.

Laws, names and what they look like are those of arms.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.friction import CoulombFriction, ViscousFriction
from excite.diagnosis.effects.gears.gear_effect import Armature
from excite.diagnosis.effects.readings import TorqueBias, TorqueGain
from excite.diagnosis.floating.effects.effect import Beyond, FloatingEffect, Parameter, Reads, joint_of
from excite.diagnosis.floating.equations.record import TORQUE
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.equations.torques import drive_shapes

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
