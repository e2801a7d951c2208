"""What a model file is written from: the parameters of a robot's bodies and drives, however they were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.atomic import write_text
from excite.errors import InputError, RobotError
from excite.finding import list_names
from excite.formats.tables import csv_text
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import (
    ROUNDING,
    are_no_bodies,
    central_inertia_matrices,
    parameters_of_pseudo_inertia,
    pseudo_inertia_matrices,
)
from excite.identification.result import Identification
from excite.logs.robot import is_bare
from excite.robot.description import ControllerBlock
from excite.robot.init_robot.description import draft_description
from excite.robot.robot import Robot
from excite.robot.urdf.converted import Said
from excite.robot.urdf.writing import number_text

Found = Identification | IdentifiedParameters
"""An identification, or the parameters alone, however they were found."""


def model_parameters(found: Found, *, drives: bool = True) -> IdentifiedParameters:
    """What a model is written of; without ``drives`` of the bodies alone."""
    identified = found.identified if isinstance(found, Identification) else found
    return identified if drives else replace(identified, drive_names=(), drives=np.zeros(0))


def drive_attributes(
    found: IdentifiedParameters, joint: str, attributes: Mapping[str, str], notes: list[str]
) -> dict[str, str]:
    """Texts of the attributes that hold a joint's friction and rotor inertia, of those that were found.

    Args:
        joint: name of the joint.
        attributes: by term what holds it in the file.
        notes: gets a sentence for each that is not written.
    """
    drives, texts = found.by_drive(), {}
    for term, attribute in attributes.items():
        value = drives.get(f"{term}.{joint}")
        if value is not None and value < 0.0:
            notes.append(f"{joint}: {term} was identified as {value:.3g}, below zero; not written")
        elif value is not None:
            texts[attribute] = number_text(value)
    return texts


# One segment's identified parameters, given to the links of a file that it consists of.


class InconsistentModelError(InputError):
    """Identified parameters that no rigid body has, and that a simulator would refuse or blow up on.

    Attributes:
        links: links of the segments concerned.
    """

    def __init__(self, links: Sequence[str], *, can_be_forced: bool = True):
        self.links = tuple(links)
        super().__init__(
            f"no rigid body has the identified parameters of {list_names(self.links, 6)}",
            source="model",
            remedy="identify with a method that guarantees physical consistency (lmi, cls3)"
            + (", or force the writing" if can_be_forced else ""),
        )


@dataclass(frozen=True, eq=False)
class Member:
    """A link (or body) of a file that moves with a segment.

    Attributes:
        name: its name in the file.
        placement: its frame in the frame of the segment's joint.
        parameters: ``(10,)`` what the file says of it, about its own frame; None where it says nothing.
    """

    name: str
    placement: pin.SE3
    parameters: Array | None


@dataclass(frozen=True, eq=False)
class Split:
    """What each link of a segment gets.

    Attributes:
        shares: ``(10,)`` parameters about its own frame by link, links that do not change left out.
        note: what had to be decided, in one sentence; empty where there was no choice.
    """

    shares: dict[str, Array]
    note: str


def split_segment(total: Array, members: Sequence[Member]) -> Split:
    """Divide a segment's parameters among the links that it consists of.

    Only their sum shows in any motion. Links fixed to the moving one keep what the file says of them, and the
    moving link gets the remainder; where the file says nothing of the moving link, the heaviest one does. If
    no body has that remainder, the fixed links keep as large a share of their own as leaves it physical. A fixed link
    that states inertia and no mass is no body, and readers differ in what they make of it: the remainder holds it.

    Args:
        total: ``(10,)`` the segment's parameters about its joint's frame.
        members: its links, the moving one first.

    Returns:
        The shares.
    """
    stated = [(member, member.parameters) for member in members if member.parameters is not None]
    main = members[0]
    if main.parameters is None and stated:
        main = max(stated, key=lambda item: float(item[1][0]))[0]
    others = [(member, own) for member, own in stated if member is not main and own.any()]
    massless = [member.name for member, own in others if own[0] <= 0.0]
    others = [(member, own) for member, own in others if own[0] > 0.0]
    pseudo = pseudo_inertia_matrices(total)[0]
    fixed = [moved_pseudo(pseudo_inertia_matrices(own)[0], member.placement) for member, own in others]
    carried = np.sum([np.zeros((4, 4)), *fixed], axis=0)
    share = _physical_share(pseudo, carried)
    rest = moved_pseudo(pseudo - share * carried, main.placement.inverse())
    shares = {main.name: parameters_of_pseudo_inertia(rest)} | dict.fromkeys(massless, np.zeros(10))
    notes = (
        [f"{main.name}: holds the inertia of {', '.join(massless)}, which had no mass"] if massless else []
    )
    names = ", ".join(member.name for member, _ in others)
    if share < 1.0:
        shares |= {member.name: share * own for member, own in others}
        notes.append(
            f"{main.name}: links fixed to it ({names}) got {100.0 * share:.0f} % of their nominal inertia"
        )
    elif others:
        notes.append(f"{main.name}: holds the change of all that is fixed to it; {names} stayed nominal")
    return Split(shares, "; ".join(notes))


def moved_pseudo(pseudo: Array, placement: pin.SE3) -> Array:
    """Pseudo-inertia of a body about the frame in which its own frame has that placement, ``(4, 4)``."""
    transform = placement.homogeneous
    return np.asarray(transform @ pseudo @ transform.T)


class CentredBody(NamedTuple):
    """Mass [kg], centre of mass ``(3,)`` [m], inertia about that along the link's axes ``(3, 3)`` [kg·m²]."""

    mass: float
    lever: Array
    inertia: Array


