"""A load as the maker of an arm's controller takes it: script, load data or service, in its frame and its units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from typing import Any

import numpy as np
import pinocchio as pin

from excite.atomic import write_text
from excite.errors import InputError, UnknownNameError
from excite.formats.documents import read_yaml
from excite.identification.load import WeighedLoad
from excite.robot.robot import Robot


@dataclass(frozen=True)
class PayloadFormat:
    """How a maker writes a load: a row of ``payload_formats.yaml``, which says what each field is."""

    suffix: str
    flange: str
    text: str
    source: str
    rated: Mapping[str, float]
    length: float = 1.0
    moment: float = 1.0
    largest: float = np.inf

    def rated_payload(self, arm: str) -> float:
        """What an arm of that name may carry [kg]; of one that is not known what the strongest of its maker may."""
        fits = (kg for start, kg in self.rated.items() if re.match(rf"(?:{start})(?![a-z0-9])", arm.lower()))
        return next(fits)


PAYLOAD_FORMATS = {
    name: PayloadFormat(**row)
    for name, row in read_yaml(Path(__file__).with_name("payload_formats.yaml")).items()
}


def find_payload_format(name: str) -> PayloadFormat:
    """The format of that name; raises UnknownNameError."""
    if name not in PAYLOAD_FORMATS:
        raise UnknownNameError("format", name, sorted(PAYLOAD_FORMATS))
    return PAYLOAD_FORMATS[name]


@dataclass(frozen=True, eq=False)
class Payload:
    """A load as a controller takes it.

    Attributes:
        format: name in ``PAYLOAD_FORMATS``.
        flange: frame of the robot's description that all of it is in.
        body: mass [kg], centre of mass [m] and inertia about it [kg·m²].
        point_mass: whether the inertia is left at nought, since the logs do not tell it.
        text: what is written.
    """

    format: str
    flange: str
    body: pin.Inertia
    point_mass: bool
    text: str

    def summary(self) -> str:
        """What is in the file, for whoever enters it."""
        x, y, z = self.body.lever
        inertia = (
            "inertia 0, as of a point: the logs do not tell it" if self.point_mass else "inertia about it"
        )
        where = f"centre of mass ({1e3 * x:.1f}, {1e3 * y:.1f}, {1e3 * z:.1f}) mm in {self.flange}"
        return f"{self.format}: {self.body.mass:.3f} kg, {where}, {inertia}\n{self.text}"

    def to_json(self) -> dict[str, Any]:
        """What stands under ``controller`` in ``excite.load/1``; the inertia about the centre of mass."""
        return {
            "format": self.format,
            "flange": self.flange,
            "mass": self.body.mass,
            "center_of_mass": self.body.lever.tolist(),
            "inertia": self.body.inertia.tolist(),
            "point_mass": self.point_mass,
            "text": self.text,
        }

    def write(self, folder: Path) -> Path:
        """Write ``load.SUFFIX`` to a folder; returns the file."""
        folder.mkdir(parents=True, exist_ok=True)
        return write_text(folder / f"load{PAYLOAD_FORMATS[self.format].suffix}", self.text)


def payload_for(load: WeighedLoad, robot: Robot, format: str, flange: str | None = None) -> Payload:
    """A load in the frame and units of an arm's controller, read back and compared.

    The inertia is written where the logs tell its moments to less than the largest of them, and a body can have it.
    Else it is nought, which all makers take for a point mass.

    Args:
        load: the load, about the frame of the robot's last joint.
        robot: the arm that carries it.
        format: a name in ``PAYLOAD_FORMATS``.
        flange: frame at the arm's flange as its maker has it; found by its usual name where left out.

    Returns:
        The load with its text.

    Raises:
        UnknownNameError: no such format.
        InputError: mass or centre are not told by the logs, the arm may not carry so much, or no frame is the flange.
    """
    form = find_payload_format(format)
    if not (load.determined[0] and load.seen[:4].all()):
        raise InputError(
            "are not told by these logs",
            source="load",
            field="mass and centre",
            remedy="record motions that turn the last joints in several postures, or state --mass",
        )
    rated = form.rated_payload(robot.name)
    if not 0.0 < load.mass <= rated:
        raise InputError(
            f"is {load.mass:.3f} kg, and {robot.name} is rated for {rated:g} kg",
            source="load",
            field="mass",
            remedy="see whether the first log is that without the load, both are of this arm, their torques in N·m, "
            f"and its maker that of {format}",
        )
    name, placement = _find_flange(robot, form, flange)
    body = placement.actInv(pin.Inertia.FromDynamicParameters(load.parameters))
    moments = np.linalg.eigvalsh(body.inertia)
    told = load.seen[4:].all() and load.half_width_95[[4, 6, 9]].max() < moments[2]
    point = not told or moments[0] <= 0.0 or moments[2] > moments[0] + moments[1]
    inertia = np.zeros((3, 3)) if point else body.inertia
    if "{xx}" in form.text and "{xy}" not in form.text:
        inertia = np.diag(np.diag(inertia))
    if np.abs(inertia).max() * form.moment > form.largest:
        raise InputError(
            f"is beyond {form.largest:g} kg·m²",
            source="load",
            field="inertia",
            remedy="see whether lengths of the description are metres",
        )
    body = pin.Inertia(body.mass, body.lever, inertia)
    text = _render_load(body, form)
    back = read_payload(text, format)
    if not np.allclose(back.toDynamicParameters(), body.toDynamicParameters(), rtol=1e-5, atol=1e-5):
        raise InputError("does not come back as it was written", source=format, field="load")
    return Payload(format, name, body, bool(point), text)


def _find_flange(robot: Robot, form: PayloadFormat, asked: str | None) -> tuple[str, pin.SE3]:
    """The flange's name, and where it is in the frame of the last joint."""
    last = robot.model.njoints - 1
    frames = {frame.name: frame.placement for frame in robot.model.frames if frame.parentJoint == last}
    pattern = form.flange if asked is None else re.escape(asked)
    name = next((name for name in frames if re.fullmatch(pattern, name)), None)
    if name is None:
        raise InputError(
            "is not fixed to the last joint" if asked else "is not found by its name",
            source=robot.name,
            field=asked or "flange",
            remedy=f"name the flange's frame with --flange: one of {', '.join(frames)}",
        )
    return name, frames[name]


