"""The kinematic tree of a pinocchio model, read once into flat arrays that compiled loops can walk."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Indices
from excite.errors import RobotError

FREE_FLYER, REVOLUTE, REVOLUTE_UNBOUNDED, PRISMATIC = 0, 1, 2, 3
_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
_LETTERS = {"R": REVOLUTE, "RUB": REVOLUTE_UNBOUNDED, "P": PRISMATIC}
# Kind and axis by pinocchio's name of a joint, and the kinds whose axis lies between those of the frame.
_KINDS = {
    "JointModelFreeFlyer": (FREE_FLYER, (0.0, 0.0, 0.0)),
    **{f"JointModel{kind}{axis}": (code, _AXES[axis]) for kind, code in _LETTERS.items() for axis in _AXES},
}
_UNALIGNED = {
    "JointModelRevoluteUnboundedUnaligned": REVOLUTE_UNBOUNDED,
    "JointModelRevoluteUnaligned": REVOLUTE,
    "JointModelPrismaticUnaligned": PRISMATIC,
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
    kinds: Indices
    parents: Indices
    idx_q: Indices
    idx_v: Indices
    rotations: Array
    translations: Array
    axes: Array
    aligned: Indices
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
    # Vectors of pinocchio end with a C++ exception, which takes as long as to read twenty numbers: they are counted.
    joints, names, parents, placements, inertias = (
        list(islice(vector, model.njoints))
        for vector in (model.joints, model.names, model.parents, model.jointPlacements, model.inertias)
    )
    told = [_kind_and_axis(model, joint, name) for joint, name in zip(joints[1:], names[1:], strict=True)]
    kinds = np.array([FREE_FLYER, *(kind for kind, _ in told)], dtype=np.int64)
    axes = np.array([(0.0, 0.0, 0.0), *(axis for _, axis in told)])
    free = [j for j, (kind, _) in enumerate(told, start=1) if kind == FREE_FLYER]
    if free and (free != [1] or not all(parents[2:])):
        raise RobotError(
            f"joint {names[free[-1]]!r} is a free-flyer that does not carry the whole robot",
            source=model.name,
            remedy="let one free-flyer stand at the root",
        )
    return KinematicTree(
        names=tuple(names),
        kinds=kinds,
        parents=np.array(parents, dtype=np.int64),
        idx_q=np.array([joint.idx_q for joint in joints], dtype=np.int64),
        idx_v=np.array([joint.idx_v for joint in joints], dtype=np.int64),
        rotations=np.array([placement.rotation for placement in placements]),
        translations=np.array([placement.translation for placement in placements]),
        axes=axes,
        aligned=np.where(axes.max(axis=1, initial=0.0) == 1.0, axes.argmax(axis=1), -1),
        gravity=np.array(model.gravity.linear),
        phi=np.array([inertia.toDynamicParameters() for inertia in inertias[1:]]).reshape(-1),
        nq=model.nq,
        nv=model.nv,
    )


def _kind_and_axis(
    model: pin.Model, joint: pin.JointModel, name: str
) -> tuple[int, Array | tuple[float, ...]]:
    kind = joint.shortname()
    if kind in _KINDS:
        return _KINDS[kind]
    if kind in _UNALIGNED:
        return _UNALIGNED[kind], _unaligned_axis(model, joint)
    raise RobotError(
        f"joint {name!r} is of kind {kind}",
        source=model.name,
        remedy="use revolute and prismatic joints, or lock it",
    )


def _unaligned_axis(model: pin.Model, joint: pin.JointModel) -> Array:
    """Axis of an unaligned joint, read from its motion subspace (the Python bindings do not show it)."""
    data = joint.createData()
    joint.calc(data, pin.neutral(model), np.zeros(model.nv))
    subspace = np.asarray(data.S).reshape(6, -1)[:, 0]
    axis = subspace[:3] if np.any(subspace[:3]) else subspace[3:]
    return np.asarray(axis / np.linalg.norm(axis))
