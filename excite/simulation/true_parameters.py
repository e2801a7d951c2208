"""True parameters of virtual robots: bodies, what was added to the model and what scatters about it, and drives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError
from excite.robot.joint_values import per_joint
from excite.robot.robot import Robot
from excite.robot.shapes.shape import joints_at

# A hand or head is the first segment, from the tip inwards, that carries at least this much [kg].
_LIGHTEST_END = 0.2


@dataclass(frozen=True)
class AddedPart:
    """A part that the robot carries and its model does not have.

    Attributes:
        what: readable name of the part.
        segment: index of the segment in ``Robot.segments``.
        link: link of the segment.
        mass: [kg]
        position: its centre in the frame of the segment's joint [m].
        size: edges of the box that it is, along that frame's axes [m].
    """

    what: str
    segment: int
    link: str
    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float]

    @classmethod
    def on_segment(
        cls,
        robot: Robot,
        what: str,
        segment: int,
        mass: float,
        position: Array,
        size: tuple[float, float, float],
    ) -> AddedPart:
        """A part of a robot's segment, of which an index is given."""
        x, y, z = position.tolist()
        return cls(what, segment, robot.segments[segment].link, mass, (x, y, z), size)


@dataclass(frozen=True, eq=False)
class TrueParameters:
    """Inertial parameters of a virtual robot and how they came to differ from the model's.

    Attributes:
        phi: ``(10·n_segments,)``, pinocchio's order, joint frames.
        parts: what was added.
        scatter: relative scatter of every segment's parameters, 0 for none.
    """

    phi: Array
    parts: tuple[AddedPart, ...] = ()
    scatter: float = 0.0

    @property
    def added_mass(self) -> float:
        """Mass of all parts together [kg]."""
        return float(sum(part.mass for part in self.parts))


def nominal_truth(robot: Robot) -> TrueParameters:
    """The model's own parameters."""
    return TrueParameters(robot.nominal_parameters.copy())


def with_part(truth: TrueParameters, part: AddedPart) -> TrueParameters:
    """The same robot carrying one more part.

    Raises:
        InputError: mass or size is not positive.
    """
    if part.mass <= 0.0 or min(part.size) <= 0.0:
        raise InputError(
            f"part {part.what!r} has mass {part.mass} kg and size {part.size} m", remedy="make both positive"
        )
    phi, own = truth.phi.copy(), slice(10 * part.segment, 10 * part.segment + 10)
    # What carries it may have moments in the model that no body has.
    phi[own] = possible_parameters(phi[own], part.link)
    phi[own] += box_parameters(part.mass, np.array(part.position), np.array(part.size))
    return replace(truth, phi=phi, parts=(*truth.parts, part))


def moved_inertia(robot: Robot, joint: str) -> float:
    """Inertia about a joint's axis of all that moves with it, nominal, at rest [kg·m²]."""
    data = robot.model.createData()
    mass = pin.crba(robot.model, data, robot.rest)
    index = robot.model.idx_vs[robot.model.getJointId(joint)]
    return float(mass[index, index])


def hrp2_like_changes(robot: Robot, rng: np.random.Generator, *, scatter: float = 0.0) -> TrueParameters:
    """Changes like those of the HRP-2 of Jovic et al. (2016, T-RO, section VII) since its CAD model.

    A computer was put into the trunk, cameras into the head, force sensors and grippers into the hands, 5 kg
    in total. The trunk is the segment at which arms (and head) part, hands and head are the tree's ends that
    are no feet. A robot whose head is no segment of its own gets the cameras' mass in the trunk as well.
    Feet stay as they are.

    Args:
        robot: a robot with feet.
        rng: places the parts within a few centimetres.
        scatter: relative scatter of the other parameters, as in :func:`scattered_parameters`.

    Returns:
        The true parameters.

    Raises:
        InputError: the robot has no feet, or no ends beside them.
    """
    if not robot.feet:
        raise InputError(f"{robot.name} has no feet, hands and trunk", remedy="use scattered_parameters")
    hands, heads, trunk = _segment_places(robot)
    weights = [("computer", trunk, 3.4 if heads else 4.0)]
    weights += [("cameras", head, 0.6 / len(heads)) for head in heads]
    weights += [("force sensor and gripper", hand, 1.0 / len(hands)) for hand in hands]
    truth = scattered_parameters(robot, rng, scatter=scatter) if scatter > 0.0 else nominal_truth(robot)
    for what, segment, weight in weights:
        truth = with_part(truth, _place_part(robot, rng, what, segment, weight))
    return truth


