"""Sets of inertial parameters, and the most that a linear form of the parameters rises over a set.

Torques and contact wrenches are linear in the inertial parameters ``φ``: ``y·φ`` with a row ``y`` of a regressor
(Atkeson, An, Hollerbach 1986). Over a set ``Φ`` about the model's own parameters ``φ₀`` the worst case of a row is
``y·φ₀ + h(y)``, where ``h(y) = max {y·(φ − φ₀): φ ∈ Φ}`` is the set's support function (Rockafellar 1970, section 13).
Here ``Φ`` is a sum of up to three parts, and ``h`` the sum of theirs:

* bodies, each independent of the others: mass ``m ∈ m₀(1 ± α)``, centre of mass ``c ∈ c₀ ± r`` along each axis of the
  joint's frame, and moments of inertia ``J_k ∈ J₀_k(1 ± β)`` about the principal axes through the nominal centre
  ``c₀``. A row is multilinear in these, so that its extremes are at corners of the box. With ``y_m``, ``y_e``, ``y_J``
  the row's entries for mass, first moment about ``c₀`` and principal moments, ``s = m₀ r Σ|y_e|`` is what the centre
  adds at the nominal mass, and ``h = s + |α (m₀ y_m + s)| + β Σ J₀_k |y_J,k|``;
* a load of mass ``0 … p`` at a point of a link: ``h = max(0, p y·b)``, ``b`` the parameters of one kilogram there;
* an ellipsoid, as an identification leaves it: ``(φ − φ₁)ᵀ Σ⁻¹ (φ − φ₁) ≤ k²`` gives
  ``h = y·(φ₁ − φ₀) + k √(yᵀ Σ y)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from excite.arrays import Array, Moved
from excite.errors import RobotError, raised_as
from excite.formats.arrays import read_npz
from excite.regressor.kernels import base_link_regressor, block_of, joint_torque_regressor
from excite.regressor.parameter_loops import (
    OF_BODY,
    least_ratio,
    rises,
    rises_of_forms,
    torque_coordinates,
    wrench_coordinates,
)
from excite.regressor.tree import read_tree
from excite.robot.description import UncertaintyBlock
from excite.robot.links import link_placement
from excite.robot.robot import Robot

# Share of the weight that rounding leaves of a linear form at its root.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class ParameterSet:
    """A set of inertial parameters about those of a model.

    Rows are taken to the set's own coordinates once, which is linear; all else is asked of these. They are seven of
    each body, one of each load and, where there is an ellipsoid, its shift and its root's.

    Attributes:
        bodies: ``(n_segments, 10, 7)`` from a body's parameters to its mass (``m₀``), first moments about its nominal
            centre (``m₀ r``) and principal moments (``β J₀``).
        mass: ``α``, share of its mass by which each body may be heavier or lighter.
        loads: ``(n_loads, 10)`` parameters of each load at its largest, in the frame of the joint that carries it.
        carriers: ``(n_loads,)`` index of the segment that does.
        ellipsoid: ``(10·n_segments, 1 + rank)`` its centre from the model's parameters, and ``k`` times a root of its
            covariance; no columns where there is none.
    """

    bodies: Array
    mass: float
    loads: Array
    carriers: NDArray[np.intp]
    ellipsoid: Array

    @property
    def n_coordinates(self) -> int:
        """Number of coordinates."""
        return int(OF_BODY * len(self.bodies) + len(self.loads) + self.ellipsoid.shape[1])

    def coordinates(self, rows: Array) -> Array:
        """Rows ``(…, 10·n_segments)`` of a regressor in the set's coordinates, ``(…, n_coordinates)``."""
        by_body = rows.reshape(*rows.shape[:-1], len(self.bodies), 10)
        of_bodies = np.einsum("...bc,bck->...bk", by_body, self.bodies)
        of_loads = np.einsum("...lc,lc->...l", by_body[..., self.carriers, :], self.loads)
        of_bodies = of_bodies.reshape(*rows.shape[:-1], -1)
        return np.concatenate([of_bodies, of_loads, rows @ self.ellipsoid], axis=-1)

    def rise(self, at: Array, sign: float = 1.0) -> Array:
        """The most that rows rise above the model's value, ``(…,)``, from their coordinates ``(…, n_coordinates)``.

        With ``sign`` -1 the most that they fall. Never negative: the model itself counts among the set.
        """
        out = np.empty(at.shape[:-1])
        flat = np.ascontiguousarray(at.reshape(-1, at.shape[-1]))
        rises(flat, sign, len(self.bodies), self.mass, len(self.loads), out.reshape(-1))
        return out

    def rise_of_forms(self, forms: Array, samples: NDArray[np.intp], of_wrench: Array) -> Array:
        """The same, ``(n,)``, of linear forms ``(n, 6)`` of wrenches ``(n_samples, 6, n_coordinates)`` at samples."""
        out, scratch = np.empty(len(forms)), np.empty((1, self.n_coordinates))
        rises_of_forms(forms, samples, of_wrench, len(self.bodies), self.mass, len(self.loads), scratch, out)
        return out

    def least_ratio(self, planes: Array, nominal: Array, of_wrench: Array, best: float) -> tuple[float, int]:
        """The least ``−plane·w/f_z`` over samples, planes ``(n or 1, n_planes, 6)`` and the set, and its sample.

        ``nominal (n, 6)`` are the model's wrenches; planes of NaN are none. The sample is -1 where no ratio is below
        ``best``, and -2 where ``f_z`` is not positive all over the set.
        """
        ratio, sample = least_ratio(
            planes, nominal, of_wrench, len(self.bodies), self.mass, len(self.loads), best, _ROUNDING
        )
        return float(ratio), int(sample)

    def farthest(self, at: Array) -> Array:
        """The members at which rows rise most, as what they have beyond the model, ``(…, 10·n_segments)``.

        Args:
            at: the rows in coordinates ``(…, n_coordinates)``.
        """
        part = self._parts(at)
        sign = np.sign(part.bodies[..., 1:])
        heavier = self.mass * np.sign(part.bodies[..., 0] + np.abs(part.bodies[..., 1:4]).sum(axis=-1))
        moved = sign[..., :3] * (1.0 + heavier[..., None])
        shares = np.concatenate([heavier[..., None], moved, sign[..., 3:]], axis=-1)
        found = np.einsum("bck,...bk->...bc", self.bodies, shares)
        for carrier, load, pull in zip(
            self.carriers, self.loads, np.moveaxis(part.loads, -1, 0), strict=True
        ):
            found[..., carrier, :] += np.where(pull > 0.0, 1.0, 0.0)[..., None] * load
        found = found.reshape(*at.shape[:-1], -1)
        if self.ellipsoid.shape[1]:
            length = np.linalg.norm(part.root, axis=-1)
            along = part.root / np.where(length > 0.0, length, 1.0)[..., None]
            beyond = self.ellipsoid[:, 0] + along @ self.ellipsoid[:, 1:].T
            found += np.where(part.shift + length > 0.0, 1.0, 0.0)[..., None] * beyond
        return np.asarray(found)

    def _parts(self, at: Array) -> _Parts:
        n, n_loads = OF_BODY * len(self.bodies), len(self.loads)
        last = at[..., n + n_loads :] if self.ellipsoid.shape[1] else np.zeros((*at.shape[:-1], 1))
        return _Parts(
            at[..., :n].reshape(*at.shape[:-1], len(self.bodies), OF_BODY),
            at[..., n : n + n_loads],
            last[..., 0],
            last[..., 1:],
        )


