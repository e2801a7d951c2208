"""Friction of simulated joints at every step, as notes and bristles have it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from excite.arrays import Array
from excite.diagnosis.effects.bristle import Bristle
from excite.diagnosis.effects.note import JointStep, Note
from excite.diagnosis.simulator.rollout_drives import Past, Window


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
