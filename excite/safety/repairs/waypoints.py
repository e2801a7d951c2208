"""Throw out control points where the robot would hit itself or could not hold still, before anything dear is done."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.generators.curves import Curve, SplineCurve
from excite.motion.generators.generator import Candidate, Draws
from excite.robot.legs import holding_torques, usable_torque
from excite.safety.repairs.draft import Draft, Rejection, Repair, refused_by
from excite.safety.repairs.retiming import SHARE_USED

# Samples in a span; a span takes 0.2 s or more, and between samples the probe's extra margin holds.
SAMPLES_PER_SPAN = 12
# Draws at one control point before stepping back to the one before, and in all.
_TRIES, _BUDGET = 25, 500
# From this try on draws are pulled towards rest, ever harder.
_FREE_TRIES, _PULL = 10, 0.88
_SHRINK, _SHRINK_TRIES = 0.85, 10


class Waypoints(Repair):
    """Redraws control points whose span collides, or cannot be held against gravity, with the base and legs at rest.

    However slowly a path is run, it takes the torque that holds the robot still on it. A control point of a uniform
    cubic B-spline completes one span, so the check of a span is the check of the very path that will be run. Curves
    whose points must not be redrawn are shrunk about their start.
    """

    name: ClassVar[str] = "waypoints"
    # Posture that the last search refused, and the joint that is too weak for it, None where it collides.
    _last: Array | None = None
    _weak: int | None = None
    # What says that a mechanism cannot follow, where the last search ended so.
    _stuck: MotionError | None = None

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft whose posture is free, or the rejection ``self_collision``, ``joint_torque`` or ``mechanism``."""
        self._last = self._weak = self._stuck = None
        candidate = draft.candidate
        if isinstance(candidate.posture, SplineCurve) and candidate.draws is not None:
            walk = _Walk(self, candidate, candidate.posture, candidate.draws)
            posture: Curve | None = walk.run()
        else:
            posture = self._shrink(candidate)
        if posture is None:
            return self._refused(draft)
        return replace(draft, candidate=replace(candidate, posture=posture))

    def _refused(self, draft: Draft) -> Rejection:
        """The rejection, by the weak joint of the last posture that was tried, or the pair that lacked most of its
        distance in it."""
        if self._stuck is not None:
            return draft.rejected("mechanism", self._stuck.field or "loops")
        if self._last is None:
            return draft.rejected("self_collision", "control points")
        if self._weak is not None:
            strain = float(self._strain(self._last[None])[0, self._weak])
            joint = self.robot.joint_names[self._weak]
            return draft.rejected("joint_torque", joint, value=strain, limit=1.0, unit=SHARE_USED)
        return refused_by(draft, self.probe.closest(self._last[None]))

    def _shrink(self, candidate: Candidate) -> Curve | None:
        curve = candidate.posture
        for _ in range(_SHRINK_TRIES):
            if self.free(curve.evaluate(np.linspace(0.0, curve.length, 300))):
                return curve
            curve = curve.shrunk(_SHRINK)
        return None

    def free(self, joints: Array) -> bool:
        """Whether joint positions ``(n, n_joints)`` do not collide with the base at rest, and can be held."""
        q = np.tile(self.robot.rest, (len(joints), 1))
        q[:, self.robot.n_base_q :] = joints
        try:
            q = self._closed(q)
            strain = self._strain(q)
        except MotionError as error:
            self._stuck = error
            return False
        self._stuck = None
        if strain.max(initial=0.0) > 1.0:
            row, self._weak = (int(k) for k in np.unravel_index(int(strain.argmax()), strain.shape))
            self._last = q[row]
            return False
        collides = self.probe.first(q)
        if collides is not None:
            self._last, self._weak = q[collides], None
        return collides is None

    def _closed(self, q: Array) -> Array:
        """The configurations with joints that follow where they follow to; raises MotionError."""
        if self.robot.closing is None:
            return q
        q, limits = self.robot.closing.close_configurations(q), self.robot.limits
        joints = q[:, self.robot.n_base_q :]
        outside = ((joints < limits.position_lower) | (joints > limits.position_upper)).any(axis=0)
        if outside.any():
            name = self.robot.joint_names[int(np.argmax(outside))]
            raise MotionError("would have to pass its limits", field=f"joint {name!r}")
        return q

    def _strain(self, q: Array) -> Array:
        """Torque that holds each joint in configurations ``(n, nq)``, of what it may use, ``(n, n_joints)``."""
        torques = holding_torques(self.robot, q[:, self.robot.n_base_q :], self._data)
        return np.asarray(np.abs(torques) / self._usable)

    @cached_property
    def _data(self) -> pin.Data:
        return self.robot.model.createData()

    @cached_property
    def _usable(self) -> Array:
        share = np.full(self.robot.n_joints, self.shares.torque)
        return usable_torque(self.robot, share, self.shares.velocity * self.robot.limits.velocity)


class _Walk:
    """Control points in order, each redrawn until its span is free, with steps back out of dead ends."""

    def __init__(self, owner: Waypoints, candidate: Candidate, curve: SplineCurve, draws: Draws) -> None:
        self._owner, self._draws = owner, draws
        self._control = curve.control.copy()
        self._rest = curve.control[0]
        self._rng = np.random.default_rng([candidate.seed, 1])
        self._tries = np.zeros(len(self._control), dtype=int)

    def run(self) -> SplineCurve | None:
        """The free curve, or None if there is none within the budget."""
        i, spent, back = 3, 0, 1
        while i < len(self._control):
            drawn = self._draws.first <= i < self._draws.stop
            if self._free(i):
                i += 1
                continue
            spent += 1
            if spent > _BUDGET:
                return None
            if drawn and self._tries[i] < _TRIES:
                self._redraw(i)
                continue
            # A dead end: further and further back, until a way out is found.
            self._tries[i] = 0
            i = max(self._draws.first, min(i, self._draws.stop) - back)
            back = min(back + 1, 5)
            self._redraw(i)
        return SplineCurve(self._control)

    def _redraw(self, i: int) -> None:
        pull = _PULL ** max(0, int(self._tries[i]) - _FREE_TRIES)
        self._control[i] = self._rest + pull * (self._draws.draw(self._rng) - self._rest)
        self._tries[i] += 1

    def _free(self, i: int) -> bool:
        """Whether the point, the way to it and the span that it completes are free, cheapest first."""
        control = self._control
        u = np.linspace(1.0, 0.0, 6, endpoint=False)[:, None]
        if not self._owner.free(control[i - 1] + u * (control[i] - control[i - 1])):
            return False
        span = SplineCurve(control[i - 3 : i + 1])
        return self._owner.free(span.evaluate(np.linspace(0.0, 1.0, SAMPLES_PER_SPAN, endpoint=False)))
