"""What speed along a path is allowed to be: linear rows in ``(s̈, ṡ²)``, and a bound on ``ṡ``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array, Flags, Moved, distinct_rows
from excite.motion.generators.generator import Candidate, leg_joints
from excite.robot.joint_values import per_joint
from excite.robot.legs import TORQUE_SHARE, usable_torque
from excite.robot.robot import Robot
from excite.robot.shapes.shape import joints_at
from excite.safety.parameter_set import ParameterSet, RowsOfSet, parameter_set
from excite.safety.repairs.path import MotionPath, PathSample

# An edge faces the free foot within this cosine of the angle to it.
_FACING = 0.7
# Path parameter about a change of feet over which such an edge keeps the others' distance, before it may be approached.
_AT_BORDER = 0.5


@dataclass(frozen=True)
class Shares:
    """How much of each limit repairs use, so that the verdict finds a margin.

    Attributes:
        velocity: of the joint velocity (Jovic et al. 2015, section II.B: 80 %).
        acceleration: of the joint acceleration.
        torque: of the joint torque, for joints outside legs.
        leg_torque: of the joint torque in legs, where the sharing of the load is an assumption.
        jerk: of the joint jerk.
        friction: of the friction coefficient.
        friction_one_foot: the same over one foot, which a quick swing of the other leg turns about its sole's middle.
        weight: smallest share of the weight that the ground carries.
        zmp: distance of the zero-moment point from the support polygon's edge [m].
        zmp_both_feet: where both feet stay down that distance is at most this share of the polygon's inradius.
        zmp_one_foot: over one foot it is at most this share of the sole's inradius: the centre of mass
            stands off the sole's middle there.
        zmp_inwards: distance from the edges that face the free foot, where that is less [m]: the centre of mass
            stands nearer to them, which would leave broad feet no room to swing a leg faster than statically, and
            a robot that tips over them steps on its other foot. The verdict asks for 0.015 m.
        zmp_shift: the same while the weight shifts from two feet to one or back, where a push outwards tips the
            robot over the foot's outer edge.
        robots: for all of which the limits shall hold, too; None for the model's own alone.
        of_robots: of torque and friction, for each of these: what smoothing and the finer grid of the verdict need,
            where the other shares also leave room for robots that are not as the model says.
    """

    velocity: float = 0.8
    acceleration: float = 0.92
    torque: float = TORQUE_SHARE
    leg_torque: float = 0.6
    jerk: float = 0.97
    friction: float = 0.6
    friction_one_foot: float = 0.4
    weight: float = 0.5
    zmp: float = 0.066
    zmp_both_feet: float = 0.87
    zmp_one_foot: float = 0.64
    zmp_inwards: float = 0.02
    zmp_shift: float = 0.7
    robots: ParameterSet | None = None
    of_robots: float = 0.95


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
        """Torque that each joint may use beside friction, ``(n_joints,)`` [N·m or N]."""
        return self._beside_friction(self._robot.limits.torque)

    def _beside_friction(self, limit: Array) -> Array:
        """What is left of torque limits ``(…, n_joints)`` beside friction [N·m or N].

        Friction is bounded by that at the velocity limit, so that the rows stay linear.
        """
        share = np.full(self._robot.n_joints, self.shares.torque)
        for leg in self._legs.values():
            share[leg] = self.shares.leg_torque
        return usable_torque(self._robot, share, self.shares.velocity * self._robot.limits.velocity, limit)

    @cached_property
    def _soles(self) -> dict[str, Array]:
        """Sole corners at rest, where a carrying foot always is, ``(n_corners, 3)`` [m]."""
        data = joints_at(self._robot.model, self._robot.rest)
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
            shares = shares_of_feet(self.candidate, self.path, self._soles, wrench)
            take_off_contacts(self.path, shares, tau, wrench)
        if robot.mechanism is not None:
            tau = np.stack([robot.mechanism.on_motors(knots.q, tau[:, k]) for k in range(3)], axis=1)
        armature = per_joint(robot.description.drives.armature, robot.joint_names, np.zeros(robot.n_joints))
        n_base = robot.n_base_v
        tau[:, 1, n_base:] += armature * knots.curvature[:, n_base:]
        tau[:, 2, n_base:] += armature * knots.twist[:, n_base:]
        return tau[..., n_base:], wrench

    def speed_bound(self) -> Array:
        """Largest ``ṡ`` at the knots that joint velocities and phases allow, ``(n,)``; may be infinite."""
        limit = self.shares.velocity * self.limits_at("velocity", self.path.knots)
        twist = np.abs(self.path.knots.twist[:, self._robot.n_base_v :])
        with np.errstate(divide="ignore"):
            return np.asarray(np.minimum((limit / twist).min(axis=1), self.phase_bound(self.path.s)))

    def limits_at(self, quantity: str, sample: PathSample) -> Array:
        """Limits of the joints at samples of the path, ``(n, n_joints)`` where a table has them depend on positions."""
        robot = self._robot
        return robot.limits.while_between(quantity, sample.q[:, robot.n_base_q :])

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
        both_ways = (
            replace(joints, static=joints.static - 1.0),
            Rows(joints.labels, -joints.static - 1.0, -joints.curved, -joints.driven),
        )
        return _together([*both_ways, contacts, *self.rows_of_set(sample)])

    def rows_of_set(self, sample: PathSample) -> tuple[Rows, ...]:
        """Rows that hold for all robots of ``shares.robots``: those for ``s̈ ≥ 0`` and for ``s̈ ≤ 0``; else none.

        What a sum of parts rises over the set is at most the sum of what each rises: ``h(y₀ + y₁ṡ² + y₂s̈) ≤ h(y₀) +
        h(y₁)ṡ² + h(±y₂)|s̈|``, linear for either sign of ``s̈``.
        """
        if self.shares.robots is None:
            return ()
        parts = [self._joints_of_set(sample)]
        if self._robot.feet and self._robot.floating:
            parts.append(self._contacts_of_set(sample))
        return tuple(_together([part[k] for part in parts]) for k in range(2))

    def _joints_of_set(self, sample: PathSample) -> tuple[Rows, Rows]:
        share = np.full(self._robot.n_joints, self.shares.of_robots)
        usable = usable_torque(self._robot, share, self.shares.velocity * self._robot.limits.velocity)
        nominal = _interpolate_rows(self.path.s, self._dynamics[0], sample.s)[..., None, :]
        rises = _interpolate_rows(self.path.s, self._rises_of_torques, sample.s)
        # The torque upwards, and downwards.
        ways = np.concatenate([nominal, -nominal], axis=2) / usable
        up, down = rises / usable, rises[:, :, ::-1] / usable
        labels = tuple(("robust_joint_torque", joint) for joint in self._robot.joint_names) * 2
        return _either_way(labels, ways, up, down, 1.0)

    def _contacts_of_set(self, sample: PathSample) -> tuple[Rows, Rows]:
        wrench = _interpolate_rows(self.path.s, self._dynamics[1], sample.s) / self._weight
        carried = self._carried(sample.s)
        patterns, member = distinct_rows(carried)
        n_edges = max(len(self._support(row).normals) for row in patterns)
        # Rows that no support has are never broken.
        values, up, down = np.zeros((3, len(sample.s), 3, n_edges + 8))
        values[:, 0] = -1.0
        for k, pattern in enumerate(patterns):
            at = np.flatnonzero(member == k)
            forms, rises = self._forms(pattern), self._rises_of_forms(pattern)
            columns = np.r_[0 : len(forms) - 8, n_edges : n_edges + 8]
            values[np.ix_(at, np.arange(3), columns)] = wrench[at] @ forms.T
            found = _interpolate_rows(self.path.s, rises, sample.s[at])
            up[np.ix_(at, np.arange(3), columns)], down[np.ix_(at, np.arange(3), columns)] = (
                found[..., 0],
                found[..., 1],
            )
        labels = (("robust_zmp", "feet"),) * n_edges + (("robust_friction", "feet"),) * 8
        return _either_way(labels, values[:, :, None], up[:, :, None], down[:, :, None], 0.0)

    def _forms(self, carried: Array) -> Array:
        """Linear forms ``(n_edges + 8, 6)`` of the wrench, relative to the weight, that shall not be positive."""
        support = self._support(carried)
        unit = np.eye(6)
        return np.vstack(
            [
                zmp_rows(unit, support, self.shares.zmp_inwards).T,
                friction_rows(unit, support, self.shares.of_robots).T,
            ]
        )

    @cached_property
    def _robots(self) -> ParameterSet:
        """Robots that rows are wanted for: the model's own alone where nobody said which."""
        return self.shares.robots or parameter_set(self._robot.model)

    @cached_property
    def _rows_of_set(self) -> tuple[Array, Array]:
        """Torques' and the wrench's rows at the knots in the set's coordinates, each ``(3, n, …)`` for 1, ṡ², s̈."""
        knots, robot, shares = self.path.knots, self._robot, None
        of_set, nothing = RowsOfSet(robot, self._robots), np.zeros_like(knots.twist)
        moved = [
            Moved(knots.q, *rates)
            for rates in ((nothing, nothing), (knots.twist, knots.curvature), (nothing, knots.twist))
        ]
        if robot.feet and robot.floating:
            shares = shares_of_feet(self.candidate, self.path, self._soles, self._dynamics[1])
        whole = [of_set.of_wrench(one) for one in moved]
        torques = np.array([of_set.of_torques(*pair, shares) for pair in zip(moved, whole, strict=True)])
        wrenches = np.array([rows.of_wrench for rows in whole])
        for rows in (torques, wrenches):
            rows[1:] -= rows[:1]
        return torques, wrenches

    @cached_property
    def _rises_of_torques(self) -> Array:
        """How far the torques at the knots rise and fall over the set, ``(n, 3, 2, n_joints)`` [N·m or N]."""
        rises = [self._robots.rise(self._rows_of_set[0], sign) for sign in (1.0, -1.0)]
        return np.stack(rises, axis=2).transpose(1, 0, 2, 3)

    @cached_property
    def _known_rises(self) -> dict[tuple[bool, ...], Array]:
        """Those of contacts that were asked for, by the feet that carry."""
        return {}

    def _rises_of_forms(self, carried: Array) -> Array:
        """How far the forms of a support rise and fall at the knots, ``(n, 3, n_forms, 2)``, relative to the weight."""
        key = tuple(carried.tolist())
        if key not in self._known_rises:
            forms, of_wrench = self._forms(carried) / self._weight, self._rows_of_set[1]
            n, n_forms = len(self.path.s), len(forms)
            every, at = np.tile(forms, (n, 1)), np.repeat(np.arange(n), n_forms)
            self._known_rises[key] = (
                np.array(
                    [
                        [self._robots.rise_of_forms(sign * every, at, part) for part in of_wrench]
                        for sign in (1.0, -1.0)
                    ]
                )
                .reshape(2, 3, n, n_forms)
                .transpose(2, 1, 3, 0)
            )
        return self._known_rises[key]

    def joint_shares(self, sample: PathSample) -> Rows:
        """Accelerations and torques of the joints as shares of what they may be, either way: within ±1, not below 0."""
        tau = _interpolate_rows(self.path.s, self._dynamics[0], sample.s)
        if self._robot.limits.tables:
            tau = tau / self._beside_friction(self.limits_at("torque", sample))[..., None, :]
        else:
            tau = tau / self._usable_torque
        limit = self.shares.acceleration * self.limits_at("acceleration", sample)
        n_base = self._robot.n_base_v
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
        rows, labels = self._contact_rows(s, _interpolate_rows(self.path.s, self._dynamics[1], s))
        return Rows(tuple(labels), rows[:, 0], rows[:, 1], rows[:, 2])

    def _contact_rows(self, s: Array, wrench: Array) -> tuple[Array, list[tuple[str, str]]]:
        """ZMP inside the polygon, friction with torsion, enough load; relative to the weight, ``(n, 3, m)``."""
        carried = self._carried(s)
        patterns, member = distinct_rows(carried)
        supports = [self._support(row) for row in patterns]
        n_edges = max(len(support.normals) for support in supports)
        rows = np.zeros((len(s), 3, n_edges + 9))
        for k, support in enumerate(supports):
            at = member == k
            w = wrench[at] / self._weight
            margin = self._zmp_margins(s[at], patterns[k], support)
            rows[at, :, : len(support.normals)] = zmp_rows(w, support, margin[:, None])
            friction = self.shares.friction_one_foot if patterns[k].sum() == 1 else self.shares.friction
            rows[at, :, n_edges:-1] = friction_rows(w, support, friction)
            rows[at, :, -1] = -w[..., 2]
            rows[at, 0, -1] += self.shares.weight
        labels = [("zmp", "feet")] * n_edges + [("friction", "feet")] * 8 + [("weight_share", "feet")]
        return rows, labels

    @cached_property
    def _weight(self) -> float:
        """[N]"""
        return self._robot.mass * float(np.linalg.norm(self._robot.model.gravity.linear))

    def _carried(self, s: Array) -> Flags:
        """Which feet carry, ``(n, n_feet)``; at the border between two phases the smaller support counts."""
        carried = np.column_stack([self.candidate.supports(s, foot.name) for foot in self._robot.feet])
        for phase in [phase for phase in self.candidate.phases if len(phase.feet) < len(self._robot.feet)]:
            carried[(s >= phase.start) & (s <= phase.end)] = [f.name in phase.feet for f in self._robot.feet]
        return carried

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


