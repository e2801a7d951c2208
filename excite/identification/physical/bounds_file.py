"""Files of bounds of physical parameters, ``excite.physical_bounds/1``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from excite.atomic import write_text
from excite.errors import InputError
from excite.formats.documents import check_content, read_yaml
from excite.identification.estimators.settings import BodySettings
from excite.identification.inertia import NAMES
from excite.identification.physical.bounds import InertiaRules, Interval, KnownBounds
from excite.identification.physical.default_bounds import default_bounds, derived_boxes
from excite.robot.quantities import MAX_INERTIA
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS

SCHEMA = "excite.physical_bounds/1"


def _check_pair(pair: Interval) -> Interval:
    if not pair[0] < pair[1]:
        low, high = pair
        raise ValueError(
            f"has bounds [{low:g}, {high:g}] with nothing between: put the lower one below the upper"
        )
    return pair


def _refuse_truth(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("is no number")
    return value


# Of texts too: YAML 1.1 reads ``1e-4`` as one.
_Number = Annotated[
    float,
    BeforeValidator(_refuse_truth, json_schema_input_type=float | str),
    Field(ge=-MAX_INERTIA, le=MAX_INERTIA, allow_inf_nan=False),
]
_Pair = Annotated[tuple[_Number, _Number], AfterValidator(_check_pair)]
_Name = Literal["m", "cx", "cy", "cz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]


class BoundsEntry(BaseModel):
    """A pair among other things that are said of it."""

    bounds: _Pair


class BoundsDocument(BaseModel):
    """What is known of a robot's physical parameters, each [lower, upper] in SI."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_: Literal["excite.physical_bounds/1"] = Field(alias="schema")
    source: str | None = Field(default=None, description="where the numbers come from")
    total_mass: _Pair | None = Field(default=None, description="mass of all links together [kg]")
    rules: InertiaRules | None = None
    links: dict[str, dict[_Name, _Pair]] | None = Field(
        default=None,
        description="by link: mass, centre of mass, inertias about it along the joint frame's axes",
    )
    drives: dict[str, _Pair] | None = Field(default=None, description="by TERM.JOINT")
    parameters: dict[str, _Pair | BoundsEntry] | None = Field(
        default=None, description="the same in one level, by LINK.NAME"
    )


def load_bounds(path: str | Path, robot: Robot) -> KnownBounds:
    """Read what a file ``excite.physical_bounds/1`` says of a robot; it may leave out whatever is not known.

    ``links: {LINK: {m: [lower, upper], cx: …}}``, ``drives: {viscous.JOINT: […]}``, ``total_mass: […]`` and
    ``rules``; ``parameters: {LINK.m: […]}`` says the same in one level.

    Args:
        path: the YAML file.
        robot: the robot; names are checked against it.

    Returns:
        The bounds, checked against the robot.

    Raises:
        InputError: malformed, not finite or empty bounds, or of something that the robot does not have; names
            the file, the field and what to do.
    """
    path, begin = Path(path), f"start it with schema: {SCHEMA}"
    names, joints = " or ".join(DRIVE_TERMS), ", ".join(robot.joint_names)
    remedy = (
        f"write links: {{NAME: {{m: [lower, upper]}}}} with {', '.join(NAMES)}, rules as positive numbers; "
        f"write numbers up to {MAX_INERTIA:g}, or leave the line out"
    )
    document = check_content(BoundsDocument, read_yaml(path, remedy=begin), path, remedy=remedy)

    def refuse_unless(right: bool, field: str, what: str, remedy: str) -> None:
        if not right:
            raise InputError(what, source=path, field=field or None, remedy=remedy)

    links = tuple(segment.link for segment in robot.segments)
    own = f"links are {', '.join(links)}"
    parameters: dict[str, Interval] = {}
    drives: dict[str, Interval] = {}
    for field, name, pair in _bound_entries(document):
        link, _, kind = name.rpartition(".")
        term, _, joint = name.partition(".")
        of_body = field.startswith("links.") or (link in links and kind in NAMES)
        refuse_unless(link in links or not of_body, field, "is of no link of the robot", own)
        known = of_body or (term in DRIVE_TERMS and joint in robot.joint_names)
        allowed = f"write TERM.JOINT with {names} and one of the joints {joints}"
        refuse_unless(known, field, "is no parameter of the robot", allowed)
        empty = of_body and kind in ("m", "Ixx", "Iyy", "Izz") and pair[1] <= 0.0
        what = f"has bounds {list(pair)} and nothing positive between"
        refuse_unless(not empty, field, what, "masses and moments of inertia are positive")
        target = parameters if of_body else drives
        refuse_unless(name not in target, field, "is bounded twice", "keep one of them")
        target[name] = pair
    some = bool(parameters or drives or document.total_mass or document.rules)
    refuse_unless(some, "", "bounds nothing", "give links, drives or total_mass")
    rules = {} if document.rules is None else document.rules.model_dump(exclude_unset=True)
    for link in rules.get("slender", ()):
        refuse_unless(link in links, f"rules.slender.{link}", "is no link of the robot", own)
    return KnownBounds(parameters, drives, document.total_mass, rules, document.source or str(path))


