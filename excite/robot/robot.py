"""The robot as every other room sees it: model, limits, contacts, sensors and segments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Flags
from excite.display import count
from excite.errors import UnknownNameError
from excite.robot.description import FREE_BASES, RobotDescription
from excite.robot.joint_values import Limits
from excite.robot.mechanisms.mechanism import Mechanism, limb_columns


@dataclass(frozen=True, eq=False)
class Foot:
    """A foot that carries the robot.

    Attributes:
        name: name used in ``contact.NAME`` columns.
        link: link that the sole belongs to.
        joint: index of the model joint that carries the link.
        sole: corners of the sole in the frame of ``joint``, ``(n_corners, 3)`` [m], in order around it; one for a
            point foot, two for an edge.
        placement: pose of a frame on the sole in the frame of ``joint``: origin at the mean of the
            corners, z along the sole's outward-from-ground normal, x along the link's x. A point foot's axes are
            the world's at rest, where its ball's centre is not stated; an edge's x runs along it.
        friction: Coulomb friction coefficient of the sole on the ground.
        radius: of a point foot that is a ball and rolls on the ground; zero of all others [m].
    """

    name: str
    link: str
    joint: int
    sole: Array
    placement: pin.SE3
    friction: float
    radius: float = 0.0

    @property
    def centre(self) -> Array:
        """Centre of the ball that a point foot is, in the frame of ``joint``, ``(3,)`` [m]."""
        return np.asarray(self.sole[0] + self.radius * self.placement.rotation[:, 2])

    @property
    def flat(self) -> bool:
        """Whether the sole is a surface, which keeps the link's orientation; not so a point or an edge."""
        return len(self.sole) >= 3


@dataclass(frozen=True, eq=False)
class WrenchSensor:
    """A sensor of a contact wrench (force, then moment about its origin), in its own frame.

    Attributes:
        name: name used in ``wrench.NAME.*`` columns.
        kind: ``foot_ft`` (in the ankle) or ``force_plate`` (in the ground).
        link: link that carries it (``world`` for a plate).
        joint: index of the model joint that carries it (0 for a plate).
        placement: its pose in the frame of ``joint`` (in the world for a plate).
        foot: name of the foot whose contact it measures.
        excludes: indices of the segments beyond the sensor, whose weight it does not contain.
        noise_force: standard deviation of each force component [N].
        noise_moment: standard deviation of each moment component [N·m].
    """

    name: str
    kind: str
    link: str
    joint: int
    placement: pin.SE3
    foot: str
    excludes: tuple[int, ...]
    noise_force: float
    noise_moment: float


