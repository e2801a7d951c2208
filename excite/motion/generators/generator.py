"""What every generator of excitation motions is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import pinocchio as pin
import scipy

from excite.arrays import Array, Flags
from excite.errors import RobotError
from excite.motion.generators.curves import Curve
from excite.robot.robot import Foot, Robot
from excite.robot.shapes.shape import has_area, joints_at


class Generator(ABC):
    """Proposes candidates; each depends only on the robot, its own seed and its targets.

    Attributes:
        name: name in the registry.
        summary: one line for lists of generators.
        needs: what a robot must have for it to apply, as the end of a sentence; empty where it always does.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    needs: ClassVar[str] = ""

    @abstractmethod
    def applies(self, robot: Robot) -> bool:
        """Whether the generator has anything to propose for this robot."""

    @abstractmethod
    def aims(self, robot: Robot) -> tuple[str, ...]:
        """Joints that this generator can aim at, in the order in which a plan goes through them."""

    @abstractmethod
    def draw(self, robot: Robot, seed: int, targets: tuple[str, ...], name: str) -> Candidate:
        """The candidate of one seed, aimed at the joints ``targets`` (none of them unknown)."""

    def candidates(
        self, robot: Robot, count: int, seed: np.random.SeedSequence, targets: Sequence[str] = ()
    ) -> list[Candidate]:
        """Draw ``count`` candidates, aimed at each of the targets in turn.

        Args:
            robot: the robot.
            count: how many.
            seed: candidate ``i`` comes from its child ``i``, whatever was spawned before.
            targets: joints to aim at in turn; all that the generator can aim at, if empty.

        Raises:
            UnknownNameError: a target is no joint of the robot.
            RobotError: the generator does not apply to the robot.
        """
        drawn = self.proposals(robot, count, seed, targets)
        return [self.draw(robot, item.seed, item.targets, item.name) for item in drawn]

    def proposals(
        self, robot: Robot, count: int, seed: np.random.SeedSequence, targets: Sequence[str] = ()
    ) -> Iterator[Proposal]:
        """What :meth:`candidates` draws, not drawn yet; same arguments and errors."""
        aims = tuple(targets) or (self.aims(robot) if self.applies(robot) else ())
        if not aims or not self.applies(robot):
            why = f": {self.needs}" if self.needs else ""
            raise RobotError(f"generator {self.name!r} does not apply to it{why}", source=robot.name)
        for joint in targets:
            robot.joint_index(joint)
        return (
            Proposal(self.name, child_seed(seed, i), (aims[i % len(aims)],), f"{self.name}_{i:03d}")
            for i in range(count)
        )


def child_seed(seed: np.random.SeedSequence, index: int) -> int:
    """The integer seed of child ``index``; unlike ``spawn`` it leaves ``seed`` as it is."""
    child = np.random.SeedSequence(seed.entropy or 0, spawn_key=(*seed.spawn_key, index))
    high, low = child.generate_state(2, np.uint32)
    # Below 2⁵³, so that every JSON reader keeps it exactly.
    return (int(high) & 0x1FFFFF) << 32 | int(low)


# A candidate: the geometry of a motion, before anything made it safe or gave it a time law.


@dataclass(frozen=True)
class SupportPhase:
    """A part of the path during which the same feet carry the robot.

    Attributes:
        start: path parameter at which it starts.
        end: path parameter at which it ends.
        feet: names of the feet on the ground.
        rate: largest rate of the path parameter in it [1/s].
    """

    start: float
    end: float
    feet: tuple[str, ...]
    rate: float = float("inf")


def all_feet(robot: Robot, length: float) -> tuple[SupportPhase, ...]:
    """One phase on all feet, of a path of that length; none for a robot without feet."""
    feet = tuple(foot.name for foot in robot.feet)
    return (SupportPhase(0.0, length, feet),) if feet else ()


