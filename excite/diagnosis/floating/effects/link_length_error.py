"""A joint does not sit where the model says."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from excite.arrays import Array
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.floating.effects.effect import FloatingEffect, Parameter, joint_of, joints
from excite.diagnosis.floating.effects.form import Part
from excite.diagnosis.floating.equations.moved_branch import moved_branch
from excite.diagnosis.floating.equations.state import State
from excite.doctor.doubt import Doubt


class LinkLengthError(FloatingEffect):
    """True placement of the joint = the model's + error, in the parent's frame."""

    name: ClassVar[str] = "link_length_error"
    told_by = frozenset({Doubt.POSITION, Doubt.GRAVITY, Doubt.CLOCK, Doubt.SIZE})
    reads_as: ClassVar[str] = "sensor frame at the leg's end; inertia of what the joint carries"
    confusable_with: ClassVar[tuple[str, ...]] = ("sensor_frame_offset", "link_inertia")
    says = Part.LENGTHS
    mujoco: ClassVar[str] = "body pos"

    def locations(self, state: State) -> tuple[str, ...]:
        """Joints."""
        return joints(state)

    def parameters(self, state: State, location: str) -> tuple[Parameter, ...]:
        """Displacement of the joint's origin."""
        return tuple(Parameter(axis, "m", 0.015, 1e-3) for axis in "xyz")

    def apply(self, state: State, location: str, theta: Array) -> State:
        """Move the joint."""
        translations = state.tree.translations.copy()
        translations[joint_of(state, location)] += theta
        return state.replace(tree=replace(state.tree, translations=translations))

    def columns(self, state: State, location: str, theta: Array) -> Array:
        """What the joint carries moves as one, turning with the parent: its mass, its moment, its sensors."""
        moved = self.apply(state, location, theta) if theta.any() else state
        joint = joint_of(moved, location)
        return -moved_branch(moved, joint)

    def report(self, state: State, location: str, theta: Array, std: Array) -> dict[str, Estimate]:
        """The model's placement less the true one."""
        return super().report(state, location, -theta, std)