def centred_body(parameters: Array, link: str) -> CentredBody:
    """A link's ten parameters as a file states them; raises InconsistentModelError without mass."""
    mass = float(parameters[0])
    if not np.any(parameters):
        return CentredBody(0.0, np.zeros(3), np.zeros((3, 3)))
    if mass == 0.0 or not np.isfinite(parameters).all():
        raise InconsistentModelError([link], can_be_forced=False)
    # A body of negative mass, which only a forced file holds, is the opposite of one.
    sign = np.sign(mass)
    return CentredBody(mass, parameters[1:4] / mass, sign * central_inertia_matrices(sign * parameters)[0])


def inconsistent_links(robot: Robot, parameters: Array) -> tuple[str, ...]:
    """Links of the segments whose pseudo-inertia is not positive semidefinite."""
    flags = are_no_bodies(parameters)
    return tuple(segment.link for segment, flag in zip(robot.segments, flags, strict=True) if flag)


def changed_segments(robot: Robot, found: IdentifiedParameters, *, force: bool) -> tuple[int, ...]:
    """Segments whose identified parameters are not the model's own, checked.

    Raises:
        InputError: the identification is of another robot.
        InconsistentModelError: a changed segment is no body, and ``force`` is not set.
    """
    links = tuple(segment.link for segment in robot.segments)
    if found.links != links:
        raise InputError(
            f"is of another robot than {robot.name}",
            source="identification",
            remedy="give the robot that it was made for",
        )
    new, old = found.inertial.reshape(-1, 10), robot.nominal_parameters.reshape(-1, 10)
    changed = tuple(int(k) for k in np.flatnonzero((new != old).any(axis=1)))
    bad = set(inconsistent_links(robot, found.inertial)) & {links[k] for k in changed}
    if bad and not force:
        raise InconsistentModelError([link for link in links if link in bad])
    return changed


def _physical_share(pseudo: Array, carried: Array) -> float:
    """Greatest share of ``carried`` (at most 1) that leaves ``pseudo`` a body."""
    least = np.linalg.eigvalsh(pseudo - carried)[0]
    values, vectors = np.linalg.eigh(pseudo)
    if least >= -ROUNDING * values[-1] or values[0] < -ROUNDING * values[-1]:
        return 1.0
    if values[0] <= ROUNDING * values[-1]:
        return 0.0
    half = vectors / np.sqrt(values)
    return min(1.0, 0.9 / float(np.linalg.eigvalsh(half.T @ carried @ half)[-1]))