class _Parts(NamedTuple):
    """Coordinates ``(…, n_coordinates)`` by part of the set."""

    bodies: Array
    loads: Array
    shift: Array
    root: Array


class WrenchRows(NamedTuple):
    """Rows of the whole robot's wrench in a set's coordinates ``(n, 6, k)``, and screws ``(n, n_joints + 1, 6)``."""

    of_wrench: Array
    screws: Array


class RowsOfSet:
    """Rows of a robot's wrench and torques in the coordinates of a set of parameters."""

    def __init__(self, robot: Robot, parameters: ParameterSet) -> None:
        self._robot, self._set = robot, parameters
        self._tree = read_tree(robot.model)
        n = len(self._tree.parents)
        self._beyond = np.eye(n, dtype=bool)
        for j in range(1, n):
            self._beyond[:, j] |= self._beyond[:, self._tree.parents[j]]
        self._own = np.eye(robot.model.nv)[None, robot.n_base_v :]

    def of_wrench(self, moved: Moved) -> WrenchRows:
        """Rows of the wrench about the world's origin, in the world's axes."""
        tree, parameters = self._tree, self._set
        q, v, a = (np.ascontiguousarray(part, dtype=float) for part in moved)
        found = np.zeros((len(q), 6, parameters.n_coordinates))
        screws = np.zeros((len(q), len(tree.parents), 6))
        wrench_coordinates(
            tree.structure, tree.gravity, q, v, a, *block_of(tree), np.empty((1, 6, 10)), parameters.bodies,
            parameters.loads, parameters.carriers, screws, found,
        )  # fmt: skip
        n_last = parameters.ellipsoid.shape[1]
        if n_last:
            rows = base_link_regressor(tree, q, v, a)
            if self._robot.floating:
                turn = scipy.spatial.transform.Rotation.from_quat(q[:, 3:7]).as_matrix()
                force, moment = turn @ rows[:, :3], turn @ rows[:, 3:]
                rows = np.concatenate([force, moment + np.cross(q[:, :3, None], force, axis=1)], axis=1)
            found[..., -n_last:] = rows @ parameters.ellipsoid
        return WrenchRows(found, screws)

    def of_torques(self, moved: Moved, rows: WrenchRows, shares: Array | None) -> Array:
        """Rows of the motors' torques, ``(n, n_joints, n_coordinates)``, from those of the wrench.

        ``shares (n, n_feet, 6, 6)`` are from the wrench to that of each foot; None of a robot that no foot carries.
        """
        robot, parameters, n = self._robot, self._set, len(moved.q)
        taken = np.zeros_like(rows.screws)
        if shares is not None:
            for i, foot in enumerate(robot.feet):
                legs = list(robot.model.supports[foot.joint])[2:]
                taken[:, legs] += rows.screws[:, legs] @ shares[:, i]
        maps = self._own
        if robot.mechanism is not None:
            maps = np.zeros((n, robot.model.nv, robot.model.nv))
            maps[:, robot.mechanism.driven] = robot.mechanism.motion_maps(moved.q).transpose(0, 2, 1)
            maps = np.ascontiguousarray(maps[:, robot.n_base_v :])
        out = np.zeros((n, robot.n_joints, parameters.n_coordinates))
        torque_coordinates(
            self._beyond, self._tree.idx_v, rows.screws, taken, maps, rows.of_wrench, parameters.carriers,
            len(parameters.bodies), out,
        )  # fmt: skip
        n_last = parameters.ellipsoid.shape[1]
        if n_last:
            last = joint_torque_regressor(self._tree, *moved) @ parameters.ellipsoid
            for j in range(1, len(self._tree.parents)):
                if robot.model.nvs[j] == 1:
                    last[:, self._tree.idx_v[j]] -= np.einsum(
                        "ni,nik->nk", taken[:, j], rows.of_wrench[..., -n_last:]
                    )
            out[..., -n_last:] = np.einsum("nij,njk->nik", np.broadcast_to(maps, (n, *maps.shape[1:])), last)
        return out