def has_hands(robot: Robot) -> bool:
    """Whether some limb of a robot ends in no foot."""
    model, feet = robot.model, {foot.joint for foot in robot.feet}
    leaves = set(range(1, model.njoints)) - {int(parent) for parent in model.parents}
    return any(feet.isdisjoint(model.supports[leaf]) for leaf in leaves)


# Of the robot's mass what 2 kg are of a quadruped of 16 kg.
_LOAD_SHARE = 0.12


def carried_load(robot: Robot, rng: np.random.Generator) -> TrueParameters:
    """A robot without hands that carries a load on its heaviest segment, a few centimetres off its middle.

    Args:
        robot: the robot, otherwise as its model says.
        rng: places the load.
    """
    masses = robot.nominal_parameters[::10]
    return with_part(
        nominal_truth(robot),
        _place_part(robot, rng, "load", int(np.argmax(masses)), _LOAD_SHARE * robot.mass),
    )


def scattered_parameters(robot: Robot, rng: np.random.Generator, *, scatter: float = 0.05) -> TrueParameters:
    """Parameters scattered as by manufacture: each segment's matter is rescaled, stretched and shifted.

    Args:
        robot: the robot; its feet and what lies beyond its ankle sensors stay nominal.
        rng: source of the scatter.
        scatter: standard deviation of the mass's logarithm, of the stretch, and of the shift of the centre of
            mass in units of the radius of gyration.

    Returns:
        Physical parameters.
    """
    fixed = {foot.joint - 1 for foot in robot.feet} | {
        index for sensor in robot.sensors for index in sensor.excludes
    }
    phi = robot.nominal_parameters.copy()
    for index in range(len(robot.segments)):
        density = float(np.exp(scatter * rng.standard_normal()))
        stretch, shift = scatter * rng.standard_normal((3, 3)), scatter * rng.standard_normal(3)
        block = phi[10 * index : 10 * index + 10]
        if index in fixed or not block.any():
            continue
        if robot.description.model.acknowledged:
            # What is accepted of the model is no body's, as a point mass is not: scattered, it would be refused.
            block = possible_parameters(block, robot.segments[index].name)
        body = pin.Inertia.FromDynamicParameters(block)
        radius = np.sqrt(np.trace(body.inertia) / (2.0 * body.mass))
        linear = np.eye(3) + 0.5 * (stretch + stretch.T)
        affine = np.eye(4)
        affine[:3, :3], affine[:3, 3] = linear, body.lever - linear @ body.lever + shift * radius
        phi[10 * index : 10 * index + 10] = deform_parameters(block, affine, density)
    return TrueParameters(phi, (), scatter)


class _Places(NamedTuple):
    """Segments of the hands, of the heads, and the trunk."""

    hands: list[int]
    heads: list[int]
    trunk: int


def _segment_places(robot: Robot) -> _Places:
    parents = [robot.model.parents[segment.joint] - 1 for segment in robot.segments]
    paths = [_path_to_base(parents, index) for index in range(len(parents))]
    masses = robot.nominal_parameters[::10]
    carried = [sum(masses[j] for j, path in enumerate(paths) if i in path) for i in range(len(parents))]
    feet = {foot.joint - 1 for foot in robot.feet}
    ends: list[int] = []
    for leaf in sorted(set(range(len(parents))) - set(parents)):
        path = paths[leaf]
        if feet & set(path):
            continue
        end = next((index for index in path if carried[index] >= _LIGHTEST_END), path[-1])
        if end not in ends:
            ends.append(end)
    names = {end: (robot.segments[end].name + robot.segments[end].link).lower() for end in ends}
    heads = [end for end, name in names.items() if "head" in name or "neck" in name]
    hands = [end for end in ends if end not in heads]
    if not hands:
        raise InputError(f"{robot.name} has no hands to put anything into", remedy="use scattered_parameters")
    shared = set.intersection(*(set(paths[end][1:]) for end in ends))
    if not shared:
        raise InputError(f"{robot.name} has no trunk to put anything into", remedy="use scattered_parameters")
    return _Places(hands, heads, max(shared))


