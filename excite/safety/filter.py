"""The safety filter: repairs in order, then the independent verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import replace
from functools import cached_property, lru_cache
from importlib.metadata import version
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
import scipy
from scipy.linalg import solve_banded

from excite.arrays import Array
from excite.errors import MotionError
from excite.motion.content import with_verdict
from excite.motion.generators.curves import Curve, PolynomialCurve, SplineCurve, hermite_curve
from excite.motion.generators.generator import Candidate, Proposal, SupportPhase, rest_joints, support_corners
from excite.motion.generators.mixture import draw_candidate
from excite.motion.motion import Motion, MotionMetadata
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent
from excite.robot.robot import Robot
from excite.robot.shapes.collision import collision_model
from excite.robot.shapes.shape import has_area
from excite.safety.check import check_motion
from excite.safety.filter_report import FilterOutcome, FilterReport, count_outcomes
from excite.safety.ground_forces import wrench_at_world_origin, zero_moment_point
from excite.safety.parameter_set import stated_parameters
from excite.safety.repairs.balancer import Balancer
from excite.safety.repairs.collisions import CollisionProbe
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.path import MotionPath, coordinates_of, run_path
from excite.safety.repairs.retiming import Retiming, Transfer, plan_transfer
from excite.safety.repairs.shares import Shares
from excite.safety.repairs.time_scaling import TimeScaling
from excite.safety.repairs.waypoints import SAMPLES_PER_SPAN, Waypoints
from excite.safety.verdict import Verdict

# What a caller makes of an accepted motion, in the process that made it; has to be picklable, and so has the answer.
Keep = Callable[[Robot, Motion], Any]


class SafetyFilter:
    """Repairs and verdict of one robot, kept ready because they are dear to build."""

    def __init__(self, robot: Robot, *, robust: bool = False) -> None:
        self._robot, self._robust = robot, robust
        shares = Shares(robots=stated_parameters(robot)) if robust else Shares()
        self._repairs = make_repairs(robot, shares)

    def filter(self, candidate: Candidate | Motion) -> FilterOutcome:
        """Repair a candidate and judge the motion that results; a motion is judged as it is."""
        seconds: dict[str, float] = {}
        if isinstance(candidate, Motion):
            return self._judged(candidate.metadata.generator, candidate, seconds)
        draft: Draft | Rejection = Draft(candidate)
        for repair in self._repairs:
            if isinstance(draft, Rejection):
                break
            start = time.process_time()
            draft = repair.repair(draft)
            seconds[repair.name] = time.process_time() - start
        if isinstance(draft, Rejection):
            return FilterOutcome(candidate.name, candidate.generator, None, None, draft, seconds)
        if draft.motion is None:
            rejection = draft.rejected("no_motion", "repairs")
            return FilterOutcome(candidate.name, candidate.generator, None, None, rejection, seconds)
        return self._judged(candidate.generator, draft.motion, seconds)

    def _judged(self, generator: str, motion: Motion, seconds: dict[str, float]) -> FilterOutcome:
        start = time.process_time()
        verdict = check_motion(self._robot, motion, robust=self._robust)
        seconds["check"] = time.process_time() - start
        return FilterOutcome(
            candidate=motion.name,
            generator=generator,
            motion=with_verdict(motion, verdict.to_json(), self._robot.hash) if verdict.safe else None,
            verdict=verdict,
            rejection=_rejection_of(motion.name, verdict),
            seconds=seconds,
            postures=tuple(_posture_at(motion, item.time_s) for item in verdict.violations),
        )


# What the filter takes: a proposal is drawn first; a motion, whose maker has kept the limits, is judged as it is.
Filtered = Candidate | Proposal | Motion


def filter_candidate(robot: Robot, candidate: Filtered, *, robust: bool = False) -> FilterOutcome:
    """Make one candidate safe, or say why that failed.

    Args:
        robot: the robot.
        candidate: the candidate, or what one may be in place of it.
        robust: whether torque, zero-moment point and friction shall hold for all robots of the set that the
            description states.

    Returns:
        The motion and its verdict, or the rejection. Repairs never judge: a motion is accepted only if the
        independent check finds it safe.

    Raises:
        RobotError: the robot's collision geometry cannot be read.
    """
    if not isinstance(candidate, Proposal):
        return _filter_of(robot, robust).filter(candidate)
    start = time.process_time()
    drawn = draw_candidate(robot, candidate)
    seconds = {"draw": time.process_time() - start}
    outcome = _filter_of(robot, robust).filter(drawn)
    return replace(outcome, seconds={**seconds, **outcome.seconds})


def filter_candidates(
    robot: Robot,
    candidates: Iterable[Filtered],
    *,
    jobs: Jobs = 1,
    total: int | None = None,
    progress: Progress = silent,
    keep: Keep | None = None,
    partial: bool = False,
    robust: bool = False,
) -> FilterReport:
    """Make candidates safe, in several processes.

    Args:
        robot: the robot.
        candidates: candidates, or proposals, which are drawn where they are judged, or motions; read as work proceeds.
        jobs: number of processes, or an executor. The outcomes do not depend on it.
        total: how many candidates, where they do not say.
        progress: told after each candidate, stage ``filter``.
        keep: called with the robot and each accepted motion where that was made; its answer stands in the report
            in place of all outcomes, so that memory need not grow with the number of candidates.
        partial: where the user interrupts, report what was judged by then instead of passing the interrupt on.
        robust: as of :func:`filter_candidate`.

    Returns:
        What became of the candidates, in their order.

    Raises:
        InputError: ``jobs`` is not what it may be.
        RobotError: the robot's collision geometry cannot be read.
    """
    if total is None and isinstance(candidates, Sized):
        total = len(candidates)
    if jobs != 1:
        # Broken geometry shall raise here, before it is read by every worker.
        collision_model(robot)
    outcomes = in_order(
        _filter_one,
        candidates,
        jobs=jobs,
        shared=(robot, keep, robust),
        total=total,
        stage="filter",
        progress=progress,
    )
    return count_outcomes(robot, outcomes, whole=keep is None, partial=partial)


@lru_cache(maxsize=4)
def _filter_of(robot: Robot, robust: bool) -> SafetyFilter:
    return SafetyFilter(robot, robust=robust)


def _rejection_of(name: str, verdict: Verdict) -> Rejection | None:
    """The rejection that a verdict means; reasons from the check start with ``check_``."""
    if verdict.safe:
        return None
    if verdict.violations:
        first = verdict.violations[0]
        return Rejection(name, f"check_{first.kind}", first.where, first.time_s, first.value, first.limit)
    return Rejection(name, "check_not_computed", ", ".join(verdict.not_computed))


def _posture_at(motion: Motion, time_s: float | None) -> tuple[float, ...] | None:
    """Configuration of a motion at a time, None where it has none."""
    if time_s is None:
        return None
    index = int(np.argmin(np.abs(motion.time - time_s)))
    return tuple(float(x) for x in motion.q[index])


def _handed_over(robot: Robot, outcome: FilterOutcome, keep: Keep | None) -> FilterOutcome:
    if keep is None or not outcome.accepted or outcome.motion is None:
        return outcome
    return replace(outcome, motion=None, kept=keep(robot, outcome.motion))


def _filter_one(shared: tuple[Robot, Keep | None, bool], candidate: Filtered) -> FilterOutcome:
    robot, keep, robust = shared
    return _handed_over(robot, filter_candidate(robot, candidate, robust=robust), keep)


# From path and time law to the samples of a motion.

_VERSIONS = ("excite", "pin", "placo", "toppra", "ruckig", "numpy", "scipy")
# A start this far from rest needs a transfer [rad or m].
_NEAR = 1e-9


class Sampling(Repair):
    """Samples the motion at the robot's rate, with a transfer from and to rest where it starts elsewhere."""

    name: ClassVar[str] = "sampling"

    @cached_property
    def _versions(self) -> dict[str, str]:
        return {package: version(package) for package in _VERSIONS}

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft with a motion, or the rejection ``self_collision`` of a transfer."""
        if draft.path is None or draft.law is None:
            return draft.rejected("no_time_law", "path")
        rate = self.robot.description.sensors.rate_hz
        moved = run_path(draft.path, draft.law, rate)
        time, q, v, a = moved.time, moved.q, moved.v, moved.a
        contacts = {foot.name: draft.candidate.supports(moved.s, foot.name) for foot in self.robot.feet}
        rest = rest_joints(self.robot)
        if not self.robot.floating and np.abs(q[0] - rest).max() > _NEAR:
            there, back = (
                plan_transfer(self.robot, rest, q[0], rate),
                plan_transfer(self.robot, q[-1], rest, rate),
            )
            for part in (there, back):
                ways = part.q if self.robot.closing is None else self.robot.closing.closed(part.q)
                collision = self.probe.first(ways)
                if collision is not None:
                    near = self.probe.closest(ways[collision:])
                    return draft.rejected(
                        "self_collision",
                        f"transfer, {near.pair}",
                        value=near.distance,
                        limit=near.required,
                        posture=near.posture,
                    )
            q, v, a = _join_phases(there, (q, v, a), back)
            if self.robot.closing is not None:
                q, v, a = self.robot.closing.completed(q, v, a)
            time = np.arange(len(q)) / rate
        candidate = draft.candidate
        motion = Motion(
            name=candidate.name,
            robot=self.robot.name,
            joint_names=self.robot.joint_names,
            time=time,
            q=q,
            v=v,
            a=a,
            contacts=contacts,
            metadata=MotionMetadata(
                generator=candidate.generator,
                seed=candidate.seed,
                targets=candidate.targets,
                robot_hash=self.robot.hash,
                versions=self._versions,
            ),
        )
        return replace(draft, motion=motion)


def _join_phases(there: Transfer, middle: tuple[Array, Array, Array], back: Transfer) -> list[Array]:
    """Positions, velocities and accelerations one after the other, shared samples once."""
    parts = ((there.q, there.v, there.a), middle, (back.q, back.v, back.a))
    return [np.vstack([parts[0][k][:-1], parts[1][k], parts[2][k][1:]]) for k in range(3)]


# Balance by kinematics: a path on which feet and centre of mass are where they belong.

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


# All repairs, in the order in which they run: cheap rejections first. A new one is one file and its line
# here.

REPAIRS: dict[str, type[Repair]] = {
    repair.name: repair
    for repair in (
        Waypoints,
        WholeBody,
        Retiming,
        TimeScaling,
        Sampling,
    )
}


def make_repairs(robot: Robot, shares: Shares | None = None) -> list[Repair]:
    """One of each, ready for a robot.

    Args:
        robot: the robot.
        shares: how much of each limit to use; the default leaves the verdict a margin.
    """
    probe, shares = CollisionProbe(robot), shares or Shares()
    return [repair(robot, probe, shares) for repair in REPAIRS.values()]
