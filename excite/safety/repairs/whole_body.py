"""Balance by kinematics: a path on which feet and centre of mass are where they belong."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.generators.bodyparts import support_corners
from excite.motion.generators.candidate import Candidate, SupportPhase
from excite.motion.generators.curves import SplineCurve
from excite.robot.shapes.support_area import has_area
from excite.safety.repairs.balancer import Balancer
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.path import MotionPath, coordinates_of
from excite.safety.repairs.shrinking import milder_candidates
from excite.safety.repairs.waypoints import SAMPLES_PER_SPAN
from excite.safety.repairs.zmp_following import follow_zmp

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
        if not all(has_area(self._corners(phase)) for phase in candidate.phases):
            return draft.rejected("no_support", "feet")
        s = path_grid(candidate)
        q = np.tile(self.robot.rest, (len(s), 1))
        q[:, self.robot.n_base_q :] = candidate.posture.evaluate(s)
        for k in range(1 if candidate.zmp is None else 1 + _CORRECTIONS):
            if k:
                candidate = follow_zmp(self.robot, candidate, s, q)
            solved = len(s) if self._balancer is None else self._balancer.solve(candidate, s, q)
            if solved < len(s):
                return draft.rejected("unreachable", "legs", posture=q[max(solved - 1, 0)])
            if self.robot.closing is not None:
                try:
                    q[:] = self.robot.closing.closed(q)
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
                    "joint_position",
                    self.robot.joint_names[joint],
                    value=value,
                    limit=float(limit),
                    posture=q[row],
                )
        foot = self._grounded(candidate, s, q)
        if foot is not None:
            return draft.rejected("foot_ground", foot[0], posture=foot[1])
        collision = self.probe.first(q)
        if collision is not None:
            near = self.probe.closest(q[collision:])
            return draft.rejected(
                "self_collision", near.pair, value=near.distance, limit=near.required, posture=near.posture
            )
        return replace(draft, path=MotionPath(self.robot, s, coordinates_of(self.robot, q)))

    def _corners(self, phase: SupportPhase) -> Array:
        return support_corners(self.robot, [self.robot.foot(name) for name in phase.feet])

    def _grounded(self, candidate: Candidate, s: Array, q: Array) -> tuple[str, Array] | None:
        """Name of a free foot that goes below the ground, and the configuration in which it does."""
        data = self.robot.model.createData()
        for foot in self.robot.feet:
            free = ~candidate.supports(s, foot.name)
            for row in q[free]:
                pin.forwardKinematics(self.robot.model, data, row)
                pose = data.oMi[foot.joint]
                if (foot.sole @ pose.rotation[2] + pose.translation[2]).min() < -_GROUND:
                    return foot.name, row
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
