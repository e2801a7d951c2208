"""A first ``robot.yaml`` for a URDF of one's own: what could be derived, and what a person must say.

What only a person knows is written as ``null`` behind a ``FILL IN:`` comment, so that loading the file
before it is complete names the first field that is still open.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from excite.errors import RobotError
from excite.robot.description import RobotDescription
from excite.robot.loading import build_robot
from excite.robot.robot import Robot
from excite.robot.scaffold.guesses import (
    FootGuess,
    JointGuess,
    guess_feet,
    guess_floating,
    guess_joints,
    guess_pairs,
    joint_inertias,
)
from excite.robot.scaffold.text import render
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.ignored_pairs import PairReview, review_pairs
from excite.robot.urdf.inertia import inertial_faults
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MAX_NAME, check_tree
from excite.robot.weights import check_weights

Array = NDArray[np.float64]

SHARE_OF_TORQUE = 0.3
"""Share of the torque limit that a proposed acceleration limit may use on the joint's own inertia."""


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


def scaffold_description(
    urdf_path: str | Path, folder: str | Path | None = None, *, seed: int = 0, floating: bool | None = None
) -> str:
    """Text of a commented ``robot.yaml`` for a URDF.

    Args:
        urdf_path: the URDF.
        folder: folder that the text will be written to; the URDF's own by default.
        seed: seed of the random postures behind inertia and collision pairs.
        floating: whether the base is free; guessed from the limbs where None.

    Returns:
        YAML text with ``FILL IN:`` comments where a person must say something.

    Raises:
        RobotError: the URDF is missing or absurd in a way that no description can mend.
    """
    return render(draft_description(Path(urdf_path), folder, np.random.default_rng(seed), floating))


def draft_description(
    path: Path, folder: str | Path | None, rng: np.random.Generator, floating: bool | None = None
) -> Draft:
    """Derive what can be derived from a URDF; arguments and errors as for :func:`scaffold_description`."""
    root = parse_urdf(path)
    joints = check_tree(root, path)
    if floating is None:
        floating = guess_floating(root, joints)
    guesses = guess_joints(joints, path)
    locked = _locked(guesses)
    free = tuple(guess for guess in guesses if guess.name not in locked and guess.follows is None)
    if not free:
        raise RobotError("has no joint that moves", source=path, remedy="describe at least one")
    faults = _faults(root, joints, floating, path)
    rest = {guess.name: value for guess in free if (value := _rest(guess)) != 0.0}
    stand_in = _StandIn(path, floating, free, locked, tuple(faults), rest)
    robot, geometry, geometry_fault = stand_in.with_geometry()
    check_weights(robot.model, robot.model.effortLimit[-robot.n_joints :], path)
    inertia = dict(
        zip(robot.joint_names, (float(value) for value in joint_inertias(robot, rng)), strict=True)
    )
    return Draft(
        name=path.stem[:MAX_NAME],
        title=root.get("name", ""),
        urdf=os.path.relpath(path.resolve(), Path(folder or path.parent).resolve()),
        floating=floating,
        joints=free,
        locked=locked,
        faults=faults,
        rest=rest,
        acceleration={guess.name: _acceleration(guess, inertia[guess.name]) for guess in free},
        inertia=inertia,
        feet=guess_feet(robot) if floating and geometry else (),
        pairs=guess_pairs(robot),
        geometry=geometry,
        geometry_fault=geometry_fault,
        review=review_pairs(robot, rng, n_random=100) if geometry else None,
    )


def _locked(guesses: tuple[JointGuess, ...]) -> dict[str, float]:
    """Joints that others mimic, at the value in their range that is nearest to zero."""
    masters = {guess.follows for guess in guesses if guess.follows is not None}
    values = {}
    for guess in guesses:
        if guess.name in masters and guess.follows is None:
            low, high = guess.position or (0.0, 0.0)
            values[guess.name] = min(max(0.0, low), high)
    return values


def _rest(guess: JointGuess) -> float:
    """The angle nearest to zero that keeps a tenth of the range from both limits."""
    if guess.position is None:
        return 0.0
    low, high = guess.position
    room = 0.1 * (high - low)
    return round(min(max(0.0, low + room), high - room), 4)


def _faults(
    root: ElementTree.Element, joints: dict[str, ElementTree.Element], floating: bool, path: Path
) -> dict[str, str]:
    return {name: error.what for name, error in inertial_faults(root, joints, floating, path).items()}


def _acceleration(guess: JointGuess, inertia: float) -> float:
    """What a share of the torque limit gives the largest inertia, two digits, at most 30 rad/s²."""
    if guess.torque is None or inertia <= 0.0:
        return 5.0
    return float(f"{min(30.0, SHARE_OF_TORQUE * guess.torque / inertia):.2g}")


@dataclass(frozen=True)
class _StandIn:
    """Builds a robot with stand-ins for what a person has not said yet."""

    path: Path
    floating: bool
    free: tuple[JointGuess, ...]
    locked: dict[str, float]
    faults: tuple[str, ...]
    rest: dict[str, float]

    def with_geometry(self) -> tuple[Robot, str | None, str | None]:
        """Robot with the first kind of geometry that can be built; then the kind, or None and why not."""
        reasons = []
        for kind in ("collision", "visual"):
            robot = self.robot(kind)
            try:
                collision_shapes(robot)
            except RobotError as error:
                reasons.append(f"{kind}: {error.what}")
                continue
            return robot, kind, None
        return self.robot("authored"), None, "; ".join(reasons)

    def robot(self, geometry: str) -> Robot:
        said = "stand-in"
        one = {"default": 1.0, "source": said}
        content = {
            "schema": "excite.robot/1",
            "name": said,
            "title": said,
            "model": {
                "path": str(self.path.resolve()),
                "acknowledged": dict.fromkeys(self.faults, said),
                "source": said,
            },
            "base": "floating" if self.floating else "fixed",
            "locked_joints": self.locked,
            "posture": {"joints": self.rest, "base_height": 0.0, "source": said},
            "limits": {
                "position": {
                    "joints": {g.name: (-np.pi, np.pi) for g in self.free if g.position is None},
                    "source": said,
                },
                **{name: one for name in ("velocity", "acceleration", "jerk", "torque")},
            },
            "sensors": {
                "rate_hz": 1.0,
                "noise_position": 0.0,
                "joint_torque": "link_side",
                "wrench": self._wrench(),
                "source": said,
            },
            "feet": self._feet(),
            "controller": {"kp": one, "kd": one},
            "collision": {"geometry": geometry, "margin": 0.01, "source": said},
        }
        try:
            description = RobotDescription.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            field = ".".join(str(part) for part in first["loc"])
            what = f"cannot be described: {field} {first['msg']}"
            raise RobotError(
                what, source=self.path, remedy="correct the model, or rename its file"
            ) from error
        return build_robot(description, self.path)

    def _feet(self) -> list[dict[str, object]]:
        """One foot, for the schema's sake, on the root link."""
        if not self.floating:
            return []
        corners = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        root = parse_urdf(self.path)
        children = {str(child.get("link")) for child in root.iterfind("joint/child")}
        link = next(str(e.get("name")) for e in root.findall("link") if e.get("name") not in children)
        return [{"name": "foot", "link": link, "sole": corners, "friction": 1.0, "source": "stand-in"}]

    def _wrench(self) -> list[dict[str, object]]:
        if not self.floating:
            return []
        link = self._feet()[0]["link"]
        return [
            {
                "name": "foot",
                "kind": "foot_ft",
                "link": link,
                "foot": "foot",
                "noise_force": 1.0,
                "noise_moment": 1.0,
            }
        ]