def parameter_set(
    model: pin.Model,
    *,
    mass: float = 0.0,
    com: float = 0.0,
    inertia: float = 0.0,
    loads: Sequence[Load] = (),
    ellipsoid: Ellipsoid | None = None,
) -> ParameterSet:
    """The set about a model's parameters.

    Args:
        model: pinocchio model.
        mass: by which share of its mass each body may be heavier or lighter.
        com: how far its centre of mass may be off along each axis of its joint's frame [m].
        inertia: by which share each principal moment, about the nominal centre, may be larger or smaller.
        loads: what may hang at it, or not.
        ellipsoid: added to these.

    Returns:
        The set.
    """
    inertias = list(model.inertias)[1:]
    nominal = np.concatenate([body.toDynamicParameters() for body in inertias])
    hung = [load.mass * _point_mass(np.asarray(load.point, dtype=float)) for load in loads]
    return ParameterSet(
        bodies=np.array([_body(body, com, inertia) for body in inertias]),
        mass=mass,
        loads=np.array(hung).reshape(len(hung), 10),
        carriers=np.array([load.joint - 1 for load in loads], dtype=np.intp),
        ellipsoid=np.zeros((len(nominal), 0))
        if ellipsoid is None
        else np.column_stack([ellipsoid.centre - nominal, ellipsoid.root]),
    )


@lru_cache(maxsize=4)
def stated_parameters(robot: Robot) -> ParameterSet:
    """The set that a robot's description states, or the default of :class:`~excite.robot.description.UncertaintyBlock`.

    Args:
        robot: the robot.

    Returns:
        The set, about the model's own parameters.

    Raises:
        RobotError: the file of an identification cannot be read, or is another robot's.
    """
    stated, loads = uncertainty_of(robot), []
    if stated.payload is not None:
        joint, pose = link_placement(
            robot.model, stated.payload.link, robot.source, "uncertainty.payload.link"
        )
        loads = [Load(joint, pose.act(np.array(stated.payload.position)), stated.payload.mass)]
    if stated.identified is not None:
        file = robot.source.parent / stated.identified
        return parameter_set(robot.model, loads=loads, ellipsoid=read_ellipsoid(file, robot, stated.sigmas))
    return parameter_set(robot.model, mass=stated.mass, com=stated.com, inertia=stated.inertia, loads=loads)


def uncertainty_of(robot: Robot) -> UncertaintyBlock:
    """What a robot's description says of its uncertainty, or the default."""
    return robot.description.uncertainty or UncertaintyBlock()


