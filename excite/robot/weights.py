"""Whether a model's masses can be kilograms: grams give bodies that no material has and no drive could lift."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.errors import RobotError

# Half of each known robot's mass (66 models) lies in bodies below 21 000 kg/m³ by their own inertia, and mostly
# below 5 000; the densest metal has 22 600. Grams make 4e5 of the usual 400.
MAX_DENSITY = 1e5
# The weight of known robots' limbs is at most twice what the drives there can hold; grams make a thousand times.
MAX_WEIGHT = 30.0
# Thinner bodies are points and lines, which models use where inertia does not matter [m].
_THINNEST = 1e-3
_GRAVITY = 9.81


def check_weights(model: pin.Model, torque: NDArray[np.float64], path: Path) -> None:
    """Refuse a model whose masses are in grams.

    Two things have to speak for it: bodies denser than any metal, from their mass and moments, and weight far
    beyond the drives' torque.

    Args:
        model: model of the robot.
        torque: limits of the actuated joints, the model's last; 0 or NaN where unknown [N·m or N].
        path: file of the model, for the error.

    Raises:
        RobotError: the masses cannot be kilograms.
    """
    density = typical_density(model)
    if density <= MAX_DENSITY:
        return
    weight = _joint_loads(model)[-len(torque) :]
    known = np.isfinite(torque) & (torque > 0.0)
    share = float((weight[known] / torque[known]).max(initial=0.0))
    if share > MAX_WEIGHT:
        raise RobotError(
            f"its bodies have {density:.2g} kg/m³ by their moments of inertia and weigh {share:.2g} times what its"
            " drives can hold",
            source=path,
            field="mass@value",
            remedy="looks like grams: write masses in kg and moments of inertia in kg·m²",
        )


def typical_density(model: pin.Model) -> float:
    """Density above which half of the mass lies, each body taken for the ellipsoid of its moments [kg/m³].

    Points without moments have none; 0 where there is nothing else.
    """
    mass, volume = [], []
    for inertia in list(model.inertias)[1:]:
        moments = np.linalg.eigvalsh(inertia.inertia)
        if inertia.mass > 0.0 and moments.any():
            squares = 2.5 * (moments.sum() - 2.0 * moments) / inertia.mass
            half_axes = np.sqrt(np.maximum(squares, _THINNEST**2))
            mass.append(inertia.mass)
            volume.append(4.0 / 3.0 * np.pi * half_axes.prod())
    if not mass:
        return 0.0
    masses, density = np.array(mass), np.array(mass) / np.array(volume)
    order = np.argsort(density, kind="stable")
    below = np.cumsum(masses[order])
    return float(density[order][np.searchsorted(below, 0.5 * below[-1])])


def _joint_loads(model: pin.Model) -> NDArray[np.float64]:
    """Torque or force with which the weight beyond each joint can load it, about, by joint [N·m or N]."""
    data = model.createData()
    pin.centerOfMass(model, data, pin.neutral(model))
    loads = []
    for joint in range(1, model.njoints):
        lever = 1.0 if "Prismatic" in model.joints[joint].shortname() else np.linalg.norm(data.com[joint])
        loads.append(data.mass[joint] * _GRAVITY * lever)
    return np.array(loads)
