"""Base and legs that keep feet, centre of mass and pelvis where they belong, along a path (placo)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import scipy
from defusedxml.ElementTree import fromstring
from scipy.linalg import qr, solve_banded

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.generators.curves import Curve, PolynomialCurve, SplineCurve, hermite_curve
from excite.motion.generators.generator import Candidate, leg_joints, pelvis_joint, support_corners
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.shape import has_area, joints_at
from excite.safety.ground_forces import wrench_at_world_origin, zero_moment_point
from excite.safety.repairs.draft import Draft, Rejection, Repair, refused_by
from excite.safety.repairs.path import MotionPath, coordinates_of
from excite.safety.repairs.waypoints import SAMPLES_PER_SPAN

# Samples of a Fourier series: per second of its own time.
_SAMPLES_PER_SECOND = 40.0
# The same of a walk, and how often its centre of mass is corrected.
_WALK_SAMPLES_PER_SECOND, _CORRECTIONS = 80.0, 3
# A free sole's corners may come this close to the ground [m].
_GROUND = 1e-3
# Distance from the position limits that the path keeps at its knots [rad or m].
_LIMIT = 1e-3


class WholeBody(Repair):
    """Finds base and legs along the path; upper-body joints, feet and centre of mass are as asked for.

    Feet (six coordinates of a sole, three of a point or an edge), the horizontal centre of mass and the pelvis's
    height and orientation are hard tasks: as many as there are free coordinates for legs of six joints, or three, so
    that the solution is a smooth function of the path. A robot without feet keeps its base where it rests.
    """

    name: ClassVar[str] = "whole_body"

    @cached_property
    def _balancer(self) -> Balancer | None:
        return Balancer(self.robot) if self.robot.feet else None

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft with a path; or ``unreachable``, ``mechanism``, ``joint_position``, ``self_collision`` or
        ``foot_ground``."""
        outcome = self._attempt(draft)
        for smaller in milder_candidates(draft.candidate):
            if isinstance(outcome, Draft):
                break
            outcome = self._attempt(replace(draft, candidate=smaller))
        return outcome

    def _attempt(self, draft: Draft) -> Draft | Rejection:
        candidate = draft.candidate
        feet = ([self.robot.foot(name) for name in phase.feet] for phase in candidate.phases)
        if not all(has_area(support_corners(self.robot, standing)) for standing in feet):
            return draft.rejected("no_support", "feet")
        s = path_grid(candidate)
        q = np.tile(self.robot.rest, (len(s), 1))
        q[:, self.robot.n_base_q :] = candidate.posture.evaluate(s)
        for k in range(1 if candidate.zmp is None else 1 + _CORRECTIONS):
            if k:
                candidate = follow_zmp(self.robot, candidate, s, q)
            solved = len(s) if self._balancer is None else self._balancer.solve(candidate, s, q)
            if solved < len(s):
                return draft.rejected("unreachable", "legs")
            if self.robot.closing is not None:
                try:
                    q[:] = self.robot.closing.close_configurations(q)
                except MotionError as error:
                    return draft.rejected("mechanism", error.field or "loops")
            low, high = self.robot.limits.position_lower, self.robot.limits.position_upper
            joints = q[:, self.robot.n_base_q :]
            beyond = np.maximum(low + _LIMIT - joints, joints - high + _LIMIT)
            if (beyond > 0.0).any():
                row, joint = np.unravel_index(int(beyond.argmax()), beyond.shape)
                value = float(joints[row, joint])
                limit = low[joint] if value < 0.5 * (low[joint] + high[joint]) else high[joint]
                return draft.rejected(
                    "joint_position", self.robot.joint_names[joint], value=value, limit=float(limit)
                )
        foot = self._grounded(candidate, s, q)
        if foot is not None:
            return draft.rejected("foot_ground", foot)
        collision = self.probe.first(q)
        if collision is not None:
            return refused_by(draft, self.probe.closest(q[collision:]))
        return replace(draft, path=MotionPath(self.robot, s, coordinates_of(self.robot, q)))

    def _grounded(self, candidate: Candidate, s: Array, q: Array) -> str | None:
        """Name of a free foot that goes below the ground."""
        data = self.robot.model.createData()
        for foot in self.robot.feet:
            free = ~candidate.supports(s, foot.name)
            for row in q[free]:
                pin.forwardKinematics(self.robot.model, data, row)
                pose = data.oMi[foot.joint]
                if (foot.sole @ pose.rotation[2] + pose.translation[2]).min() < -_GROUND:
                    return foot.name
        return None