# What identification changed, parameter by parameter, with uncertainties.

_NAMES = {
    "mass": ("m",),
    "first_moment": ("mx", "my", "mz"),
    "inertia": ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
}
_UNITS = {"mass": "kg", "first_moment": "kg·m", "inertia": "kg·m²"}


@dataclass(frozen=True)
class Difference:
    """One parameter, nominal and identified [SI], about the joint frame.

    Attributes:
        link: link of its segment.
        segment: readable name of the segment.
        parameter: ``m``, ``mx`` … ``Iyz``.
        unit: its unit.
        nominal: value of the model as supplied.
        identified: value found.
        std: standard deviation of the identified value given data and nominal model; None where not known.
        determined: share of the nominal model's uncertainty that the data have removed, 0 to 1; None likewise.
    """

    link: str
    segment: str
    parameter: str
    unit: str
    nominal: float
    identified: float
    std: float | None
    determined: float | None

    @property
    def change(self) -> float:
        """Identified minus nominal."""
        return self.identified - self.nominal

    @property
    def clear(self) -> bool:
        """Whether the data determined it (by more than half) and it moved by more than two deviations."""
        measured = self.determined is not None and self.determined > 0.5
        return measured and self.std is not None and abs(self.change) > 2.0 * self.std


def find_differences(standard_parameters: Mapping[str, Mapping[str, Any]]) -> tuple[Difference, ...]:
    """The table of an identification, ten rows a segment in the model's order.

    Args:
        standard_parameters: that block of an ``excite.identification/1`` document; links without nominal
            values in it are left out.
    """
    rows = []
    for link, block in standard_parameters.items():
        nominal, std, determined = (block.get(key) or {} for key in ("nominal", "std", "determined"))
        for kind, names in _NAMES.items():
            for k, name in enumerate(names):
                kept = [source.get(kind) for source in (nominal, block, std, determined)]
                found = [one[k : k + 1] if isinstance(one, list) else [one] for one in kept]
                values = [float(one[0]) if one and one[0] is not None else None for one in found]
                if values[0] is None or values[1] is None:
                    continue
                segment = str(block.get("name") or link)
                rows.append(
                    Difference(link, segment, name, _UNITS[kind], values[0], values[1], values[2], values[3])
                )
    return tuple(rows)


def save_differences(rows: Sequence[Difference], path: Path) -> Path:
    """Write the table as CSV, numbers with all digits [SI]."""
    names = ("link", "parameter", "unit", "nominal", "identified", "change", "std", "determined")
    values = [[*(getattr(row, name) for name in names), int(row.clear)] for row in rows]
    return write_text(path, csv_text((*names, "clear"), values))


# Servos of a robot of which a log brought no more than a bare URDF.

ASSUMED = (
    "nothing that was read states the servos' gains: those of the file are assumed so that the servos carry the robot; "
    "set your controller's, or identify with a robot.yaml that has them"
)
"""What a user of a file with such servos should know."""


def with_servos(robot: Robot) -> Robot:
    """The robot with gains as ``excite init-robot`` assumes them, in place of a bare URDF's placeholders."""
    if not is_bare(robot):
        return robot
    try:
        made = draft_description(robot.source, None, np.random.default_rng(0), Said(floating=robot.floating))[
            "controller"
        ]
    except RobotError:
        return robot
    if not set(robot.joint_names) <= set(made["kp"]["joints"]):
        return robot
    own = {
        gain: {**block, "joints": {name: block["joints"][name] for name in robot.joint_names}}
        for gain, block in made.items()
    }
    servos = ControllerBlock.model_validate(own)
    return replace(robot, description=robot.description.model_copy(update={"controller": servos}))