@dataclass(frozen=True)
class Segment:
    """A rigid body with ten inertial parameters, expressed in the frame of its joint.

    Attributes:
        name: readable name.
        link: URDF link that its joint carries (fixed links are part of it).
        joint: index of the joint in the pinocchio model, from 1; columns ``10·(joint-1) …`` are its own.
        pair: index of the mirror segment in ``Robot.segments``, or None.
    """

    name: str
    link: str
    joint: int
    pair: int | None


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot: pinocchio model and everything that the model does not say.

    Configurations follow pinocchio: ``q`` is ``[base x y z qx qy qz qw, joints…]`` for a floating base
    and ``[joints…]`` for a fixed one; ``v`` and ``a`` start with the base's twist and its derivative
    (linear, angular; in the base frame). The joints stand in the order of ``joint_names``, one coordinate each;
    those without a motor (``passive``) follow from the others. Inertial parameters ``phi`` are ten per segment in
    pinocchio's order
    ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz``, about the joint frame's origin.

    Attributes:
        name: short name.
        description: the validated ``robot.yaml``.
        source: file that the description was read from.
        urdf: text of the URDF as loaded, with mesh paths made absolute.
        hash: SHA-256 of description, URDF and collision meshes, hexadecimal.
        model: pinocchio model, locked joints removed.
        joint_names: joints, in model order.
        limits: joint limits.
        feet: feet, empty for a robot that does not stand (an arm, or one that hangs or is held).
        sensors: wrench sensors, empty for an arm and for a robot without force sensors.
        segments: one per model joint, in model order.
        rest: configuration at which motions start and end, ``(nq,)``.
        mechanism: how joints without a motor follow from the others, None where every joint has one.
    """

    name: str
    description: RobotDescription
    source: Path
    urdf: str
    hash: str
    model: pin.Model
    joint_names: tuple[str, ...]
    limits: Limits
    feet: tuple[Foot, ...]
    sensors: tuple[WrenchSensor, ...]
    segments: tuple[Segment, ...]
    rest: Array
    mechanism: Mechanism | None = None

    @property
    def floating(self) -> bool:
        """Whether the base's pose is part of the configuration: it stands on feet, or hangs."""
        return self.description.base in FREE_BASES

    @property
    def n_joints(self) -> int:
        """Number of joints, those without a motor among them."""
        return len(self.joint_names)

    @cached_property
    def passive(self) -> Flags:
        """Which joints no motor drives, ``(n_joints,)``; they follow from the others."""
        columns = () if self.mechanism is None else self.mechanism.passive - self.n_base_v
        return np.isin(np.arange(self.n_joints), columns)

    @cached_property
    def closing(self) -> Mechanism | None:
        """The mechanism by which planning closes it: cranks and rods of legs follow from the foot where they can."""
        if self.mechanism is None or not self.feet:
            return self.mechanism
        return self.mechanism.following_from(limb_columns(self.model, [foot.joint for foot in self.feet]))

    @cached_property
    def driven_names(self) -> tuple[str, ...]:
        """Joints with a motor, in model order: those that are commanded and logged."""
        return tuple(str(name) for name in np.array(self.joint_names)[~self.passive])

    @property
    def n_base_q(self) -> int:
        """Number of base coordinates in ``q``: 7 or 0."""
        return 7 if self.floating else 0

    @property
    def n_base_v(self) -> int:
        """Number of base coordinates in ``v``: 6 or 0."""
        return 6 if self.floating else 0

    @property
    def measures_contacts(self) -> bool:
        """Whether wrench sensors see all that carries a free base, so that the base's rows are its equations.

        Else the joints' rows are: of a fixed base, or with unmeasured contact forces taken out.
        """
        return self.floating and bool(self.sensors)

    @property
    def n_equations(self) -> int:
        """Number of its equations a sample: 6 rows of the base, or one a joint."""
        return 6 if self.measures_contacts else self.n_joints

    @property
    def base_link(self) -> str:
        """Link whose pose is the base's."""
        return self.segments[0].link if self.floating else "world"

    @cached_property
    def nominal_parameters(self) -> Array:
        """Inertial parameters of the model, ``(10·n_segments,)``, pinocchio's order, joint frames [SI]."""
        return np.concatenate([inertia.toDynamicParameters() for inertia in list(self.model.inertias)[1:]])

    @property
    def mass(self) -> float:
        """Total mass of the moving segments [kg]."""
        return float(self.nominal_parameters[::10].sum())

    def joint_index(self, name: str) -> int:
        """Index of an actuated joint in ``joint_names``; raises UnknownNameError."""
        if name not in self.joint_names:
            raise UnknownNameError("joint", name, list(self.joint_names))
        return self.joint_names.index(name)

    def foot(self, name: str) -> Foot:
        """The foot of that name; raises UnknownNameError."""
        for foot in self.feet:
            if foot.name == name:
                return foot
        raise UnknownNameError("foot", name, [foot.name for foot in self.feet])

    def draw_configurations(self, rng: np.random.Generator, n: int) -> Array:
        """Random configurations within the limits ``(n, nq)``, the base at rest and a mechanism closed."""
        lower, upper = self.limits.position_lower, self.limits.position_upper
        if self.mechanism is not None:
            return self.mechanism.draw_configurations(rng, lower, upper, n)
        q = np.tile(self.rest, (n, 1))
        q[:, self.n_base_q :] = rng.uniform(lower, upper, (n, self.n_joints))
        return q

    def on_motors(self, q: Array, forces: Array) -> Array:
        """Forces of the tree ``(n, nv)`` or ``(n, nv, k)`` as motors and base exert them, at closed ``q``."""
        return forces if self.mechanism is None else self.mechanism.on_motors(q, forces)

    def parameter_columns(self, segment: int) -> slice:
        """Columns of a segment's ten parameters in ``phi``; ``segment`` indexes ``segments``."""
        return slice(10 * segment, 10 * segment + 10)

    def __repr__(self) -> str:
        joints = count(self.n_joints, "joint")
        return f"Robot({self.name!r}, {self.description.base} base, {joints}, {self.mass:.1f} kg)"
