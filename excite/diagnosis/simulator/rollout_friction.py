"""Friction of simulated joints at every step, as notes and bristles have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.note import JointStep, Note
from excite.diagnosis.simulator.rollout_drives import Window


@dataclass(eq=False)
class _Part:
    """A note of a joint's friction.

    Attributes:
        joint: index of the joint.
        note: the note.
        bristle: bristles of its own; None where it has none, or where they hold all of the joint's dry friction.
        held: what these hold at the coming step [N·m].
    """

    joint: int
    note: Note
    bristle: Bristle | None = None
    held: float = 0.0


class JointFriction:
    """Friction levels of all joints at every step, and the bristles of those that have some.

    Attributes:
        bristles: by joint, those of all joints.
        acts: whether anything changes from step to step.
    """

    def __init__(self, notes: Sequence[tuple[int, Note]], steps: Sequence[JointStep]):
        """Pick what is friction from a model's notes.

        Args:
            notes: all notes, each with the index of its joint.
            steps: the joints; which of them bend is noted there.
        """
        self._steps = steps
        self._parts = [_Part(j, note) for j, note in notes if note.rubs]
        # Bristles that hold all of a joint's dry friction.
        self._whole: dict[int, Bristle] = {}
        for part in self._parts:
            bristle = part.note.bristle()
            if bristle is not None and part.note.takes_all:
                self._whole[part.joint] = bristle
            else:
                part.bristle = bristle
        for part in self._parts:
            if part.bristle is None and part.note.static is not None and part.joint in self._whole:
                self._whole[part.joint].static = part.note.static
        for j in self._whole:
            steps[j].bends = True
        self._own = [(part, part.bristle) for part in self._parts if part.bristle is not None]
        self.bristles = (*self._whole.items(), *((part.joint, bristle) for part, bristle in self._own))
        self.acts = bool(self._parts)

    def start(self, window: Window) -> None:
        """Begin a window, bristles bent as the record before it did."""
        past = window.past
        for j, bristle in self.bristles:
            if past is None:
                bristle.start(np.zeros(0), 0.0)
            else:
                bristle.start(np.ascontiguousarray(past.v[:, j]), float(past.time[1] - past.time[0]))

    def levels(self, level: Array) -> tuple[Array, Array]:
        """Coulomb levels and added viscous friction of all joints, ``(n_joints,)`` each, from constant levels."""
        level, viscous = level.copy(), np.zeros(len(level))
        for part in self._parts:
            j = part.joint
            if part.bristle is not None:
                part.held = part.note.held(float(level[j]))
            level[j], more = part.note.friction(level[j], self._steps[j])
            viscous[j] += more
        return np.maximum(level, 0.0), viscous

    def bent(self, level: Array, v: Array, step: float) -> tuple[Array, Array]:
        """Torque and damping of all bristles; levels that they take over are taken off ``level`` in place."""
        force, damping = np.zeros(len(level)), np.zeros(len(level))
        if not self.bristles:
            return force, damping
        parts = [(j, b, level[j]) for j, b in self._whole.items()]
        for j in self._whole:
            level[j] = 0.0
        parts += [(part.joint, bristle, part.held) for part, bristle in self._own]
        speeds = v.tolist()
        for j, bristle, size in parts:
            f, d = bristle.force(max(float(size), 0.0), speeds[j], step)
            force[j] += f
            damping[j] += d
        return force, damping

    def move(self, v: Array, step: float) -> None:
        """Bend all bristles by the step that was made."""
        speeds = v.tolist()
        for j, bristle in self.bristles:
            bristle.move(speeds[j], step)
