"""The format of a simulator: what is written of a robot, how it is read again, and what the format has no place for."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import ClassVar
from xml.etree.ElementTree import Element, TreeBuilder, tostring
from xml.parsers import expat

import numpy as np

from excite.arrays import Array
from excite.errors import RobotError, raised_as
from excite.export.models.verification import Reading, States
from excite.formats.documents import parse_xml
from excite.identification.identified_parameters import IdentifiedParameters
from excite.results import Name, Stated
from excite.robot.robot import Robot
from excite.simulation.true_parameters import Drives, nominal_drives

JOINT_TERMS = {"viscous": "N·m·s/rad", "coulomb": "N·m", "armature": "kg·m²"}
"""What simulators know of a joint beside its bodies, and its unit; the rest of what is identified they do not have."""

SERVO_TERMS = {
    "kp": "N·m/rad",
    "kd": "N·m·s/rad",
    "torque_limit": "N·m",
    "velocity_limit": "rad/s",
    "delay": "s",
}
"""What simulators know of the servo of a joint; of sliding joints with N and m in place of N·m and rad."""


@dataclass(frozen=True, eq=False)
class Rendered:
    """The files of a robot in a format.

    Attributes:
        files: contents by name in the folder, the one that a simulator opens first.
        notes: what a user of them should know, one sentence each.
        changed: links (or bodies) whose inertial is another one than the robot's description has.
        beside: name of the file with the model, where another one, which configures it, is opened first.
    """

    files: Mapping[str, bytes]
    notes: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    beside: str = ""

    @property
    def main(self) -> str:
        """Name of the file that a simulator opens."""
        return next(iter(self.files))

    @property
    def model(self) -> str:
        """Name of the file with the robot's bodies and joints."""
        return self.beside or self.main


class ModelFormat(ABC):
    """A format for identified robots.

    Attributes:
        name: what users type.
        summary: one line for help texts.
        held: by term of :data:`JOINT_TERMS` and :data:`SERVO_TERMS` that it holds, what it is called there.
        lacks: by term that it does not hold, what that means in the simulator.
        tolerance: how far what is read again may be off, relative to the largest torque and to each link's size.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    held: ClassVar[Mapping[str, str]]
    lacks: ClassVar[Mapping[str, str]] = {}
    tolerance: ClassVar[float] = 1e-9

    @abstractmethod
    def render(self, subject: Subject) -> Rendered:
        """The files.

        Raises:
            InputError: the format takes no such robot.
        """

    @abstractmethod
    def read(self, subject: Subject, rendered: Rendered, states: States) -> Reading:
        """The robot as the format's reader understands the files; raises InputError where it refuses them.

        Args:
            subject: for the robot's names and joints; none of its values.
            states: in which its torques are asked for.
        """

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """Terms of servos that files of this subject hold."""
        return tuple(term for term in SERVO_TERMS if term in self.held)

    def exact(self, subject: Subject) -> bool:
        """Whether the whole robot has to be the one that was found, and not only the links that changed."""
        return True


# What is written for a simulator: a robot, the parameters that were found for it, and where the files will
# stand.


@dataclass(frozen=True)
class Lost(Stated):
    """Something that was found and that the format has no place for.

    Attributes:
        parameter: its name, such as ``armature``.
        where: joint, link or the whole robot.
        value: as it was found [SI]; null where it is no number.
        why: what the format lacks, and what to do.
    """

    parameter: Name
    where: Name
    value: float | None
    why: str

    def __str__(self) -> str:
        value = "" if self.value is None else f" ({self.value:.4g})"
        return f"{self.parameter} of {self.where}{value}: {self.why}"


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot as it is to be written.

    Attributes:
        robot: the robot, nominal.
        found: the parameters of its bodies and drives that were found.
        folder: folder that the files will stand in; paths of meshes are relative to it.
        template: the MuJoCo model that the robot came as; None for another kind of model.
        beyond: what was found and what no robot model has, such as an encoder's zero.
        delay_s: how late the joints' servos follow what they are told; None where that was not found [s].
        force: whether parameters that no rigid body has are written all the same, where the format can.
    """

    robot: Robot
    found: IdentifiedParameters
    folder: Path
    template: Path | None = None
    beyond: tuple[Lost, ...] = ()
    delay_s: float | None = None
    force: bool = False

    @property
    def parameters(self) -> Array:
        """Inertial parameters, ``(10·n_segments,)``, pinocchio's order, joint frames [SI]."""
        return self.found.inertial

    @property
    def drives(self) -> dict[str, float]:
        """Parameters of the drives by name, such as ``viscous.JOINT`` [SI]."""
        return self.found.by_drive()

    @property
    def stem(self) -> str:
        """Name of the files, without suffix."""
        return re.sub(r"[^A-Za-z0-9_-]", "_", self.robot.name) or "robot"

    def term(self, name: str) -> Array:
        """A term of all joints as it was found, ``(n_joints,)``; NaN where it was not, or no joint has it."""
        values = (self.drives.get(f"{name}.{joint}", np.nan) for joint in self.robot.joint_names)
        return np.array([value if value >= 0.0 else np.nan for value in values])

    @cached_property
    def declared(self) -> Drives:
        """The drives that the robot's own description states."""
        return nominal_drives(self.robot)

    def written(self, name: str) -> Array:
        """A term of all joints for a file that is made anew, one of :data:`JOINT_TERMS` or :data:`SERVO_TERMS`.

        Those of joints are as found, else as the robot's description has them; those of servos are NaN where they are
        not known.
        """
        if name in SERVO_TERMS:
            return self.servo(name)
        found = self.term(name)
        return np.asarray(np.where(np.isfinite(found), found, getattr(self.declared, name)))

    def servo(self, name: str) -> Array:
        """A term of all joints' servos, one of :data:`SERVO_TERMS`, ``(n_joints,)``; NaN where it is not known."""
        if name == "velocity_limit":
            return self.robot.limits.velocity
        if name == "delay":
            late = np.nan if self.delay_s is None else self.delay_s
            return np.full(self.robot.n_joints, late)
        return np.asarray(getattr(self.declared, name))

    @property
    def changed_links(self) -> tuple[str, ...]:
        """Links whose parameters are others than the robot's."""
        differ = (self.parameters != self.robot.nominal_parameters).reshape(-1, 10).any(axis=1)
        return tuple(link for link, other in zip(self.found.links, differ, strict=True) if other)