def _path_to_base(parents: list[int], index: int) -> list[int]:
    """Segments from one to the base, itself first."""
    path = []
    while index >= 0:
        path.append(index)
        index = parents[index]
    return path


# Of what lies at a trunk: where from its centre of mass, and how far it may be from there, x ahead and z up at rest
# [m]; its size [m].
_ON_TRUNK = {
    "computer": ((-0.07, 0.0, 0.05), (0.01, 0.02, 0.03), (0.08, 0.20, 0.20)),
    "load": ((0.0, 0.0, 0.08), (0.05, 0.02, 0.01), (0.15, 0.10, 0.05)),
}


def _place_part(robot: Robot, rng: np.random.Generator, what: str, segment: int, mass: float) -> AddedPart:
    """A part behind the trunk's centre of mass, on a back, or at the end of a hand or head."""
    joint = robot.segments[segment].joint
    com, drawn = robot.model.inertias[joint].lever, rng.uniform(-1.0, 1.0, 3)
    if what in _ON_TRUNK:
        offset, spread, size = _ON_TRUNK[what]
        turn = joints_at(robot.model, robot.rest).oMi[joint].rotation
        away = turn.T @ (np.array(offset) + np.array(spread) * drawn)
    else:
        away = 0.03 * com / max(float(np.linalg.norm(com)), 1e-6) + 0.01 * drawn
        size = (0.06, 0.06, 0.06)
    return AddedPart.on_segment(robot, what, segment, mass, com + away, size)


# From ten inertial parameters to the rigid body that they describe, and back.

# Share of the largest principal moment by which rounding may break the triangle inequality.
_TRIANGLE_TOLERANCE = 1e-9
# Least moment that a simulator is given of a body whose stated moments are accepted, as share of the largest and as
# radius of gyration [m]: too small to be felt beside what such models have at the same joint.
_LEAST, _POINT_M = 1e-3, 1e-3
# What stands for a segment without mass [kg], which a joint between two axes at one point may have.
MASSLESS_KG = 1e-9


class UnphysicalParametersError(InputError):
    """Inertial parameters that no body can have.

    Attributes:
        segment: name of the segment.
        phi: its ten parameters.
    """

    def __init__(self, what: str, *, segment: str, phi: Array):
        self.segment, self.phi = segment, phi
        super().__init__(
            what,
            source=f"inertial parameters of {segment}",
            remedy="identify with physical constraints (method lmi), or give the link moments of inertia in the model",
        )


@dataclass(frozen=True, eq=False)
class PrincipalInertia:
    """A rigid body by its centre of mass and principal axes, in the frame of its joint.

    Attributes:
        mass: [kg]
        com: centre of mass ``(3,)`` [m].
        moments: principal moments about the centre of mass ``(3,)`` [kg·m²], each at most the others' sum.
        rotation: columns are the principal axes, right-handed, ``(3, 3)``.
    """

    mass: float
    com: Array
    moments: Array
    rotation: Array


