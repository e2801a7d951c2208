"""A candidate: the geometry of a motion, before anything made it safe or gave it a time law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from excite.arrays import Array
from excite.motion.generators.curves import Curve


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