def path_grid(candidate: Candidate) -> Array:
    """Path parameters at which the path is computed, ends and control-point knots among them."""
    if candidate.zmp is not None and candidate.speed is not None:
        n = int(np.ceil(candidate.length / candidate.speed * _WALK_SAMPLES_PER_SECOND))
    elif isinstance(candidate.posture, SplineCurve):
        n = round(candidate.length) * SAMPLES_PER_SPAN
    else:
        n = max(60, int(np.ceil(candidate.length * _SAMPLES_PER_SECOND)))
    return np.linspace(0.0, candidate.length, n + 1)


# Milder versions of a leg motion, for legs that cannot follow it.

# Shares of a leg motion that are tried in turn; of one on a single leg, for the free foot and for the pelvis, whose
# lean over the other foot brings the thighs together.
_SHRINKS = (0.85, 0.7, 0.55)
_ONE_LEG_SHRINKS = ((0.85, 1.0), (0.7, 1.0), (0.55, 1.0), (0.7, 0.6), (0.55, 0.4))
# Shares of the pitch of a walk's free soles, and of the pelvis's roll, which hips stop or ankles need.
_WALK_SHRINKS = ((0.5, 1.0), (0.5, 0.5), (0.5, 1.4))


def milder_candidates(candidate: Candidate) -> Iterator[Candidate]:
    """The candidate with milder leg motions, in turn; none if it has no leg motion."""
    pelvis, com = candidate.pelvis, candidate.com
    if candidate.zmp is not None:
        # Footprints, pelvis and centre of mass belong together, but for these.
        for pitch, lean in _WALK_SHRINKS:
            feet = {
                name: _scale_curve(curve, [1.0, 1.0, 1.0, 1.0, pitch, 1.0])
                for name, curve in candidate.feet.items()
            }
            yield replace(candidate, feet=feet, pelvis=pelvis and _scale_curve(pelvis, [1.0, lean, 1.0, 1.0]))
    elif candidate.feet:
        for swing, lean in _ONE_LEG_SHRINKS:
            feet = {name: curve.shrunk(swing) for name, curve in candidate.feet.items()}
            # As low as before: the legs have to reach as far.
            yield replace(
                candidate, feet=feet, pelvis=pelvis and _scale_curve(pelvis, [1.0, lean, lean, lean])
            )
    elif pelvis is not None:
        for factor in _SHRINKS:
            yield replace(candidate, pelvis=pelvis.shrunk(factor), com=com and com.shrunk(factor))


def _scale_curve(curve: Curve, factors: list[float]) -> Curve:
    return curve.shrunk(np.array(factors)) if isinstance(curve, PolynomialCurve | SplineCurve) else curve


# Walks: move the centre of mass so that the whole robot's zero-moment point is where it shall be.


def follow_zmp(robot: Robot, candidate: Candidate, s: Array, q: Array) -> Candidate:
    """The candidate with a centre of mass that brings the zero-moment point nearer to where it shall be.

    The zero-moment point that a body motion ``q`` has and the one asked for differ by ``e``; a pendulum whose centre of
    mass moves by ``d`` with ``d − d̈/ω² = e`` makes up for it. In differences this is a tridiagonal system (Kagami et
    al. 2002); what the rest of the body then does is small, and is left to the next pass.

    Args:
        robot: the robot.
        candidate: a walk, with the centre of mass that ``q`` has.
        s: path parameters, ``(n,)``, evenly spaced.
        q: configurations at these, ``(n, nq)``.
    """
    if candidate.com is None or candidate.zmp is None or candidate.speed is None:
        return candidate
    com, squared = _pendulum_model(robot)
    rate = candidate.speed
    error = com + candidate.zmp.evaluate(s) - _zmp_of(robot, s, q, rate)
    step = (s[1] - s[0]) / rate
    coupling = 1.0 / (squared * step**2)
    bands = np.zeros((3, len(s) - 2))
    bands[0, 1:] = bands[2, :-1] = -coupling
    bands[1] = 1.0 + 2.0 * coupling
    moved = np.zeros_like(error)
    moved[1:-1] = solve_banded((1, 1), bands, error[1:-1])
    # Standing on both feet the robot starts and ends as it would without.
    moved *= _walking_window(candidate, s)[:, None]
    values = candidate.com.evaluate(s) + moved
    first = np.gradient(values, s, axis=0, edge_order=2)
    second = np.gradient(first, s, axis=0, edge_order=2)
    for derivative in (first, second):
        derivative[[0, -1]] = 0.0
    return replace(candidate, com=hermite_curve(s, values, first, second))