def _together(parts: Sequence[Rows]) -> Rows:
    """All rows side by side."""
    return Rows(
        sum((part.labels for part in parts), ()),
        *(np.hstack([getattr(part, kind) for part in parts]) for kind in ("static", "curved", "driven")),
    )


def _either_way(
    labels: tuple[tuple[str, str], ...], values: Array, up: Array, down: Array, limit: float
) -> tuple[Rows, Rows]:
    """Rows with what they rise over a set added, for ``s̈ ≥ 0`` and ``s̈ ≤ 0``, from ``(n, 3, …)`` for 1, ṡ², s̈."""
    values, up, down = (part.reshape(*part.shape[:2], -1) for part in (values, up, down))
    static, curved = values[:, 0] + up[:, 0] - limit, values[:, 1] + up[:, 1]
    return (
        Rows(labels, static, curved, values[:, 2] + up[:, 2]),
        Rows(labels, static, curved, values[:, 2] - down[:, 2]),
    )


def _interpolate_rows(knots: Array, values: Array, s: Array) -> Array:
    """Linear interpolation of ``(n, …)`` values along their first axis."""
    if s is knots:
        return values
    i = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2)
    u = ((s - knots[i]) / (knots[i + 1] - knots[i])).reshape(-1, *([1] * (values.ndim - 1)))
    return (1.0 - u) * values[i] + u * values[i + 1]


