"""Which coordinates of feet and trunk the legs can prescribe at once while all feet stay where they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import qr

from excite.arrays import Array
from excite.motion.generators.bodyparts import leg_joints, pelvis_joint
from excite.robot.robot import Robot

# In the order in which they are wanted: without the first two nothing balances, without the third no knee works.
_WANTED = ("x", "y", "height")
_TURNS = ("roll", "pitch", "yaw")
_OF_SOLES = ("x", "y", "z", "yaw", "pitch", "roll")
# A coordinate follows from others where it differs from them by less than this share of itself. Of legs of five joints
# on parallel feet one coordinate of the second foot does, to 1e-5 of it; with feet 5 degrees apart to 9e-3, and hard
# tasks that differ so little throw the solver off. The weakest that moves anything is the centre of mass, by 0.04.
_FOLLOWS = 0.02


@dataclass(frozen=True)
class Steering:
    """Coordinates that can be prescribed at rest.

    Attributes:
        trunk: among ``x, y`` (centre of mass), ``height, roll, pitch, yaw`` (pelvis).
        soles: by flat foot, among ``x, y, z, roll, pitch, yaw``; the others follow from these.
        idle: joints of legs that have more than their foot needs, as indices into ``joint_names``: held at rest, they
            leave all of these to be prescribed, and as well as any others would.
    """

    trunk: frozenset[str]
    soles: dict[str, frozenset[str]]
    idle: tuple[int, ...]


def find_steering(robot: Robot) -> Steering:
    """What legs can steer: all of it with six joints to a sole, or three to a point; less with fewer joints.

    Feet come first, then the centre of mass, the height, and the turns that are freest.
    """
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, robot.rest)
    com = pin.jacobianCenterOfMass(model, data, robot.rest)
    legs = sorted({robot.n_base_v + i for foot in robot.feet for i in leg_joints(robot, foot)})
    moving = [*range(robot.n_base_v), *legs]
    chosen = _Independent(len(moving))
    soles = {}
    for number, foot in enumerate(robot.feet):
        rows = dict(
            zip(("x", "y", "z", "roll", "pitch", "yaw"), _contact_rows(robot, data, number), strict=False)
        )
        held = frozenset(name for name in _OF_SOLES if name in rows and chosen.takes(rows[name][moving]))
        if foot.flat:
            soles[foot.name] = held
    pelvis = pin.getJointJacobian(model, data, pelvis_joint(robot), pin.LOCAL_WORLD_ALIGNED)
    wanted = dict(zip((*_WANTED, *_TURNS), (com[0], com[1], *pelvis[2:]), strict=True))
    trunk = [name for name in _WANTED if chosen.takes(wanted[name][moving])]
    turns = list(_TURNS)
    while turns:
        freest = max(turns, key=lambda name: chosen.left(wanted[name][moving]))
        turns.remove(freest)
        if chosen.takes(wanted[freest][moving]):
            trunk.append(freest)
    return Steering(
        frozenset(trunk), soles, tuple(moving[k] - robot.n_base_v for k in chosen.idle(robot.n_base_v))
    )


class _Independent:
    """Rows that do not follow from each other, as an orthonormal basis that grows."""

    def __init__(self, size: int) -> None:
        self._basis = np.zeros((0, size))

    def idle(self, first: int) -> list[int]:
        """Coordinates from ``first`` on that the rows do not need: QR with pivots picks those that serve them best."""
        spare = self._basis.shape[1] - len(self._basis)
        if spare == 0:
            return []
        base, others = self._basis[:, :first], self._basis[:, first:]
        left = others - base @ np.linalg.lstsq(base, others, rcond=None)[0]
        _, pivots = qr(left, mode="r", pivoting=True)
        return sorted(first + int(k) for k in pivots[len(pivots) - spare :])

    def left(self, row: Array) -> float:
        """Share of a row that does not follow from those taken."""
        return float(np.linalg.norm(self._rest(row)) / np.linalg.norm(row))

    def takes(self, row: Array) -> bool:
        """Take a row, unless it follows from those taken."""
        if len(self._basis) == len(row) or self.left(row) < _FOLLOWS:
            return False
        rest = self._rest(row)
        self._basis = np.vstack([self._basis, rest / np.linalg.norm(rest)])
        return True

    def _rest(self, row: Array) -> Array:
        rest = row - (self._basis @ row) @ self._basis
        # Once more: what rounding left along the basis.
        return np.asarray(rest - (self._basis @ rest) @ self._basis)


def _contact_rows(robot: Robot, data: pin.Data, number: int) -> Array:
    """What a foot holds: six rows of a flat one about its middle, three of any other, ``(6 or 3, nv)``."""
    foot = robot.feet[number]
    pose = data.oMi[foot.joint]
    jacobian = pin.getJointJacobian(robot.model, data, foot.joint, pin.LOCAL_WORLD_ALIGNED)
    lever = pose.rotation @ np.mean(foot.sole, axis=0)
    linear = jacobian[:3] - pin.skew(lever) @ jacobian[3:]
    return np.vstack([linear, jacobian[3:]]) if foot.flat else np.asarray(linear)