def principal_inertia(phi: Array, segment: str, *, accepted: bool = False) -> PrincipalInertia:
    """Centre of mass and principal axes of one segment.

    Args:
        phi: ten parameters ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` about the joint frame's origin.
        segment: name of the segment, for the error.
        accepted: whether moments that no body has are accepted; those that are too small are raised then, since no
            simulator takes them.

    Returns:
        The body; a segment whose parameters are all zero gets a microgramme's mass, so that it can move.

    Raises:
        UnphysicalParametersError: a value is not finite, the mass is not positive, a principal moment about
            the centre of mass is not positive, or one exceeds the sum of the others.
    """
    if not np.isfinite(phi).all():
        raise UnphysicalParametersError("a value is not finite", segment=segment, phi=phi)
    if not phi.any():
        return PrincipalInertia(MASSLESS_KG, np.zeros(3), np.full(3, MASSLESS_KG * 1e-3), np.eye(3))
    mass = float(phi[0])
    if mass <= 0.0:
        raise UnphysicalParametersError(f"mass is {mass:.6g} kg", segment=segment, phi=phi)
    com = phi[1:4] / mass
    ixx, ixy, iyy, ixz, iyz, izz = phi[4:]
    about_joint = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    about_com = about_joint - mass * ((com @ com) * np.eye(3) - np.outer(com, com))
    moments, rotation = np.linalg.eigh(about_com)
    if accepted:
        moments = np.maximum(moments, max(_LEAST * float(moments[2]), _POINT_M**2 * mass))
    if moments[0] <= 0.0:
        raise UnphysicalParametersError(
            f"a principal moment about the centre of mass is {moments[0]:.3g} kg·m²", segment=segment, phi=phi
        )
    excess = moments[2] - moments[0] - moments[1]
    if excess > _TRIANGLE_TOLERANCE * moments[2] and not accepted:
        raise UnphysicalParametersError(
            f"the largest principal moment exceeds the sum of the others by {excess:.3g} kg·m²",
            segment=segment,
            phi=phi,
        )
    if excess > 0.0:
        # MuJoCo allows no rounding in their sum.
        moments = moments + np.array([excess + _TRIANGLE_TOLERANCE * moments[2], 0.0, 0.0])
    if np.linalg.det(rotation) < 0.0:
        rotation = rotation * np.array([1.0, 1.0, -1.0])
    return PrincipalInertia(mass, com, moments, rotation)


def possible_parameters(phi: Array, segment: str) -> Array:
    """Ten parameters as a simulator takes them where the stated ones are accepted: as they are where a body has them.

    Args:
        phi: ten parameters.
        segment: name of the segment, for the error.

    Returns:
        ``(10,)``; of moments that no body has, the least that are raised for it.

    Raises:
        UnphysicalParametersError: a value is not finite, or the mass is not positive.
    """
    try:
        principal_inertia(phi, segment)
    except UnphysicalParametersError:
        body = principal_inertia(phi, segment, accepted=True)
        inertia = body.rotation @ np.diag(body.moments) @ body.rotation.T
        return np.asarray(pin.Inertia(body.mass, body.com, inertia).toDynamicParameters())
    return phi


def box_parameters(mass: float, position: Array, size: Array) -> Array:
    """Ten parameters of a homogeneous box with edges along the joint frame's axes.

    Args:
        mass: [kg]
        position: centre of the box in the joint frame, ``(3,)`` [m].
        size: edge lengths ``(3,)`` [m].

    Returns:
        ``(10,)`` in pinocchio's order, about the joint frame's origin.
    """
    x2, y2, z2 = np.square(size)
    inertia = np.diag([y2 + z2, x2 + z2, x2 + y2]) * mass / 12.0
    return np.asarray(pin.Inertia(mass, np.asarray(position, dtype=float), inertia).toDynamicParameters())


def deform_parameters(phi: Array, deformation: Array, density: float) -> Array:
    """Parameters of a body after a linear deformation of its matter and a change of density.

    The pseudo-inertia J is the second moment of the density over the points ``[x y z 1]`` (Wensing, Kim and
    Slotine 2018, RA-L 3(1)), so it becomes ``A J Aᵀ`` under an affine map A of the body's points, and a
    physical body stays physical.

    Args:
        phi: ten parameters.
        deformation: ``(4, 4)`` affine map of points ``[x y z 1]``, last row 0 0 0 1.
        density: factor on the mass.

    Returns:
        Ten parameters of the deformed body, about the same origin.
    """
    pseudo = pin.PseudoInertia.FromDynamicParameters(phi).toMatrix()
    changed = density * deformation @ pseudo @ deformation.T
    return np.asarray(pin.PseudoInertia.FromMatrix(changed).toDynamicParameters())