@dataclass(frozen=True, eq=False)
class Draws:
    """The box from which control points are drawn, and redrawn when they collide.

    Attributes:
        lower: ``(n_joints,)`` [rad or m].
        upper: ``(n_joints,)`` [rad or m].
        first: index of the first control point that may be redrawn.
        stop: index after the last control point that may be redrawn.
    """

    lower: Array
    upper: Array
    first: int
    stop: int

    def draw(self, rng: np.random.Generator) -> Array:
        """One control point: a coordinate is near the box's ends more often than in its middle.

        The arcsine law gives back the spread that the spline's averaging takes away.
        """
        share = 0.5 - 0.5 * np.cos(np.pi * rng.uniform(size=len(self.lower)))
        return self.lower + share * (self.upper - self.lower)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A motion as a generator proposes it: curves over one common path parameter.

    Of a robot with feet the leg columns of ``posture`` are ignored: the whole-body repair finds legs and
    base from pelvis, centre of mass and feet.

    Attributes:
        name: unique within a plan.
        generator: registry name of its generator.
        targets: joints that it is aimed at.
        seed: seed from which generator and targets reproduce it.
        posture: actuated joints [rad or m].
        speed: rate of the path parameter [1/s] where the curves are meant to be run at a certain speed
            (Fourier series: 1); None where they are to be run as fast as the limits allow.
        draws: where ``posture``'s control points came from; None where they must not be redrawn.
        pelvis: offset of the base from its rest pose: height [m], then roll, pitch, yaw [rad]; None: no offset.
        com: horizontal offset of the centre of mass from that at rest, x and y [m]; None: no offset.
        zmp: of a walk, which keeps its balance at ``speed`` only: where the zero-moment point shall be, as a
            horizontal offset from where the centre of mass rests [m]; ``com`` is then a first guess. None elsewhere.
        feet: by foot name, displacement of the sole from where it rests: translation in the world [m], then
            rotation vector [rad]; feet left out stay where they are.
        phases: which feet carry the robot, in order, covering the path; empty for a robot without feet.
    """

    name: str
    generator: str
    targets: tuple[str, ...]
    seed: int
    posture: Curve
    speed: float | None = None
    draws: Draws | None = None
    pelvis: Curve | None = None
    com: Curve | None = None
    zmp: Curve | None = None
    feet: Mapping[str, Curve] = field(default_factory=dict)
    phases: tuple[SupportPhase, ...] = ()

    @property
    def length(self) -> float:
        """End of the path parameter's interval, which starts at 0."""
        return self.posture.length

    def supports(self, s: Array, foot: str) -> np.ndarray:
        """Whether a foot carries load at path parameters ``(n,)``; both ends of a phase belong to it."""
        carried = np.zeros(len(s), dtype=bool)
        for phase in self.phases:
            if foot in phase.feet:
                carried |= (s >= phase.start) & (s <= phase.end)
        return carried


@dataclass(frozen=True, slots=True)
class Proposal:
    """All that a candidate depends on, besides the robot: it can be drawn anywhere, any number of times.

    Attributes:
        generator: registry name of its generator.
        seed: of all its random numbers.
        targets: joints that it is aimed at.
        name: unique within a plan.
    """

    generator: str
    seed: int
    targets: tuple[str, ...]
    name: str


# Share of a support polygon's inradius that the centre of mass keeps from its edges while a foot is in the air: it has
# to keep away from two edges at once, and a load on the trunk that the model does not know moves it.
_DEEP = 0.75


def pelvis_joint(robot: Robot) -> int:
    """Model joint that carries the body from which the legs part: the base's unless the base is a trunk."""
    chains = [set(robot.model.supports[foot.joint]) for foot in robot.feet]
    shared = set.intersection(*chains) if len(chains) > 1 else {1}
    return int(max(shared))


def pelvis_height(robot: Robot) -> float:
    """Height at rest of the frame of that body, or of its hips, if they are higher [m].

    Generators scale what they do to legs by it. A frame may lie anywhere in its body: some files put that of a free
    base on the ground between the feet.
    """
    data = joints_at(robot.model, robot.rest)
    first = 2 if robot.floating else 1
    hips = [leg[0] + first for foot in robot.feet if (leg := leg_joints(robot, foot))]
    return float(max(data.oMi[joint].translation[2] for joint in (pelvis_joint(robot), *hips)))


def leg_joints(robot: Robot, foot: Foot) -> tuple[int, ...]:
    """Indices into ``joint_names`` of the joints between pelvis and foot, from the pelvis on."""
    pelvis = set(robot.model.supports[pelvis_joint(robot)])
    chain = [int(joint) for joint in robot.model.supports[foot.joint]]
    first = 2 if robot.floating else 1
    return tuple(joint - first for joint in chain if joint >= first and joint not in pelvis)


def alternating_joints(robot: Robot, feet: Sequence[Foot]) -> tuple[str, ...]:
    """Names of the joints of legs, the first of each leg in turn, then the second; legs may have unlike numbers."""
    legs = [leg_joints(robot, foot) for foot in feet]
    longest = max(map(len, legs), default=0)
    return tuple(robot.joint_names[leg[k]] for k in range(longest) for leg in legs if k < len(leg))


def upper_body(robot: Robot) -> Flags:
    """Which joints are in no leg, ``(n_joints,)``; of a robot without feet all but those that follow from others."""
    upper = np.ones(robot.n_joints, dtype=bool)
    if robot.closing is not None:
        upper[robot.closing.passive - robot.n_base_v] = False
    for foot in robot.feet:
        upper[list(leg_joints(robot, foot))] = False
    return upper