def _pendulum_model(robot: Robot) -> tuple[Array, float]:
    """Horizontal centre of mass at rest, ``(2,)`` [m], and the square of the pendulum's frequency [1/s²]."""
    centre = np.array(pin.centerOfMass(robot.model, robot.model.createData(), robot.rest))
    return centre[:2], float(np.linalg.norm(robot.model.gravity.linear)) / float(centre[2])


def _zmp_of(robot: Robot, s: Array, q: Array, rate: float) -> Array:
    sample = MotionPath(robot, s, coordinates_of(robot, q)).knots
    data = robot.model.createData()
    forces = np.array(
        [
            pin.rnea(robot.model, data, *row)[:6]
            for row in zip(sample.q, sample.twist * rate, sample.curvature * rate**2, strict=True)
        ]
    )
    rotation = scipy.spatial.transform.Rotation.from_quat(sample.q[:, 3:7]).as_matrix()
    return zero_moment_point(wrench_at_world_origin(forces, rotation, sample.q[:, :3]))


def _walking_window(candidate: Candidate, s: Array) -> Array:
    """1 while the robot walks, smoothly 0 at the start of the first stance and at the end of the last, ``(n,)``."""
    first, last = candidate.phases[0].end, candidate.phases[-1].start
    u = np.clip(np.minimum(s / first, (s[-1] - s) / (s[-1] - last)), 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


# placo's solver, and the targets that it follows.

_TURNS = {"x": "roll", "y": "pitch", "z": "yaw"}
_TOLERANCE = 1e-9
# Steps of Newton's method.
_ITERATIONS = 12


def _kinematic_urdf(robot: Robot) -> str:
    """The URDF without visual and collision elements, and with a link at the middle of each sole that is not flat.

    placo would read every mesh, 250 MB on a G1. It asks for frames by name alone: links get names that no joint has.
    """
    root = fromstring(robot.urdf)
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            element = joint.find(end)
            if element is not None:
                element.set("link", _frame_name(element.get("link", "")))
    for link in root.findall("link"):
        link.set("name", _frame_name(link.get("name", "")))
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    for foot in robot.feet:
        if not foot.flat:
            corners = next(block.sole for block in robot.description.feet if block.name == foot.name)
            joint = ElementTree.SubElement(root, "joint", name=_tip_name(foot) + "/joint", type="fixed")
            ElementTree.SubElement(joint, "parent", link=_frame_name(foot.link))
            ElementTree.SubElement(joint, "child", link=_tip_name(foot))
            ElementTree.SubElement(
                joint, "origin", xyz=" ".join(map(repr, np.mean(corners, axis=0).tolist()))
            )
            ElementTree.SubElement(root, "link", name=_tip_name(foot))
    return ElementTree.tostring(root, encoding="unicode")


def _frame_name(link: str) -> str:
    return f"{link}/link"


def _tip_name(foot: Foot) -> str:
    return f"{foot.link}/{foot.name}/tip"


class Balancer:
    """placo's kinematics solver with hard tasks, and the targets that they follow."""

    def __init__(self, robot: Robot) -> None:
        import placo

        self._robot = robot
        self._wrapper = placo.RobotWrapper("", int(placo.Flags.ignore_collisions), _kinematic_urdf(robot))
        model = self._wrapper.model
        names = list(model.names)
        # placo's model also has the joints that ours has locked, except those with mimics, which it drops.
        self._index = np.r_[
            np.arange(7), [model.joints[names.index(joint)].idx_q for joint in robot.joint_names]
        ]
        self._rest = np.array(self._wrapper.state.q)
        for joint, value in robot.description.locked_joints.items():
            if joint not in names:
                continue
            self._rest[model.joints[names.index(joint)].idx_q] = value
        self._rest[self._index] = robot.rest
        self._set(self._rest)
        legs = {robot.joint_names[i] for foot in robot.feet for i in leg_joints(robot, foot)}
        solver = placo.KinematicsSolver(self._wrapper)
        solver.enable_joint_limits(False)
        can = find_steering(robot)
        # Joints that no task needs would drift, or creep towards rest by steps that do not end: with two to a leg of
        # CENTAURO no candidate was solved.
        legs -= {robot.joint_names[i] for i in can.idle}
        for joint in names[2:]:
            if joint not in legs:
                solver.mask_dof(joint)
        self._feet = {}
        for foot in robot.feet:
            self._feet[foot.name] = _foot_task(solver, self._wrapper, robot, foot, can)
        self._com_rest = np.array(self._wrapper.com_world())
        self._com = solver.add_com_task(self._com_rest)
        self._com.mask.set_axises("".join(axis for axis in "xy" if axis in can.trunk))
        self._com.configure("com", "hard", 1.0)
        pelvis = _frame_name(robot.segments[pelvis_joint(robot) - 1].link)
        self._pelvis_rest = np.array(self._wrapper.get_T_world_frame(pelvis))
        self._turn = solver.add_orientation_task(pelvis, self._pelvis_rest[:3, :3])
        self._turn.mask.set_axises("".join(axis for axis, turn in _TURNS.items() if turn in can.trunk))
        self._turn.configure("pelvis_orientation", "hard", 1.0)
        self._height = solver.add_position_task(pelvis, self._pelvis_rest[:3, 3])
        self._height.mask.set_axises("z" if "height" in can.trunk else "")
        self._height.configure("pelvis_height", "hard", 1.0)
        self._solver = solver
        # Targets as every later solve leaves them: placo rounds a pose that it is handed.
        self._reset_feet()

    def _set(self, q: Array) -> None:
        self._wrapper.state.q = q
        self._wrapper.update_kinematics()

    def solve(self, candidate: Candidate, s: Array, q: Array) -> int:
        """Fill in base and legs of ``q`` ``(n, nq)`` row by row; returns the number of rows that were solved."""
        pelvis = np.zeros((len(s), 4)) if candidate.pelvis is None else candidate.pelvis.evaluate(s)
        com = np.zeros((len(s), 2)) if candidate.com is None else candidate.com.evaluate(s)
        turn = (
            scipy.spatial.transform.Rotation.from_euler("xyz", pelvis[:, 1:]).as_matrix()
            @ self._pelvis_rest[:3, :3]
        )
        moved = {name: self._feet[name].targets(curve.evaluate(s)) for name, curve in candidate.feet.items()}
        centres = self._com_rest + np.column_stack([com, np.zeros(len(s))])
        heights = self._pelvis_rest[:3, 3] + np.column_stack([np.zeros((len(s), 2)), pelvis[:, 0]])
        guess = self._rest.copy()
        before = guess.copy()
        n_base = self._robot.n_base_q
        joints = self._index[n_base:]
        legs = [i for foot in self._robot.feet for i in leg_joints(self._robot, foot)]
        free = np.r_[np.setdiff1d(np.arange(len(self._rest)), joints), joints[legs]]
        for i in range(len(s)):
            start = guess.copy()
            start[joints] = q[i, n_base:]
            # Carry on as in the step before; the base turns little enough for that to be a guess.
            start[free] = 2.0 * guess[free] - before[free]
            start[3:7] /= np.linalg.norm(start[3:7])
            self._com.target_world = centres[i]
            self._turn.R_world_frame = turn[i]
            self._height.target_world = heights[i]
            for name, targets in moved.items():
                self._feet[name].aim(targets[i])
            if not self._converge(start):
                self._reset_feet()
                return i
            before, guess = guess, np.array(self._wrapper.state.q)
            q[i] = guess[self._index]
        self._reset_feet()
        return len(s)

    def _converge(self, start: Array) -> bool:
        self._set(start)
        for _ in range(_ITERATIONS):
            try:
                step = self._solver.solve(True)
            except RuntimeError:
                return False
            self._wrapper.update_kinematics()
            size = np.abs(step).max()
            if not np.isfinite(size) or size > 1.0:
                return False
            if size < _TOLERANCE:
                return True
            # Newton's steps shrink quadratically: after one this small nothing is left to gain.
            if size < 1e-5:
                return True
        return False

    def _reset_feet(self) -> None:
        for task in self._feet.values():
            task.reset()


def _foot_task(solver: Any, wrapper: Any, robot: Robot, foot: Foot, can: Steering) -> _SoleTask | _TipTask:
    if not foot.flat:
        return _TipTask(solver, wrapper, foot)
    data = joints_at(robot.model, robot.rest)
    sole = np.array(data.oMi[foot.joint].act(foot.placement.translation))
    return _SoleTask(solver, wrapper, foot, sole, can.soles[foot.name])


class _SoleTask:
    """Keeps a flat foot's six coordinates, but for those that follow from the other feet's."""

    def __init__(self, solver: Any, wrapper: Any, foot: Foot, sole: Array, held: frozenset[str]) -> None:
        self._pose = np.array(wrapper.get_T_world_frame(_frame_name(foot.link)))
        self._task = solver.add_frame_task(_frame_name(foot.link), self._pose)
        if len(held) < 6:
            self._task.position().mask.set_axises("".join(axis for axis in "xyz" if axis in held))
            self._task.orientation().mask.set_axises(
                "".join(axis for axis, turn in _TURNS.items() if turn in held)
            )
        self._task.configure(foot.name, "hard", 1.0, 1.0)
        self._sole = sole

    def targets(self, displacements: Array) -> Array:
        """What to aim at for displacements from rest ``(n, 6)``."""
        return _displace_foot(self._pose, self._sole, displacements)

    def aim(self, target: Array) -> None:
        self._task.T_world_frame = target

    def reset(self) -> None:
        self._task.T_world_frame = self._pose


class _TipTask:
    """Keeps the middle of a point foot or an edge; the link turns about it."""

    def __init__(self, solver: Any, wrapper: Any, foot: Foot) -> None:
        self._place = np.array(wrapper.get_T_world_frame(_tip_name(foot)))[:3, 3]
        self._task = solver.add_position_task(_tip_name(foot), self._place)
        self._task.configure(foot.name, "hard", 1.0)

    def targets(self, displacements: Array) -> Array:
        """What to aim at for displacements from rest ``(n, 6)``."""
        return np.asarray(self._place + displacements[:, :3])

    def aim(self, target: Array) -> None:
        self._task.target_world = target

    def reset(self) -> None:
        self._task.target_world = self._place


def _displace_foot(pose: Array, sole: Array, displacements: Array) -> Array:
    """A foot's pose moved by translations, and turned by rotation vectors about its sole's centre, ``(n, 4, 4)``."""
    turns = scipy.spatial.transform.Rotation.from_rotvec(displacements[:, 3:]).as_matrix()
    moved = np.tile(np.eye(4), (len(turns), 1, 1))
    for target, turn, displacement in zip(moved, turns, displacements, strict=True):
        target[:3, :3] = turn @ pose[:3, :3]
        target[:3, 3] = sole + displacement[:3] + turn @ (pose[:3, 3] - sole)
    return moved


# Which coordinates of feet and trunk the legs can prescribe at once while all feet stay where they are.

# In the order in which they are wanted: without the first two nothing balances, without the third no knee works.
_WANTED = ("x", "y", "height")
_STEERING_TURNS = ("roll", "pitch", "yaw")
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
    wanted = dict(zip((*_WANTED, *_STEERING_TURNS), (com[0], com[1], *pelvis[2:]), strict=True))
    trunk = [name for name in _WANTED if chosen.takes(wanted[name][moving])]
    turns = list(_STEERING_TURNS)
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
