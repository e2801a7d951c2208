"""Closed loops of a mechanism: a tree of joints whose links meet again, and which of its joints no motor drives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import pinocchio as pin
from pydantic import Field

from excite.arrays import Array
from excite.robot.per_joint import Block, Name, Source
from excite.robot.quantities import Rotation3, Vector3


class LoopEnd(Block):
    """Where a loop is closed on one of its two links: a point, and axes where the links keep their orientation."""

    link: Name
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)


class LoopBlock(Block):
    """Two links that meet beside their tree: in a point, as at a rod's ball, or rigidly.

    ``passive`` names joints of the loop that no motor drives and nobody logs; they follow from the others.
    """

    name: Name
    kind: Literal["point", "weld"] = "point"
    ends: Annotated[tuple[LoopEnd, ...], Field(min_length=2, max_length=2)]
    passive: tuple[Name, ...] = ()
    source: Source


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop cut open: two frames of a tree that meet.

    Attributes:
        name: its name.
        joints: model joints that carry the frames, 0 for the world.
        placements: the frames in those joints' frames.
        rigid: whether the frames' axes meet too; else their origins alone.
    """

    name: str
    joints: tuple[int, int]
    placements: tuple[pin.SE3, pin.SE3]
    rigid: bool = False

    @property
    def size(self) -> int:
        """Number of equations, of which in a plane some say the same."""
        return 6 if self.rigid else 3

    def gap(self, data: pin.Data) -> Array:
        """How far the frames are apart in the world, ``(size,)`` [m, rad]; placements have to be in ``data``."""
        first, second = (data.oMi[j] * m for j, m in zip(self.joints, self.placements, strict=True))
        gap = second.translation - first.translation
        if not self.rigid:
            return np.asarray(gap)
        return np.concatenate([gap, first.rotation @ pin.log3(first.rotation.T @ second.rotation)])

    def jacobian(self, model: pin.Model, data: pin.Data) -> Array:
        """Derivative of :meth:`gap` by velocities, ``(size, nv)``; joint Jacobians have to be in ``data``."""
        first, second = (self._end_jacobian(model, data, end) for end in (0, 1))
        return np.asarray(second - first)[: self.size]

    def drift(self, data: pin.Data) -> Array:
        """Second derivative of :meth:`gap` by time without acceleration, ``(size,)``.

        Velocities, and accelerations for accelerations of zero, have to be in ``data``.
        """
        first, second = (self._end_acceleration(data, end) for end in (0, 1))
        return np.asarray(second - first)[: self.size]

    def _end_jacobian(self, model: pin.Model, data: pin.Data, end: int) -> Array:
        joint, placement = self.joints[end], self.placements[end]
        if not joint:
            return np.zeros((6, model.nv))
        local = placement.actionInverse @ pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
        turned = data.oMi[joint].rotation @ placement.rotation
        return np.vstack([turned @ local[:3], turned @ local[3:]])

    def _end_acceleration(self, data: pin.Data, end: int) -> Array:
        joint, placement = self.joints[end], self.placements[end]
        velocity, acceleration = placement.actInv(data.v[joint]), placement.actInv(data.a[joint])
        linear = acceleration.linear + np.cross(velocity.angular, velocity.linear)
        turned = data.oMi[joint].rotation @ placement.rotation
        return np.concatenate([turned @ linear, turned @ acceleration.angular])