def free_upper_body(robot: Robot) -> Flags:
    """The upper body less the joints between base and pelvis, ``(n_joints,)``.

    Where the base is a trunk, those move the feet unless the base moves along.
    """
    free = upper_body(robot)
    if robot.feet:
        free[[joint - 2 for joint in robot.model.supports[pelvis_joint(robot)] if joint >= 2]] = False
    return free


def support_corners(robot: Robot, feet: Sequence[Foot]) -> Array:
    """Corners of soles at rest, seen from above, ``(n_corners, 2)`` [m]."""
    data = joints_at(robot.model, robot.rest)
    corners = [data.oMi[foot.joint].act(corner)[:2] for foot in feet for corner in foot.sole]
    return np.array(corners).reshape(-1, 2)


def sole_half_width(foot: Foot) -> float:
    """Distance of a sole's middle from its nearest edge [m]; corners of rounded soles lie nearer to its middle line."""
    corners = (foot.sole - foot.placement.translation) @ foot.placement.rotation[:, :2]
    return float(-_hull_edges(corners)[:, 2].max())


def stands_on_either(robot: Robot) -> bool:
    """Whether a robot has two feet, and soles on each of which it can stand."""
    return len(robot.feet) == 2 and all(has_area(support_corners(robot, [foot])) for foot in robot.feet)


def _hull_edges(corners: Array) -> Array:
    """Edges of the hull of points ``(n, 2)`` as rows ``n_x, n_y, c``: ``n·x + c ≤ 0`` inside, n of length one."""
    return np.asarray(scipy.spatial.ConvexHull(corners).equations)


def base_shift(robot: Robot, shift: Array, roll: float) -> Array:
    """How far the base goes where the centre of mass does by ``shift`` ``(2,)`` over feet that stay, ``(2,)`` [m].

    What is above the pelvis goes with it, and further as it rolls by ``roll`` [rad]; what is below goes the less, the
    nearer it is to the ground.
    """
    data, model = joints_at(robot.model, robot.rest), robot.model
    pelvis, masses = pelvis_height(robot), np.array([inertia.mass for inertia in model.inertias[1:]])
    centres = zip(data.oMi[1:], model.inertias[1:], strict=True)
    heights = np.array([place.act(inertia.lever)[2] for place, inertia in centres])
    along = float(masses @ np.clip(heights / pelvis, 0.0, 1.0)) / robot.mass
    leant = float(masses @ np.maximum(heights - pelvis, 0.0)) / robot.mass * np.sin(roll)
    return np.asarray((shift + np.array([0.0, leant])) / along)


def support_reach(robot: Robot, feet: Sequence[Foot]) -> float:
    """Distance at rest of the centre of mass from the edge of a support polygon, seen from above [m]."""
    centre = np.array(pin.centerOfMass(robot.model, robot.model.createData(), robot.rest))[:2]
    edges = _hull_edges(support_corners(robot, feet))
    return float(-(edges[:, :2] @ centre + edges[:, 2]).max())


def support_centre(robot: Robot, feet: Sequence[Foot], near: Array) -> Array:
    """Where the centre of mass shall be over a support polygon, ``(2,)`` [m].

    The first point on the straight way from ``near`` to the middle of the largest circle inside that is at least
    :data:`_DEEP` of the circle's radius away from every edge.
    """
    edges = _hull_edges(support_corners(robot, feet))
    widest = scipy.optimize.linprog(
        [0.0, 0.0, -1.0],
        A_ub=np.column_stack([edges[:, :2], np.ones(len(edges))]),
        b_ub=-edges[:, 2],
        bounds=[(None, None), (None, None), (0.0, None)],
    ).x
    inside = edges[:, 2] + _DEEP * widest[2]
    way = widest[:2] - near
    # From ``near`` straight towards the middle until every edge is far enough.
    along, off = edges[:, :2] @ way, edges[:, :2] @ near + inside
    near_edges = off > 0.0
    share = float((off[near_edges] / -along[near_edges]).max(initial=0.0))
    return np.asarray(near + min(share, 1.0) * way)


def rest_joints(robot: Robot) -> Array:
    """Positions of the actuated joints at rest, ``(n_joints,)`` [rad or m]."""
    return robot.rest[robot.n_base_q :].copy()


def central_range(robot: Robot, share: float = 0.8) -> tuple[Array, Array]:
    """Bounds of the central ``share`` of each joint's range (0.8: from 10 % to 90 %), ``(n_joints,)`` each."""
    lower, upper = robot.limits.position_lower, robot.limits.position_upper
    edge = 0.5 * (1.0 - share) * (upper - lower)
    return lower + edge, upper - edge