# Paths in a model's text that still name the same files where the text stands in another folder.


def relocate_path(name: str, old: Path, new: Path) -> str:
    """A path relative to a folder, as seen from another; one that is absolute, or a URI, as it is."""
    if not name or "://" in name or PurePosixPath(name).is_absolute() or "\0" in name:
        return name
    return Path(os.path.relpath(old.resolve() / name, new.resolve())).as_posix()


def move_attribute(element: Element, attribute: str, old: Path, new: Path) -> None:
    """Let an attribute that holds a path name the same file from another folder."""
    there = relocate_path(element.get(attribute, ""), old, new)
    if there and old.resolve() != new.resolve() and there.isascii() and not set(there) & set("\"'<>&"):
        element.set(attribute, there)


_ATTRIBUTE = re.compile(rb"\s+([^\s=/>]+)\s*=\s*([\"'])(.*?)\2", re.DOTALL)
_TAG = re.compile(rb"<[^\s/>]+")


class XmlText:
    """An XML text and its elements: edit ``root``, and :meth:`edited` is the text with what changed in it.

    Attributes of elements may change, and elements may be put in, each before those that its parent has.

    Args:
        content: the file, in UTF-8 or another encoding that contains ASCII.
        source: what to name in errors.

    Raises:
        RobotError: not well-formed, UTF-16, or with declared entities.
    """

    @raised_as(RobotError)
    def __init__(self, content: bytes, source: Path | str):
        if content[:2] in {b"\xff\xfe", b"\xfe\xff"}:
            raise RobotError("is UTF-16", source=source, remedy="save it as UTF-8")
        parse_xml(content, Path(source))
        self._content = content
        self._read: dict[Element, tuple[int, dict[str, str]]] = {}
        builder, parser = TreeBuilder(), expat.ParserCreate()

        def note_element(tag: str, attributes: dict[str, str]) -> None:
            self._read[builder.start(tag, attributes)] = parser.CurrentByteIndex, dict(attributes)

        parser.StartElementHandler = note_element
        parser.EndElementHandler = builder.end
        parser.Parse(content, True)
        self.root: Element = builder.close()

    def edited(self) -> bytes:
        """The text with all edits made."""
        content = self._content
        # From the end, so that places before an edit hold.
        for element, (start, before) in reversed(self._read.items()):
            new = [child for child in element if child not in self._read]
            if not new and element.attrib == before:
                continue
            tag = _TAG.match(content, start)
            last = start if tag is None else tag.end()
            edits: list[tuple[int, int, bytes]] = []
            while match := _ATTRIBUTE.match(content, last):
                name, last = match[1].decode(), match.end()
                if name not in element.attrib:
                    edits.append((*match.span(), b""))
                elif element.attrib[name] != before[name]:
                    # Inside the quotes, which stay as they are.
                    edits.append((*match.span(3), element.attrib[name].encode("ascii")))
            more = (f' {name}="{value}"' for name, value in element.attrib.items() if name not in before)
            edits.append((last, last, "".join(more).encode("ascii")))
            if new:
                lead = content[content.rfind(b"\n", 0, start) + 1 : start]
                indent = b"\n" if lead.strip() else b"\n" + lead
                inside = b"".join(indent + b"  " + tostring(child).replace(b" />", b"/>") for child in new)
                head = content.index(b">", last) + 1
                if content[head - 2 : head] == b"/>":
                    closing = b">" + inside + indent + b"</" + element.tag.encode() + b">"
                    edits.append((head - 2, head, closing))
                else:
                    edits.append((head, head, inside))
            for first, end, text in reversed(edits):
                content = content[:first] + text + content[end:]
        return content