def uncertainty_in_words(stated: UncertaintyBlock) -> str:
    """A few words, such as ``± 10 % mass, ± 1 cm centre of mass, ± 20 % inertia of every body``."""
    if stated.identified is not None:
        words = f"{stated.sigmas:g} standard deviations of {stated.identified}"
    else:
        shares = f"± {100 * stated.mass:g} % mass, ± {100 * stated.com:g} cm centre of mass"
        words = f"{shares}, ± {100 * stated.inertia:g} % inertia of every body"
    if stated.payload is not None:
        words += f", 0 to {stated.payload.mass:g} kg at {stated.payload.link}"
    return words


@dataclass(frozen=True, eq=False)
class Load:
    """What may hang at a point of a link, or not.

    Attributes:
        joint: index of the model joint that carries it.
        point: where, in the joint's frame, ``(3,)`` [m].
        mass: at most [kg].
    """

    joint: int
    point: Array
    mass: float


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Parameters ``centre + root @ u``, ``|u| ≤ 1``.

    Attributes:
        centre: ``(10·n_segments,)`` [SI].
        root: ``(10·n_segments, rank)``.
    """

    centre: Array
    root: Array

    @classmethod
    def of_covariance(cls, centre: Array, covariance: Array, sigmas: float) -> Ellipsoid:
        """All parameters within ``sigmas`` standard deviations, ``(φ − centre)ᵀ Σ⁻¹ (φ − centre) ≤ sigmas²``.

        Args:
            centre: ``(10·n_segments,)``.
            covariance: ``(10·n_segments, 10·n_segments)``, of any rank.
            sigmas: how many.
        """
        std = np.sqrt(np.diag(covariance))
        scale = np.where(std > 0.0, std, 1.0)
        # Masses and inertias differ by orders of magnitude: what rounding leaves is judged of correlations.
        power, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
        kept = power > np.finfo(float).eps * len(power)
        root = scale[:, None] * axes[:, kept] * np.sqrt(power[kept])
        return cls(np.asarray(centre, dtype=float), sigmas * root)


@raised_as(RobotError)
def read_ellipsoid(file: Path, robot: Robot, sigmas: float) -> Ellipsoid:
    """The parameters of an identification within some standard deviations, from the file that it left.

    Args:
        file: holds ``links``, ``parameters`` and their ``covariance``, inertial ones in the model's order [SI].
        robot: whose links they are.
        sigmas: how many standard deviations.

    Raises:
        RobotError: it cannot be read, or holds something else, or another robot's.
    """
    found = read_npz(file, _IDENTIFIED, remedy="run `excite identify` again")
    links = [segment.link for segment in robot.segments]
    if set(found) != set(_IDENTIFIED) or list(map(str, found["links"])) != links:
        raise RobotError(
            "is no uncertainty of this robot's links",
            source=file,
            field="uncertainty.identified",
            remedy="name the uncertainty.npz that `excite identify` wrote for this robot",
        )
    n, parameters, covariance = 10 * len(links), found["parameters"], found["covariance"]
    fits = np.shape(parameters) == (n,) and np.shape(covariance) == (n, n)
    if not (fits and np.isfinite(parameters).all() and np.isfinite(covariance).all()):
        raise RobotError(
            f"holds no {n} parameters with a covariance of finite numbers",
            source=file,
            field="uncertainty.identified",
            remedy="run `excite identify` again",
        )
    return Ellipsoid.of_covariance(np.asarray(parameters), np.asarray(covariance), sigmas)


# Arrays of the file that an identification leaves.
_IDENTIFIED = ("links", "parameters", "covariance")


def _body(body: pin.Inertia, com: float, inertia: float) -> Array:
    """A body's parameters for its mass, its mass moved by ``com`` along each axis, and shares of its moments."""
    columns = np.zeros((10, OF_BODY))
    columns[:, 0] = body.mass * _point_mass(body.lever)
    for k, axis in enumerate(np.eye(3)):
        # Of two halves of a body that are moved apart the second moments cancel: what is left is linear.
        moved = _point_mass(body.lever + axis) - _point_mass(body.lever - axis)
        columns[:, 1 + k] = 0.5 * body.mass * com * moved
    moments, axes = np.linalg.eigh(body.inertia)
    for k in range(3):
        square = np.outer(axes[:, k], axes[:, k])
        # Pinocchio's order is xx, xy, yy, xz, yz, zz.
        columns[4:, 4 + k] = inertia * moments[k] * square[np.tril_indices(3)]
    return columns


def _point_mass(at: Array) -> Array:
    """Parameters of one kilogram at a point ``(3,)``, ``(10,)``."""
    return np.asarray(pin.Inertia(1.0, at, np.zeros((3, 3))).toDynamicParameters())
