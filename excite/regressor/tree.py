"""The kinematic tree of a pinocchio model, read once into flat arrays that compiled loops can walk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError

FREE_FLYER, REVOLUTE, REVOLUTE_UNBOUNDED, PRISMATIC = 0, 1, 2, 3
_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
_PREFIXES = {
    "JointModelRevoluteUnboundedUnaligned": REVOLUTE_UNBOUNDED,
    "JointModelRevoluteUnaligned": REVOLUTE,
    "JointModelPrismaticUnaligned": PRISMATIC,
    "JointModelRUB": REVOLUTE_UNBOUNDED,
    "JointModelR": REVOLUTE,
    "JointModelP": PRISMATIC,
}


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """What the kernels need of a model; index 0 of every per-joint array is the universe.

    Attributes:
        names: joint names.
        kinds: ``(n_joints + 1,)``: FREE_FLYER, REVOLUTE, REVOLUTE_UNBOUNDED (q: cosine, sine), PRISMATIC.
        parents: ``(n_joints + 1,)`` index of the parent joint, always smaller than the joint's own.
        idx_q: ``(n_joints + 1,)`` first index in ``q``.
        idx_v: ``(n_joints + 1,)`` first index in ``v``.
        rotations: ``(n_joints + 1, 3, 3)`` orientation of the joint at rest in the parent's frame.
        translations: ``(n_joints + 1, 3)`` position of the joint at rest in the parent's frame [m].
        axes: ``(n_joints + 1, 3)`` unit axis in the joint's frame (zero for a free-flyer).
        aligned: ``(n_joints + 1,)`` 0, 1, 2 where the axis is x, y, z of the joint's frame, else -1.
        gravity: ``(3,)`` in the world frame [m/s²].
        phi: ``(10·n_segments,)`` inertial parameters of the model, pinocchio's order, joint frames [SI].
        nq: length of ``q``.
        nv: length of ``v``.
    """

    names: tuple[str, ...]
    kinds: NDArray[np.int64]
    parents: NDArray[np.int64]
    idx_q: NDArray[np.int64]
    idx_v: NDArray[np.int64]
    rotations: Array
    translations: Array
    axes: Array
    aligned: NDArray[np.int64]
    gravity: Array
    phi: Array
    nq: int
    nv: int

    @property
    def n_segments(self) -> int:
        """Number of moving bodies, one per joint."""
        return len(self.kinds) - 1

    @property
    def floating(self) -> bool:
        """Whether the first joint is a free-flyer."""
        return self.n_segments > 0 and self.kinds[1] == FREE_FLYER

    @property
    def structure(self) -> tuple[NDArray[Any], ...]:
        """The arrays that every kernel takes first, as one tuple, in the kernels' order."""
        placed = (self.rotations, self.translations, self.axes, self.aligned)
        return self.kinds, self.parents, self.idx_q, self.idx_v, *placed


def read_tree(model: pin.Model | KinematicTree) -> KinematicTree:
    """Read a model; a tree is handed back as it is, so that callers in a loop read only once.

    Args:
        model: joints revolute or prismatic about any axis; a free-flyer may stand at the root.

    Raises:
        RobotError: a joint of another kind (spherical, planar, mimic, composite), or a free-flyer elsewhere.
    """
    if isinstance(model, KinematicTree):
        return model
    n = model.njoints
    kinds, axes = np.zeros(n, dtype=np.int64), np.zeros((n, 3))
    for j in range(1, n):
        kinds[j], axes[j] = _kind_and_axis(model, j)
    inertias = list(model.inertias)[1:]
    return KinematicTree(
        names=tuple(model.names),
        kinds=kinds,
        parents=np.array(list(model.parents), dtype=np.int64),
        idx_q=np.array([joint.idx_q for joint in model.joints], dtype=np.int64),
        idx_v=np.array([joint.idx_v for joint in model.joints], dtype=np.int64),
        rotations=np.array([placement.rotation for placement in model.jointPlacements]),
        translations=np.array([placement.translation for placement in model.jointPlacements]),
        axes=axes,
        aligned=np.where(axes.max(axis=1, initial=0.0) == 1.0, axes.argmax(axis=1), -1),
        gravity=np.array(model.gravity.linear),
        phi=np.concatenate([inertia.toDynamicParameters() for inertia in inertias])
        if inertias
        else np.zeros(0),
        nq=model.nq,
        nv=model.nv,
    )


def _kind_and_axis(model: pin.Model, j: int) -> tuple[int, Array]:
    joint, kind = model.joints[j], model.joints[j].shortname()
    if kind == "JointModelFreeFlyer":
        if j != 1 or list(model.parents)[2:].count(0):
            raise RobotError(
                f"joint {model.names[j]!r} is a free-flyer that does not carry the whole robot",
                source=model.name,
                remedy="let one free-flyer stand at the root",
            )
        return FREE_FLYER, np.zeros(3)
    for prefix, code in _PREFIXES.items():
        suffix = kind.removeprefix(prefix)
        if kind == prefix:
            return code, _unaligned_axis(model, j)
        if kind.startswith(prefix) and suffix in _AXES:
            return code, np.array(_AXES[suffix])
    raise RobotError(
        f"joint {model.names[j]!r} is of kind {joint.shortname()}",
        source=model.name,
        remedy="use revolute and prismatic joints, or lock it",
    )


def _unaligned_axis(model: pin.Model, j: int) -> Array:
    """Axis of an unaligned joint, read from its motion subspace (the Python bindings do not show it)."""
    data = model.joints[j].createData()
    model.joints[j].calc(data, pin.neutral(model), np.zeros(model.nv))
    subspace = np.asarray(data.S).reshape(6, -1)[:, 0]
    axis = subspace[:3] if np.any(subspace[:3]) else subspace[3:]
    return np.asarray(axis / np.linalg.norm(axis))
