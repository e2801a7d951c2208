"""Everything that the text of a first ``robot.yaml`` is written from."""

from __future__ import annotations

from dataclasses import dataclass

from excite.robot.scaffold.guesses import FootGuess, JointGuess
from excite.robot.shapes.ignored_pairs import PairReview


@dataclass(frozen=True, eq=False)
class Draft:
    """Everything that the text of a first ``robot.yaml`` is written from.

    Attributes:
        name: short name, from the URDF's file name.
        title: the URDF's own name of the robot.
        urdf: path of the URDF relative to the folder that the file is meant for.
        floating: whether the base is taken to be free.
        joints: joints that stay free, in the file's order.
        locked: joints that have to be held because others mimic them, with a value [rad or m].
        faults: links whose inertia is missing or impossible, with what is wrong.
        rest: values of joints for which zero is too near the limits [rad or m].
        acceleration: proposed limits [rad/s² or m/s²], by joint.
        inertia: largest inertia at each joint [kg·m² or kg], by joint.
        feet: links that may be feet, empty for a fixed base.
        pairs: mirrored links.
        geometry: ``collision``, ``visual``, or None if neither can be used; then ``geometry_fault`` says why.
        geometry_fault: why the URDF's geometry cannot be used, or None.
        review: pairs of links that may be ignored in collision checks, or None without geometry.
    """

    name: str
    title: str
    urdf: str
    floating: bool
    joints: tuple[JointGuess, ...]
    locked: dict[str, float]
    faults: dict[str, str]
    rest: dict[str, float]
    acceleration: dict[str, float]
    inertia: dict[str, float]
    feet: tuple[FootGuess, ...]
    pairs: tuple[tuple[str, str], ...]
    geometry: str | None
    geometry_fault: str | None
    review: PairReview | None
