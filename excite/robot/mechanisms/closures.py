"""Equations that a mechanism's tree of joints has to meet: loops that close, joints that move together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin
from numpy.polynomial import polynomial
from pydantic import Field, model_validator

from excite.arrays import Array
from excite.robot.quantities import (
    MAX_RATIO,
    Block,
    JointValue,
    Length,
    Name,
    Ratio,
    Rotation3,
    Source,
    Torque,
    Vector3,
    Velocity,
)
from excite.robot.refusal import robot_error, unknown_name
from excite.robot.urdf.writing import add_element, add_inertial, add_joint

# Singular values of the passive joints' part of K below this share of the largest are rounding: equations that say
# the same, as a plane's do. A mechanism that is so near a singular position amplifies any error a million times.
SINGULAR = 1e-6

Member = TypeVar("Member")


def join_overlapping(sets: Iterable[frozenset[Member]]) -> list[frozenset[Member]]:
    """Unions of sets that have members in common."""
    found: list[frozenset[Member]] = []
    for one in sets:
        touched = [group for group in found if group & one]
        found = [group for group in found if not group & one]
        found.append(one.union(*touched))
    return found


class Closure(ABC):
    """Equations ``gap(q) = 0``, of which some may say the same.

    Attributes:
        name: its name.
        field: where a robot's description says it.
    """

    name: str
    field: str

    @abstractmethod
    def gap(self, q: Array, data: pin.Data) -> Array:
        """How far it is open, ``(size,)`` [m, rad]; placements for ``q`` have to be in ``data``."""

    @abstractmethod
    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """Derivative of :meth:`gap` by velocities, ``(size, nv)``; joint Jacobians have to be in ``data``."""

    @abstractmethod
    def drift(self, model: pin.Model, q: Array, v: Array, data: pin.Data) -> Array:
        """Second derivative of :meth:`gap` by time without acceleration, ``(size,)``.

        Joint Jacobians, velocities, and accelerations for accelerations of zero, have to be in ``data``.
        """


@dataclass(frozen=True, eq=False)
class Loop(Closure):
    """A loop cut open: two frames of a tree that meet.

    Attributes:
        name: its name.
        joints: model joints that carry the frames, 0 for the world.
        placements: the frames in those joints' frames.
        rigid: whether the frames' axes meet too; else their origins alone.
    """

    name: str
    joints: tuple[int, int]
    placements: tuple[pin.SE3, pin.SE3]
    rigid: bool = False
    field = "loops"

    def gap(self, q: Array, data: pin.Data) -> Array:
        """Between the frames in the world."""
        first, second = (data.oMi[j] * m for j, m in zip(self.joints, self.placements, strict=True))
        gap = second.translation - first.translation
        if not self.rigid:
            return np.asarray(gap)
        return np.concatenate([gap, first.rotation @ pin.log3(first.rotation.T @ second.rotation)])

    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """Of the gap while it is closed: velocities of the frames, world axes, of unit velocities of the joints."""
        ends = []
        for joint, place in zip(self.joints, self.placements, strict=True):
            # Of the world pinocchio returns none, and of one velocity no matrix.
            own = pin.getJointJacobian(model, data, joint, pin.LOCAL) if joint else np.zeros((6, model.nv))
            ends.append(self._frame_turn(data, joint, place) @ place.actionInverse @ own.reshape(6, model.nv))
        return np.asarray(ends[1] - ends[0])[: 6 if self.rigid else 3]

    def drift(self, model: pin.Model, q: Array, v: Array, data: pin.Data) -> Array:
        """Of the gap while it is closed: accelerations of the frames, world axes."""
        ends = []
        for joint, place in zip(self.joints, self.placements, strict=True):
            velocity, acceleration = place.actInv(data.v[joint]), place.actInv(data.a[joint]).vector
            acceleration[:3] += pin.skew(velocity.angular) @ velocity.linear
            ends.append(self._frame_turn(data, joint, place) @ acceleration)
        return np.asarray(ends[1] - ends[0])[: 6 if self.rigid else 3]

    def _frame_turn(self, data: pin.Data, joint: int, place: pin.SE3) -> Array:
        """From a frame's own axes to the world's, for its linear and its angular part, ``(6, 6)``."""
        turned = np.zeros((6, 6))
        turned[:3, :3] = turned[3:, 3:] = data.oMi[joint].rotation @ place.rotation
        return turned


@dataclass(frozen=True, eq=False)
class Rod(Loop):
    """A rod without mass between two points of a tree, the origins of its frames: their distance is its length.

    Attributes:
        length: [m]
    """

    length: float = 0.0

    def gap(self, q: Array, data: pin.Data) -> Array:
        """How much further apart the points are than the rod is long, while that is little."""
        across = super().gap(q, data)
        return np.array([(across @ across - self.length**2) / (2.0 * self.length)])

    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """Along the rod."""
        return (super().gap(q, data) @ super().jacobian(model, q, data) / self.length)[None]

    def drift(self, model: pin.Model, q: Array, v: Array, data: pin.Data) -> Array:
        """Of the points along the rod, and of the rod as it turns."""
        speed, rate = super().jacobian(model, q, data) @ v, super().drift(model, q, v, data)
        return np.array([(speed @ speed + super().gap(q, data) @ rate) / self.length])


@dataclass(frozen=True, eq=False)
class Coupling(Closure):
    """Joints that move together: ``Σ p_j(q_j) = offset``, with polynomials ``p_j`` without constant term.

    Attributes:
        name: its name.
        columns: ``(index into q, index into v)`` of each joint, which has one coordinate.
        factors: of each joint's q, q², … in the order of ``columns``.
        offset: [rad or m]
    """

    name: str
    columns: tuple[tuple[int, int], ...]
    factors: tuple[tuple[float, ...], ...]
    offset: float = 0.0
    field = "couplings"

    @property
    def constant(self) -> bool:
        """Whether all its polynomials are factors."""
        return not any(any(factors[1:]) for factors in self.factors)

    def gap(self, q: Array, data: pin.Data) -> Array:
        """The sum less its offset."""
        return np.array([self._differentiate_polynomials(q, 0).sum() - self.offset])

    def jacobian(self, model: pin.Model, q: Array, data: pin.Data) -> Array:
        """The polynomials' first derivatives."""
        row = np.zeros((1, model.nv))
        row[0, [column for _, column in self.columns]] = self._differentiate_polynomials(q, 1)
        return row

    def drift(self, model: pin.Model, q: Array, v: Array, data: pin.Data) -> Array:
        """The polynomials' second derivatives times squared velocities."""
        speeds = v[[column for _, column in self.columns]]
        return np.array([self._differentiate_polynomials(q, 2) @ speeds**2])

    def _differentiate_polynomials(self, q: Array, order: int) -> Array:
        """A derivative of each joint's polynomial."""
        return np.array(
            [
                polynomial.polyval(q[position], polynomial.polyder(np.array([0.0, *factors]), order))
                for (position, _), factors in zip(self.columns, self.factors, strict=True)
            ]
        )