# How the feet share the load along a path, and what that takes off the joints' torques.


def take_off_contacts(path: MotionPath, shares: Array, tau: Array, wrench: Array) -> None:
    """Take the contact forces' torques off generalised forces at the knots of a path, in place.

    Args:
        path: the path.
        shares: ``(n, n_feet, 6, 6)`` of each foot, from :func:`shares_of_feet`.
        tau: ``(n, 3, nv)`` generalised forces without contacts for 1, ṡ², s̈.
        wrench: ``(n, 3, 6)`` the wrench that the ground must supply, about the world origin.
    """
    robot = path.robot
    data = robot.model.createData()
    for i, q in enumerate(path.knots.q):
        pin.forwardKinematics(robot.model, data, q)
        for k in np.flatnonzero(shares[i].any(axis=(1, 2))).tolist():
            joint = robot.feet[k].joint
            jacobian = pin.computeJointJacobian(robot.model, data, q, joint)
            # The transpose of a pose's action takes a wrench from the world's origin to the joint's frame.
            tau[i] -= wrench[i] @ shares[i, k].T @ data.oMi[joint].toActionMatrix() @ jacobian


def shares_of_feet(
    candidate: Candidate, path: MotionPath, soles: Mapping[str, Array], wrench: Array
) -> Array:
    """Wrench of each foot about the world origin per total wrench at the knots of a path, ``(n, n_feet, 6, 6)``.

    They are linear in the wrench, as the rows of a path's limits have to be: two soles share it by their nearness to
    where it acts, any other feet so that the forces on their corners are smallest. That none of them pulls is for the
    verdict to say. Free feet have no share.

    Args:
        candidate: says which feet carry, where.
        path: the path.
        soles: corners of each foot at rest, where a carrying foot always is, ``(n_corners, 3)`` [m].
        wrench: ``(n, 3, 6)`` the wrench that the ground must supply for 1, ṡ², s̈, about the world origin.
    """
    feet, knots = path.robot.feet, path.knots
    carried = np.column_stack([candidate.supports(knots.s, foot.name) for foot in feet])
    found = np.zeros((len(knots.s), len(feet), 6, 6))
    if not (len(feet) == 2 and all(foot.flat for foot in feet)):
        patterns, member = distinct_rows(carried)
        return np.array([corner_shares(path.robot, soles, pattern) for pattern in patterns])[member]
    centres = np.array([soles[foot.name].mean(axis=0) for foot in feet])
    point = np.column_stack([-wrench[:, 0, 4], wrench[:, 0, 3]]) / wrench[:, 0, 2:3]
    share = load_shares(point, centres, carried)
    middle = share @ centres
    for k in range(len(feet)):
        found[:, k] = np.eye(6)
        found[:, k, 3:, :3] = [pin.skew(lever) for lever in centres[k] - middle]
    return np.asarray(found * share[:, :, None, None])


