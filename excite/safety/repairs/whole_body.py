"""Balance by kinematics: base and legs that keep feet and centre of mass where they belong (placo)."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from defusedxml.ElementTree import fromstring
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.motion.generators.bodyparts import leg_joints, pelvis_joint
from excite.motion.generators.candidate import Candidate
from excite.motion.generators.curves import SplineCurve
from excite.robot.robot import Robot
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.path import MotionPath, coordinates_of
from excite.safety.repairs.shrinking import shrunk
from excite.safety.repairs.waypoints import SAMPLES_PER_SPAN
from excite.safety.repairs.zmp_following import following

# Samples of a Fourier series: per second of its own time.
_SAMPLES_PER_SECOND = 40.0
# The same of a walk, and how often its centre of mass is corrected.
_WALK_SAMPLES_PER_SECOND, _CORRECTIONS = 80.0, 3
_TOLERANCE = 1e-9
_ITERATIONS = 12
# A free sole's corners may come this close to the ground [m].
_GROUND = 1e-3
# Distance from the position limits that the path keeps at its knots [rad or m].
_LIMIT = 1e-3


class WholeBody(Repair):
    """Finds base and legs along the path; upper-body joints, feet and centre of mass are as asked for.

    Feet (six coordinates each), the horizontal centre of mass and the pelvis's height and orientation are hard
    tasks: as many as there are free coordinates for two six-joint legs, so that the solution is a smooth
    function of the path. A robot without feet keeps its base where it rests.
    """

    name: ClassVar[str] = "whole_body"

    @cached_property
    def _balancer(self) -> _Balancer | None:
        return _Balancer(self.robot) if self.robot.feet else None

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft with a path; or ``unreachable``, ``joint_position``, ``self_collision``, ``foot_ground``."""
        outcome = self._attempt(draft)
        for smaller in shrunk(draft.candidate):
            if isinstance(outcome, Draft):
                break
            outcome = self._attempt(replace(draft, candidate=smaller))
        return outcome

    def _attempt(self, draft: Draft) -> Draft | Rejection:
        candidate = draft.candidate
        s = path_grid(candidate)
        q = np.tile(self.robot.rest, (len(s), 1))
        q[:, self.robot.n_base_q :] = candidate.posture.evaluate(s)
        for k in range(1 if candidate.zmp is None else 1 + _CORRECTIONS):
            if k:
                candidate = following(self.robot, candidate, s, q)
            if self._balancer is not None and self._balancer.solve(candidate, s, q) < len(s):
                return draft.rejected("unreachable", "legs")
            low, high = self.robot.limits.position_lower, self.robot.limits.position_upper
            joints = q[:, self.robot.n_base_q :]
            outside = (joints < low + _LIMIT) | (joints > high - _LIMIT)
            if outside.any():
                row, joint = np.argwhere(outside)[0]
                value = float(joints[row, joint])
                limit = low[joint] if value < low[joint] + _LIMIT else high[joint]
                return draft.rejected(
                    "joint_position", self.robot.joint_names[joint], value=value, limit=float(limit)
                )
        foot = self._grounded(candidate, s, q)
        if foot is not None:
            return draft.rejected("foot_ground", foot)
        collision = self.probe.first(q)
        if collision is not None:
            pair, distance, required = self.probe.closest(q[collision])
            return draft.rejected("self_collision", pair, value=distance, limit=required)
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


