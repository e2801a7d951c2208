"""From ten inertial parameters to the rigid body that they describe, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError

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