def load_shares(point: Array, centres: Array, carried: Flags) -> Array:
    """Share of the load on each of two feet, ``(n, 2)``, from where it acts between their centres."""
    line = centres[1, :2] - centres[0, :2]
    second = np.clip((point - centres[0, :2]) @ line / (line @ line), 0.0, 1.0)
    share = np.column_stack([1.0 - second, second])
    share = np.where(carried, np.maximum(share, 1e-9), 0.0)
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def corner_shares(robot: Robot, soles: Mapping[str, Array], carried: Flags) -> Array:
    """Wrench of each foot about the world origin per total wrench, ``(n_feet, 6, 6)``; zero for free feet.

    Args:
        robot: the robot.
        soles: corners of each foot, ``(n_corners, 3)`` [m].
        carried: whether each foot carries, ``(n_feet,)``.
    """
    shares = np.zeros((len(carried), 6, 6))
    owners = [k for k in np.flatnonzero(carried) for _ in soles[robot.feet[k].name]]
    if not owners:
        return shares
    corners = np.vstack([soles[robot.feet[k].name] for k in np.flatnonzero(carried)])
    maps = [np.vstack([np.eye(3), pin.skew(corner)]) for corner in corners]
    forces = np.linalg.pinv(np.hstack(maps)).reshape(len(maps), 3, 6)
    for k, to_wrench, force in zip(owners, maps, forces, strict=True):
        shares[k] += to_wrench @ force
    return shares