# What ``robot.yaml`` says of a mechanism: where loops close, which joints are coupled, which no motor drives.


class LoopEnd(Block):
    """Where a loop is closed on one of its two links: a point, and axes where the links keep their orientation."""

    link: Name
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)


class TieBlock(Block):
    """What ties joints together; ``passive`` names those of them that no motor drives and nobody logs."""

    name: Name
    passive: tuple[Name, ...] = ()
    source: Source


class LoopBlock(TieBlock):
    """Two links that meet beside their tree: in a point, as at a rod's ball, rigidly, or over a rod.

    A ``rod`` without mass holds two points at their distance in the model's zero posture, or at ``length``.
    """

    kind: Literal["point", "weld", "rod"] = "point"
    ends: Annotated[tuple[LoopEnd, ...], Field(min_length=2, max_length=2)]
    length: Length | None = None

    @model_validator(mode="after")
    def _rod(self) -> LoopBlock:
        if self.length is not None and self.kind != "rod":
            raise ValueError(f"loops {self.name}: a length goes with kind rod")
        return self


class CouplingBlock(TieBlock):
    """Joints that move together, as gears, belts and tendons make them: ``Σ p(q) = offset``.

    ``joints`` gives each joint's ``p``: a factor, or factors of q, q², q³ and q⁴. A URDF's ``<mimic>`` is such a
    coupling and need not be repeated.
    """

    joints: Annotated[
        dict[str, Ratio | Annotated[tuple[Ratio, ...], Field(min_length=1, max_length=4)]],
        Field(min_length=2),
    ]
    offset: JointValue = 0.0

    @model_validator(mode="after")
    def _moves(self) -> CouplingBlock:
        largest = max(abs(factor) for name in self.joints for factor in self.factors(name))
        for name, factors in self.joints.items():
            # What moves less than a gear of a gear would is tied to nothing, and follows from nothing.
            if max(map(abs, self.factors(name))) <= largest / MAX_RATIO**2:
                raise ValueError(f"couplings {self.name}: the factor of {name} is {factors}")
        return self

    def factors(self, joint: str) -> tuple[float, ...]:
        """Factors of a joint's q, q², …"""
        found = self.joints[joint]
        return found if isinstance(found, tuple) else (found,)