def _bound_entries(document: BoundsDocument) -> Iterator[tuple[str, str, Interval]]:
    """Place in the file, name of the parameter and its bounds."""
    for link, block in (document.links or {}).items():
        yield from ((f"links.{link}.{name}", f"{link}.{name}", pair) for name, pair in block.items())
    yield from ((f"drives.{name}", name, pair) for name, pair in (document.drives or {}).items())
    for name, entry in (document.parameters or {}).items():
        yield name, name, entry.bounds if isinstance(entry, BoundsEntry) else entry


# A file of bounds to start from: those that apply where nothing is stated, with what each line means.

_DIGITS = 4
_USUAL_DRIVES = ("viscous", "coulomb")


def write_bounds_template(robot: Robot, path: str | Path) -> Path:
    """Write the bounds that :func:`~excite.identification.physical.default_bounds.default_bounds` derives.

    Rounded outwards, so that nothing that they allow is lost; friction stands in comments.

    Args:
        robot: the robot.
        path: the file to write.

    Returns:
        The file.

    Raises:
        InputError: the file cannot be written.
    """
    path = Path(path)
    bounds = default_bounds(robot, BodySettings(com_boxes=derived_boxes(robot)[0]))
    lines = [
        f"# What is known of {robot.name} before it is measured, for excite identify --bounds. Every line is",
        "# [lower, upper] and may be changed or left out; what is left out keeps the bounds written here.",
        "# Inertias are about the centre of mass, along the axes of the joint's frame.",
        f"schema: {SCHEMA}",
        f"total_mass: {_format_pair(*bounds.total_mass)}  # kg, all links; the surest one: weigh the robot",
        "links:",
    ]
    units = {"m": "  # kg", "cx": "  # m", "Ixx": "  # kg·m²"}
    for link, *ends in zip(bounds.links, bounds.lower.tolist(), bounds.upper.tolist(), strict=True):
        pairs = zip(NAMES, *ends, strict=True)
        lines.append(f"  {link}:")
        lines += [f"    {name}: {_format_pair(*pair)}{units.get(name, '')}" for name, *pair in pairs]
    lines.append("# drives:")
    for joint in robot.joint_names:
        lines += [f"#   {term}.{joint}: [0.0, 1.0]  # {DRIVE_TERMS[term].unit}" for term in _USUAL_DRIVES]
    write_text(path, "\n".join(lines) + "\n")
    return path


def _format_pair(low: float, high: float) -> str:
    return f"[{_round_outwards(low, math.floor)}, {_round_outwards(high, math.ceil)}]"


def _round_outwards(value: float, towards: Callable[[float], int]) -> str:
    """A few digits of a number, rounded away from the interval."""
    if value == 0.0:
        return "0.0"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - _DIGITS + 1)
    return repr(float(np.format_float_positional(towards(value / step) * step, _DIGITS, fractional=False)))