# The ground's side of balance: support polygons, and linear rows on the contact wrench.


@dataclass(frozen=True, eq=False)
class Support:
    """A support polygon: ``normals @ x + offsets ≤ 0`` inside.

    Attributes:
        normals: outward, ``(m, 2)``.
        offsets: ``(m,)`` [m].
        centre: mean of the corners, ``(2,)`` [m].
        inradius: distance of the centre from the nearest edge [m].
        radius: mean distance of the corners from their foot's centre [m], the lever arm of torsional friction; of
            point feet and edges the distance from the centre of all.
        friction: coefficient.
    """

    normals: Array
    offsets: Array
    centre: Array
    inradius: float
    radius: float
    friction: float


def support_of(soles: Sequence[Array], friction: float) -> Support:
    """The support polygon of soles on level ground.

    Args:
        soles: corners of each sole that carries, ``(n_corners, 2 or more)`` [m], world frame.
        friction: smallest friction coefficient among them.
    """
    corners = [sole[:, :2] for sole in soles]
    together = np.vstack(corners)
    # Qhull's equations: outward unit normal and offset, n·x + c ≤ 0 inside; one for each edge.
    equations = np.unique(np.round(scipy.spatial.ConvexHull(together).equations, 9), axis=0)
    centre = together.mean(axis=0)
    flat = all(len(sole) >= 3 for sole in corners)
    apart = [c - (c.mean(axis=0) if flat else centre) for c in corners]
    return Support(
        normals=equations[:, :2],
        offsets=equations[:, 2],
        centre=centre,
        inradius=float(-(equations[:, :2] @ centre + equations[:, 2]).max()),
        radius=float(np.mean([np.linalg.norm(c, axis=1).mean() for c in apart])),
        friction=friction,
    )


def zmp_rows(w: Array, support: Support, margin: float | Array) -> Array:
    """Rows that keep the zero-moment point inside: ``n·(f_z p) + (c + margin) f_z ≤ 0``, ``f_z p = (−m_y, m_x)``.

    Args:
        w: wrenches about the world origin, ``(…, 6)``, relative to the weight.
        support: the support polygon.
        margin: distance from its edge [m], one or of a shape that goes with ``(…, n_edges)``.

    Returns:
        ``(…, n_edges)``, in units of 0.1 m of distance.
    """
    point = np.stack([-w[..., 4], w[..., 3]], axis=-1)
    return 10.0 * (point @ support.normals.T + w[..., 2:3] * (support.offsets + margin))


def friction_rows(w: Array, support: Support, share: float) -> Array:
    """Rows against slipping and turning: ``±f_x ± f_y ± m_z/r ≤ share·μ f_z``, moment about the polygon's centre.

    Args:
        w: wrenches about the world origin, ``(…, 6)``, relative to the weight.
        support: the support polygon.
        share: of the friction coefficient.

    Returns:
        ``(…, 8)``.
    """
    vertical = w[..., 5] - (support.centre[0] * w[..., 1] - support.centre[1] * w[..., 0])
    parts = np.stack([w[..., 0], w[..., 1], vertical / support.radius], axis=-1)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return np.asarray(parts @ signs.T - share * support.friction * w[..., 2:3])