def _without_shapes(urdf: str) -> str:
    """The URDF without visual and collision elements: placo would read every mesh, 250 MB on a G1."""
    root = fromstring(urdf)
    for link in root.iter("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    return ElementTree.tostring(root, encoding="unicode")


class _Balancer:
    """placo's kinematics solver with hard tasks, and the targets that they follow."""

    def __init__(self, robot: Robot) -> None:
        import placo

        self._robot = robot
        self._wrapper = placo.RobotWrapper(
            "", int(placo.Flags.ignore_collisions), _without_shapes(robot.urdf)
        )
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
        for joint in names[2:]:
            if joint not in legs:
                solver.mask_dof(joint)
        self._feet = {}
        for foot in robot.feet:
            pose = np.array(self._wrapper.get_T_world_frame(foot.link))
            task = solver.add_frame_task(foot.link, pose)
            task.configure(foot.name, "hard", 1.0, 1.0)
            self._feet[foot.name] = (task, pose, self._sole(foot.joint, foot.placement))
        self._com_rest = np.array(self._wrapper.com_world())
        self._com = solver.add_com_task(self._com_rest)
        self._com.mask.set_axises("xy")
        self._com.configure("com", "hard", 1.0)
        pelvis = robot.segments[pelvis_joint(robot) - 1].link
        self._pelvis_rest = np.array(self._wrapper.get_T_world_frame(pelvis))
        self._turn = solver.add_orientation_task(pelvis, self._pelvis_rest[:3, :3])
        self._turn.configure("pelvis_orientation", "hard", 1.0)
        self._height = solver.add_position_task(pelvis, self._pelvis_rest[:3, 3])
        self._height.mask.set_axises("z")
        self._height.configure("pelvis_height", "hard", 1.0)
        self._solver = solver
        # Targets as every later solve leaves them: placo rounds a pose that it is handed.
        self._reset_feet()

    def _sole(self, joint: int, placement: pin.SE3) -> Array:
        data = self._robot.model.createData()
        pin.forwardKinematics(self._robot.model, data, self._robot.rest)
        return np.array(data.oMi[joint].act(placement.translation))

    def _set(self, q: Array) -> None:
        self._wrapper.state.q = q
        self._wrapper.update_kinematics()

    def solve(self, candidate: Candidate, s: Array, q: Array) -> int:
        """Fill in base and legs of ``q`` ``(n, nq)`` row by row; returns the number of rows that were solved."""
        pelvis = np.zeros((len(s), 4)) if candidate.pelvis is None else candidate.pelvis.evaluate(s)
        com = np.zeros((len(s), 2)) if candidate.com is None else candidate.com.evaluate(s)
        turn = Rotation.from_euler("xyz", pelvis[:, 1:]).as_matrix() @ self._pelvis_rest[:3, :3]
        moved = {name: curve.evaluate(s) for name, curve in candidate.feet.items()}
        guess = self._rest.copy()
        before = guess.copy()
        n_base = self._robot.n_base_q
        free = np.setdiff1d(np.arange(len(self._rest)), self._index[n_base:])
        legs = [i for foot in self._robot.feet for i in leg_joints(self._robot, foot)]
        free = np.r_[free, self._index[n_base:][legs]]
        for i in range(len(s)):
            start = guess.copy()
            start[self._index[n_base:]] = q[i, n_base:]
            # Carry on as in the step before; the base turns little enough for that to be a guess.
            start[free] = 2.0 * guess[free] - before[free]
            start[3:7] /= np.linalg.norm(start[3:7])
            self._com.target_world = self._com_rest + np.r_[com[i], 0.0]
            self._turn.R_world_frame = turn[i]
            self._height.target_world = self._pelvis_rest[:3, 3] + np.array([0.0, 0.0, pelvis[i, 0]])
            for name, curve in moved.items():
                task, pose, sole = self._feet[name]
                task.T_world_frame = _displaced(pose, sole, curve[i])
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
        for task, pose, _ in self._feet.values():
            task.T_world_frame = pose


def _displaced(pose: Array, sole: Array, displacement: Array) -> Array:
    """A foot's pose moved by a translation, and turned by a rotation vector about its sole's centre."""
    turn = Rotation.from_rotvec(displacement[3:]).as_matrix()
    moved = np.eye(4)
    moved[:3, :3] = turn @ pose[:3, :3]
    moved[:3, 3] = sole + displacement[:3] + turn @ (pose[:3, 3] - sole)
    return moved
