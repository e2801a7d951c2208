"""What speed along a path is allowed to be: linear rows in ``(s̈, ṡ²)``, and a bound on ``ṡ``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array, distinct_rows
from excite.motion.generators.bodyparts import leg_joints
from excite.motion.generators.candidate import Candidate
from excite.robot.holding import usable_torque
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot
from excite.safety.repairs.load import take_off_contacts
from excite.safety.repairs.path import MotionPath, PathSample
from excite.safety.repairs.shares import Shares
from excite.safety.repairs.support import Support, friction_rows, support_of, zmp_rows

# An edge faces the free foot within this cosine of the angle to it.
_FACING = 0.7
# Path parameter about a change of feet over which such an edge keeps the others' distance, before it may be approached.
_AT_BORDER = 0.5


@dataclass(frozen=True, eq=False)
class Rows:
    """``static + curved·ṡ² + driven·s̈ ≤ 0`` at path parameters; each row is relative to its limit.

    Attributes:
        labels: what each column limits, as ``(reason, where)``.
        static: ``(n, m)``.
        curved: ``(n, m)``.
        driven: ``(n, m)``.
    """

    labels: tuple[tuple[str, str], ...]
    static: Array
    curved: Array
    driven: Array


@dataclass(frozen=True, eq=False)
class PathLimits:
    """Everything that limits the speed along a path.

    Quantities that are smooth in ``s`` are computed at the path's knots and interpolated between them.

    Attributes:
        candidate: says which feet carry, where.
        path: the path.
        shares: margins.
    """

    candidate: Candidate
    path: MotionPath
    shares: Shares

    @property
    def _robot(self) -> Robot:
        return self.path.robot

    @cached_property
    def _legs(self) -> dict[str, list[int]]:
        return {foot.name: list(leg_joints(self._robot, foot)) for foot in self._robot.feet}

    @cached_property
    def _usable_torque(self) -> Array:
        """Torque that each joint may use beside friction, ``(n_joints,)`` [N·m or N].

        Friction is bounded by that at the velocity limit, so that the rows stay linear.
        """
        share = np.full(self._robot.n_joints, self.shares.torque)
        for leg in self._legs.values():
            share[leg] = self.shares.leg_torque
        return usable_torque(self._robot, share, self.shares.velocity * self._robot.limits.velocity)

    @cached_property
    def _soles(self) -> dict[str, Array]:
        """Sole corners at rest, where a carrying foot always is, ``(n_corners, 3)`` [m]."""
        data = self._robot.model.createData()
        pin.forwardKinematics(self._robot.model, data, self._robot.rest)
        return {
            foot.name: np.array([data.oMi[foot.joint].act(corner) for corner in foot.sole])
            for foot in self._robot.feet
        }

    @cached_property
    def _dynamics(self) -> tuple[Array, Array]:
        """Generalised forces and world contact wrench at the knots, each ``(n, 3, …)`` for 1, ṡ², s̈."""
        robot, knots = self._robot, self.path.knots
        model, data = robot.model, robot.model.createData()
        nothing = np.zeros(model.nv)
        tau = np.empty((len(knots.s), 3, model.nv))
        for i in range(len(knots.s)):
            q, twist, curvature = knots.q[i], knots.twist[i], knots.curvature[i]
            tau[i, 0] = pin.rnea(model, data, q, nothing, nothing)
            tau[i, 1] = pin.rnea(model, data, q, twist, curvature)
            tau[i, 2] = pin.rnea(model, data, q, nothing, twist)
        tau[:, 1:] -= tau[:, :1]
        wrench = np.zeros((len(knots.s), 3, 6))
        if robot.feet:
            rotation = scipy.spatial.transform.Rotation.from_quat(knots.q[:, 3:7]).as_matrix()
            wrench[..., :3] = np.einsum("nij,nkj->nki", rotation, tau[..., :3])
            moment = np.einsum("nij,nkj->nki", rotation, tau[..., 3:6])
            wrench[..., 3:] = moment + np.cross(knots.q[:, None, :3], wrench[..., :3])
            take_off_contacts(self.candidate, self.path, self._soles, tau, wrench)
        if robot.mechanism is not None:
            tau = np.stack([robot.mechanism.on_motors(knots.q, tau[:, k]) for k in range(3)], axis=1)
        armature = per_joint(robot.description.drives.armature, robot.joint_names, np.zeros(robot.n_joints))
        n_base = robot.n_base_v
        tau[:, 1, n_base:] += armature * knots.curvature[:, n_base:]
        tau[:, 2, n_base:] += armature * knots.twist[:, n_base:]
        return tau[..., n_base:], wrench

    def speed_bound(self) -> Array:
        """Largest ``ṡ`` at the knots that joint velocities and phases allow, ``(n,)``; may be infinite."""
        limit = self.shares.velocity * self._robot.limits.velocity
        twist = np.abs(self.path.knots.twist[:, self._robot.n_base_v :])
        with np.errstate(divide="ignore"):
            return np.asarray(np.minimum((limit / twist).min(axis=1), self.phase_bound(self.path.s)))

    def phase_bound(self, s: Array) -> Array:
        """Largest ``ṡ`` that the phases allow at path parameters ``(n,)``; infinite where they say nothing."""
        bound = np.full(len(s), np.inf)
        for phase in self.candidate.phases:
            inside = (s > phase.start) & (s < phase.end)
            bound[inside] = np.minimum(bound[inside], phase.rate)
        return bound

    def rows(self, sample: PathSample) -> Rows:
        """All rows at samples of the path."""
        joints, contacts = self.joint_shares(sample), self.contact_rows(sample)
        return Rows(
            joints.labels + joints.labels + contacts.labels,
            np.hstack([joints.static - 1.0, -joints.static - 1.0, contacts.static]),
            np.hstack([joints.curved, -joints.curved, contacts.curved]),
            np.hstack([joints.driven, -joints.driven, contacts.driven]),
        )

    def joint_shares(self, sample: PathSample) -> Rows:
        """Accelerations and torques of the joints as shares of what they may be, either way: within ±1, not below 0."""
        tau = _interpolate(self.path.s, self._dynamics[0], sample.s) / self._usable_torque
        limit, n_base = self.shares.acceleration * self._robot.limits.acceleration, self._robot.n_base_v
        names = self._robot.joint_names
        return Rows(
            tuple((kind, joint) for kind in ("joint_acceleration", "joint_torque") for joint in names),
            np.hstack([np.zeros((len(sample.s), len(names))), tau[:, 0]]),
            np.hstack([sample.curvature[:, n_base:] / limit, tau[:, 1]]),
            np.hstack([sample.twist[:, n_base:] / limit, tau[:, 2]]),
        )

    def contact_rows(self, sample: PathSample) -> Rows:
        """Rows of the ZMP, of friction and of the load on the feet; none of a robot without feet."""
        s = sample.s
        if not self._robot.feet:
            return Rows((), *np.zeros((3, len(s), 0)))
        rows, labels = self._contact_rows(s, _interpolate(self.path.s, self._dynamics[1], s))
        return Rows(tuple(labels), rows[:, 0], rows[:, 1], rows[:, 2])

    def _contact_rows(self, s: Array, wrench: Array) -> tuple[Array, list[tuple[str, str]]]:
        """ZMP inside the polygon, friction with torsion, enough load; relative to the weight, ``(n, 3, m)``."""
        carried = np.column_stack([self.candidate.supports(s, foot.name) for foot in self._robot.feet])
        # At the border between two phases the smaller support counts.
        for phase in [phase for phase in self.candidate.phases if len(phase.feet) < len(self._robot.feet)]:
            carried[(s >= phase.start) & (s <= phase.end)] = [f.name in phase.feet for f in self._robot.feet]
        weight = self._robot.mass * float(np.linalg.norm(self._robot.model.gravity.linear))
        patterns, member = distinct_rows(carried)
        supports = [self._support(row) for row in patterns]
        n_edges = max(len(support.normals) for support in supports)
        rows = np.zeros((len(s), 3, n_edges + 9))
        for k, support in enumerate(supports):
            at = member == k
            w = wrench[at] / weight
            margin = self._zmp_margins(s[at], patterns[k], support)
            rows[at, :, : len(support.normals)] = zmp_rows(w, support, margin[:, None])
            friction = self.shares.friction_one_foot if patterns[k].sum() == 1 else self.shares.friction
            rows[at, :, n_edges:-1] = friction_rows(w, support, friction)
            rows[at, :, -1] = -w[..., 2]
            rows[at, 0, -1] += self.shares.weight
        labels = [("zmp", "feet")] * n_edges + [("friction", "feet")] * 8 + [("weight_share", "feet")]
        return rows, labels

    def _zmp_margins(self, s: Array, carried: Array, support: Support) -> Array:
        """Distance of the ZMP from the edges of a support polygon, ``(n, n_edges)`` [m]."""
        shares, lifts_a_foot = self.shares, any(not pattern.all() for pattern in self._all_patterns())
        one = carried.sum() == 1
        share = shares.zmp_one_foot if one else shares.zmp_shift if lifts_a_foot else shares.zmp_both_feet
        margin = np.full((len(s), len(support.normals)), min(shares.zmp, share * self._narrowest))
        free = [foot.name for foot, on in zip(self._robot.feet, carried, strict=True) if not on]
        if one and free:
            aside = np.vstack([self._soles[name] for name in free])[:, :2].mean(axis=0) - support.centre
            facing = support.normals @ aside > _FACING * np.linalg.norm(aside)
            borders = np.array([end for phase in self.candidate.phases for end in (phase.start, phase.end)])
            away = np.clip(np.abs(s[:, None] - borders).min(axis=1) - _AT_BORDER, 0.0, 1.0)[:, None]
            margin[:, facing] -= away * np.maximum(0.0, margin[:, facing] - shares.zmp_inwards)
        return margin

    def _all_patterns(self) -> list[Array]:
        """The sets of carrying feet over the whole candidate."""
        return [
            np.array([foot.name in phase.feet for foot in self._robot.feet])
            for phase in self.candidate.phases
        ]

    @cached_property
    def _narrowest(self) -> float:
        """Least inradius [m]: weight shifts end over one foot, and the wider polygon before may not ask for more than
        that foot can give."""
        return min(self._support(pattern).inradius for pattern in self._all_patterns())

    @cached_property
    def _supports(self) -> dict[tuple[bool, ...], Support]:
        """Those that were asked for, by the feet that carry."""
        return {}

    def _support(self, carried: Array) -> Support:
        key = tuple(carried.tolist())
        if key not in self._supports:
            feet = [foot for foot, carries in zip(self._robot.feet, carried, strict=True) if carries]
            friction = min(foot.friction for foot in feet)
            self._supports[key] = support_of([self._soles[foot.name] for foot in feet], friction)
        return self._supports[key]


def _interpolate(knots: Array, values: Array, s: Array) -> Array:
    """Linear interpolation of ``(n, …)`` values along their first axis."""
    if s is knots:
        return values
    i = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2)
    u = ((s - knots[i]) / (knots[i + 1] - knots[i])).reshape(-1, *([1] * (values.ndim - 1)))
    return (1.0 - u) * values[i] + u * values[i + 1]