# The drives of a virtual robot: servo gains, torque limits, friction and rotor inertia of every joint.

_BEARING_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class Drives:
    """What moves the joints; each array ``(n_joints,)`` in the order of ``Robot.joint_names``.

    Attributes:
        kp: position gain of the servo [N·m/rad or N/m].
        kd: velocity gain of the servo [N·m·s/rad or N·s/m].
        torque_limit: at which the servo's torque is clipped [N·m or N].
        viscous: viscous friction of motor and gears, which a link-side sensor does not see
            [N·m·s/rad or N·s/m].
        coulomb: Coulomb friction of motor and gears [N·m or N].
        bearing_viscous: viscous friction of the output bearing, which every torque sensor sees.
        bearing_coulomb: Coulomb friction of the output bearing.
        armature: rotor inertia as felt at the joint [kg·m² or kg].
        rate_hz: rate at which the servo takes new commands; the drive interpolates between them [Hz].
    """

    kp: Array
    kd: Array
    torque_limit: Array
    viscous: Array
    coulomb: Array
    bearing_viscous: Array
    bearing_coulomb: Array
    armature: Array
    rate_hz: float

    @property
    def total_viscous(self) -> Array:
        """Viscous friction of gears and bearing together, ``(n_joints,)``."""
        return self.viscous + self.bearing_viscous

    @property
    def total_coulomb(self) -> Array:
        """Coulomb friction of gears and bearing together, ``(n_joints,)``."""
        return self.coulomb + self.bearing_coulomb


def nominal_drives(robot: Robot) -> Drives:
    """The drives that ``robot.yaml`` declares; friction and armature that it leaves out are zero."""
    description, names = robot.description, robot.joint_names
    zero, missing = np.zeros(len(names)), np.full(len(names), np.nan)
    return Drives(
        kp=per_joint(description.controller.kp, names, missing),
        kd=per_joint(description.controller.kd, names, missing),
        torque_limit=robot.limits.torque.copy(),
        viscous=per_joint(description.drives.viscous, names, zero),
        coulomb=per_joint(description.drives.coulomb, names, zero),
        bearing_viscous=zero.copy(),
        bearing_coulomb=zero.copy(),
        armature=per_joint(description.drives.armature, names, zero),
        rate_hz=description.controller.rate_hz,
    )


def scattered_drives(robot: Robot, rng: np.random.Generator) -> Drives:
    """Drives whose friction differs from the declared one, as no two gearboxes are alike.

    Viscous and Coulomb friction are multiplied by log-normal factors (0.3). Where ``robot.yaml`` declares no
    friction of a kind, the truth gets one all the same: 0.5 % (viscous, at 1 rad/s) or 1 % (Coulomb) of the
    torque limit. The output bearing, which no ``robot.yaml`` declares, has a quarter of the gears' friction.

    Args:
        robot: the robot.
        rng: source of the factors.

    Returns:
        The drives; gains, limits and armature are the declared ones.
    """
    nominal = nominal_drives(robot)
    viscous = nominal.viscous if nominal.viscous.any() else 0.005 * nominal.torque_limit
    coulomb = nominal.coulomb if nominal.coulomb.any() else 0.01 * nominal.torque_limit
    factors = np.exp(0.3 * rng.standard_normal((2, robot.n_joints)))
    viscous, coulomb = viscous * factors[0], coulomb * factors[1]
    viscous, coulomb = (np.where(robot.passive, 0.0, values) for values in (viscous, coulomb))
    return replace(
        nominal,
        viscous=viscous,
        coulomb=coulomb,
        bearing_viscous=_BEARING_SHARE * viscous,
        bearing_coulomb=_BEARING_SHARE * coulomb,
    )
