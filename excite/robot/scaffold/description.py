"""A first ``robot.yaml`` for a URDF of one's own: what could be derived, and what a person must say.

What only a person knows is written as ``null`` behind a ``FILL IN:`` comment, so that loading the file
before it is complete names the first field that is still open.
"""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from excite.errors import RobotError
from excite.robot.scaffold.draft import Draft
from excite.robot.scaffold.guesses import (
    JointGuess,
    guess_feet,
    guess_floating,
    guess_joints,
    guess_pairs,
    joint_inertias,
)
from excite.robot.scaffold.stand_in import StandIn
from excite.robot.scaffold.text import render
from excite.robot.shapes.ignored_pairs import review_pairs
from excite.robot.urdf.inertia import inertial_faults
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MAX_NAME, check_tree
from excite.robot.weights import check_weights

SHARE_OF_TORQUE = 0.3
"""Share of the torque limit that a proposed acceleration limit may use on the joint's own inertia."""


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
    stand_in = StandIn(path, floating, free, locked, tuple(faults), rest)
    built = stand_in.with_geometry()
    robot, geometry = built.robot, built.kind
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
        geometry_fault=built.fault,
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