# Motors that drive joints together, over rods or gears: massless cranks in the model, tied to what they move.
#
# A motor of a parallel ankle or a differential has no link of its own in most URDFs. It gets one here,
# without mass, and a joint with its name, limits, friction and rotor; the joints that it moves follow. So
# everything that is said of mechanisms holds for it: motors' positions from joints' and back, and ``τ_m = Gᵀ
# τ``.

# So little that no motion shows it, and more than the 1e-15 that MuJoCo asks of a moving body [kg, kg·m²].
_MASS, _INERTIA = 1e-8, 1e-12


class MotorBlock(Block):
    """A motor on a link: its crank and rod, or the ratios of its gears to the joints.

    ``crank`` goes from the motor's axis to the rod's ball at the motor's zero, in the link's axes; ``rod`` is its other
    ball. ``ratios``: turns of the motor per turn of each joint.
    """

    name: Name
    link: Name
    xyz: Vector3 = (0.0, 0.0, 0.0)
    axis: Vector3 = (0.0, 0.0, 1.0)
    crank: Vector3 | None = None
    rod: LoopEnd | None = None
    ratios: dict[str, Ratio] = Field(default_factory=dict)
    position: tuple[JointValue, JointValue]
    velocity: Velocity
    torque: Torque

    @model_validator(mode="after")
    def _one_way(self) -> MotorBlock:
        if (self.rod is None) != (self.crank is None) or (self.rod is None) == (not self.ratios):
            raise ValueError(f"motor {self.name} has either crank and rod, or ratios")
        if not any(self.axis):
            raise ValueError(f"motor {self.name} has an axis of length zero")
        return self


class TransmissionBlock(Block):
    """Joints that as many motors drive together, and these motors."""

    name: Name
    joints: Annotated[tuple[Name, ...], Field(min_length=1)]
    motors: Annotated[tuple[MotorBlock, ...], Field(min_length=1)]
    source: Source

    @model_validator(mode="after")
    def _as_many(self) -> TransmissionBlock:
        if len(self.motors) != len(self.joints):
            raise ValueError(
                f"transmission {self.name} has {len(self.motors)} motors for {len(self.joints)} joints"
            )
        return self


def add_motors(root: Element, blocks: tuple[TransmissionBlock, ...], path: Path) -> None:
    """Give motors a joint and a link each in a ``robot`` element.

    Raises:
        RobotError: a motor sits on no link, or has the name of a joint.
    """
    links = {link.get("name", "") for link in root.findall("link")}
    joints = {joint.get("name", "") for joint in root.findall("joint")}
    for block in blocks:
        for motor in block.motors:
            field = f"transmissions.{block.name}.{motor.name}"
            if motor.name in joints:
                raise robot_error(path, field, "is the name of a joint already", "give the motor its own")
            if motor.link not in links:
                raise unknown_name(path, f"{field}.link", "link", motor.link, sorted(links))
            _add_motor(root, motor)


def _add_motor(root: Element, motor: MotorBlock) -> None:
    link, place = add_element(root, "link", name=crank_link(motor)), pin.SE3(np.eye(3), np.array(motor.xyz))
    add_inertial(link, pin.SE3.Identity(), _MASS, _INERTIA * np.eye(3)[np.triu_indices(3)])
    joint = add_joint(root, motor.name, "revolute", motor.link, crank_link(motor), place)
    add_element(joint, "axis", xyz=motor.axis)
    lower, upper = motor.position
    add_element(joint, "limit", lower=lower, upper=upper, velocity=motor.velocity, effort=motor.torque)


def crank_link(motor: MotorBlock) -> str:
    """Name of a motor's link."""
    return f"{motor.name}_crank"


def closures_of(
    blocks: tuple[TransmissionBlock, ...],
) -> tuple[tuple[LoopBlock, ...], tuple[CouplingBlock, ...]]:
    """Loops and couplings that transmissions amount to."""
    loops: list[LoopBlock] = []
    couplings: list[CouplingBlock] = []
    for block in blocks:
        for number, motor in enumerate(block.motors):
            # All joints follow from all motors: it is said once.
            passive = () if number else block.joints
            name, source = f"{block.name}.{motor.name}", block.source
            if motor.rod is not None and motor.crank is not None:
                ends = (LoopEnd(link=crank_link(motor), xyz=motor.crank), motor.rod)
                loops.append(LoopBlock(name=name, kind="rod", ends=ends, passive=passive, source=source))
            else:
                ratios = {joint: -ratio for joint, ratio in motor.ratios.items()}
                joints: dict[str, float | tuple[float, ...]] = {motor.name: 1.0, **ratios}
                couplings.append(CouplingBlock(name=name, joints=joints, passive=passive, source=source))
    return tuple(loops), tuple(couplings)