def _render_load(body: pin.Inertia, form: PayloadFormat) -> str:
    moments, axes = np.linalg.eigh(body.inertia)
    axes[:, 2] *= np.linalg.det(axes)
    turn = pin.Quaternion(axes)
    values = {
        "m": [body.mass],
        "x y z": form.length * body.lever,
        "xx xy yy xz yz zz": form.moment * body.inertia[np.tril_indices(3)],
        "j1 j2 j3": form.moment * moments,
        "c b a": np.degrees(pin.rpy.matrixToRpy(axes)),
        "q1 q2 q3 q4": [turn.w, turn.x, turn.y, turn.z],
    }
    return form.text.format(
        **{
            name: _format_number(value)
            for names, row in values.items()
            for name, value in zip(names.split(), row, strict=True)
        }
    )


def _format_number(value: float) -> str:
    """A number without an exponent, which not every controller reads."""
    text = f"{round(value, 6) + 0.0:.6f}".rstrip("0")
    return text + "0" * text.endswith(".")


def read_payload(text: str, format: str) -> pin.Inertia:
    """The load that a text of :func:`payload_for` holds, in the flange's frame [SI].

    Raises:
        InputError: it is no such text.
    """
    form, pattern = find_payload_format(format), ""
    for literal, name, _, _ in Formatter().parse(form.text):
        pattern += re.escape(literal)
        if name:
            pattern += f"(?P={name})" if f"<{name}>" in pattern else rf"(?P<{name}>[-.\d]+)"
    found = re.fullmatch(pattern, text)
    if found is None:
        raise InputError("is no load as excite writes it", source=format, field="text")
    n = dict.fromkeys(("xy", "xz", "yz"), 0.0) | {
        name: float(text) for name, text in found.groupdict().items()
    }
    if "j1" not in n:
        inertia = np.array(
            [[n["xx"], n["xy"], n["xz"]], [n["xy"], n["yy"], n["yz"]], [n["xz"], n["yz"], n["zz"]]]
        )
    else:
        axes = (
            pin.rpy.rpyToMatrix(*np.radians([n["c"], n["b"], n["a"]]))
            if "a" in n
            else pin.Quaternion(n["q1"], n["q2"], n["q3"], n["q4"]).normalized().matrix()
        )
        inertia = axes @ np.diag([n["j1"], n["j2"], n["j3"]]) @ axes.T
    lever = np.array([n["x"], n["y"], n["z"]]) / form.length
    return pin.Inertia(n["m"], lever, inertia / form.moment)
