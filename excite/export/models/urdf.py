"""A URDF with identified inertials: its author's text, with other numbers in ``<inertial>``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from excite.arrays import Array
from excite.errors import InputError, RobotError
from excite.export.models.model_format import (
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    load_urdf,
    move_attribute,
)
from excite.export.models.parameters import (
    Found,
    Member,
    centred_body,
    changed_segments,
    drive_attributes,
    model_parameters,
    moved_pseudo,
    parameters_of,
    split_segment,
)
from excite.export.models.verification import (
    States,
    WrittenModel,
    held_joints,
    mujoco_torques,
    pinocchio_torques,
    random_states,
    urdf_in_mujoco,
    write_verified,
)
from excite.export.models.xml_text import Element, XmlText, moment_texts, number_text
from excite.formats.documents import MAX_XML_BYTES, parse_xml
from excite.formats.file import read_bytes
from excite.identification.identified_parameters import IdentifiedParameters
from excite.identification.inertia import pseudo_inertia_matrices
from excite.robot.links import link_placement
from excite.robot.loading import model_file
from excite.robot.robot import Robot
from excite.robot.urdf.inertia import Inertial, read_inertial
from excite.robot.urdf.reading import parse_urdf
from excite.robot.urdf.tree import MOVING, WORLD, declare_world


class UrdfFormat(ModelFormat):
    """The URDF that the robot came as: comments, order, shapes and limits stay, inertials and ``<dynamics>`` change.

    A robot that came as MJCF has the URDF that was made of it.
    """

    name = "urdf"
    summary = "URDF, the author's text kept (ROS, pinocchio, Drake, PyBullet)"
    held: ClassVar[Mapping[str, str]] = {"viscous": "damping", "coulomb": "friction"}
    lacks: ClassVar[Mapping[str, str]] = {
        "armature": "URDF has no rotor inertia; add it where the simulator sets it",
        **dict.fromkeys(("kp", "kd", "delay"), "URDF describes no servo; set it in the controller"),
    }

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        edit = edited_urdf(subject.robot, subject.found, force=False)
        folder = model_file(subject.robot).parent
        for mesh in edit.text.root.everywhere("mesh"):
            move_attribute(edit.text, mesh, "filename", folder, subject.folder)
        return Rendered({f"{subject.stem}.urdf": edit.text.edited()}, edit.notes)

    def load(self, subject: Subject, rendered: Rendered, states: States) -> LoadedModel:
        """Read by pinocchio, ``<dynamics>`` by the XML's own words."""
        return load_urdf(subject.robot, rendered.files[rendered.main], states)


def write_urdf(
    robot: Robot,
    identification: Found,
    path: Path,
    *,
    drives: bool = False,
    force: bool = False,
) -> WrittenModel:
    """Write the robot's URDF with the identified inertials in place of its own.

    The original text is edited: geometry, comments, order and white space stay as they are, ``rpy`` of an
    inertial too (its moments are expressed in that frame), and links whose segment did not change are not
    touched. What is read back from the new text with pinocchio, and with MuJoCo where it can read the file,
    has to give the inverse dynamics of the identified parameters.

    Args:
        robot: the robot that was identified.
        identification: what was identified.
        path: file to write; mesh paths that are relative stay relative to it.
        drives: also write viscous and Coulomb friction that were identified into ``<dynamics>``.
        force: write parameters that no rigid body has, too.

    Returns:
        The file and what was checked.

    Raises:
        InconsistentModelError: a changed segment is no rigid body, and ``force`` is not set.
        InputError: the identification is of another robot, or the URDF has changed since it was loaded.
        NoSolutionError: pinocchio or MuJoCo does not give the identified parameters' torques (a bug here).
    """
    file, found = model_file(robot), model_parameters(identification, drives=drives)
    edit = edited_urdf(robot, found, force=force)
    notes = [*edit.notes, *_held_note(robot), *_mesh_note(edit.text, file, path)]
    content, states = edit.text.edited(), random_states(robot, found.inertial)
    in_mujoco = None
    try:
        in_mujoco = states.error(mujoco_torques(robot, urdf_in_mujoco(robot, content), states, drives=False))
    except InputError as error:
        notes.append(f"not checked with MuJoCo: {error.what}")
    in_pinocchio = states.error(pinocchio_torques(robot, content, states))
    written = WrittenModel(Path(path), edit.changed, tuple(notes), in_pinocchio, in_mujoco)
    return write_verified(content, written)


@dataclass(frozen=True, eq=False)
class UrdfEdit:
    """A URDF's text with its edits collected.

    Attributes:
        text: the text.
        changed: links whose inertial is another one.
        notes: what had to be decided, one sentence each.
    """

    text: XmlText
    changed: tuple[str, ...]
    notes: tuple[str, ...]


def edited_urdf(robot: Robot, found: IdentifiedParameters, *, force: bool) -> UrdfEdit:
    """The robot's URDF as its author left it, edited; arguments and errors as of :func:`write_urdf`."""
    changed = changed_segments(robot, found, force=force)
    file = model_file(robot)
    # Without the bare link from which a free base floats.
    loaded = {str(link.get("name")): link for link in parse_urdf(file).findall("link")}
    content = read_bytes(file, limit=MAX_XML_BYTES, error=RobotError)
    text = XmlText(content, file)
    if declare_world(parse_xml(content, file, RobotError)):
        text.insert_first(text.root, f'<link name="{WORLD}"/>')
    links = {str(link.attributes.get("name")): link for link in text.root.named("link")}
    links = {name: link for name, link in links.items() if name in loaded}
    members = _segment_members(robot, {name: loaded[name] for name in links}, file)
    _unchanged_since_loading(robot, members, file)
    notes = complete_limits(text, robot)
    written: list[str] = []
    ten = found.inertial.reshape(-1, 10)
    for segment in changed:
        split = split_segment(ten[segment], members[segment])
        if split.note:
            notes.append(split.note)
        for link, parameters in split.shares.items():
            _set_inertial(text, links[link], parameters, link)
            written.append(link)
    for joint in text.root.named("joint"):
        _set_dynamics(
            text, joint, drive_attributes(found, str(joint.attributes.get("name")), UrdfFormat.held, notes)
        )
    return UrdfEdit(text, tuple(written), tuple(notes))


def _segment_members(robot: Robot, links: dict[str, ElementTree.Element], file: Path) -> list[list[Member]]:
    """Links of each segment, the moving one first."""
    members: list[list[Member]] = [[] for _ in robot.segments]
    for name, link in links.items():
        joint, placement = link_placement(robot.model, name, file, f"link {name!r}")
        if joint == 0:
            continue
        member = Member(name, placement, _stated_inertial(link, file))
        if name == robot.segments[joint - 1].link:
            members[joint - 1].insert(0, member)
        else:
            members[joint - 1].append(member)
    return members


def _stated_inertial(link: ElementTree.Element, file: Path) -> Array | None:
    """A link's own parameters as its inertial states them; zero of a frame, None where it says nothing."""
    if link.find("inertial") is None:
        return None
    found = read_inertial(link, file) or Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    return np.asarray(pin.Inertia(found.mass, found.centre, found.moments).toDynamicParameters())


def _unchanged_since_loading(robot: Robot, members: Iterable[list[Member]], file: Path) -> None:
    for segment, (inside, nominal) in enumerate(
        zip(members, robot.nominal_parameters.reshape(-1, 10), strict=True)
    ):
        total = np.zeros(10)
        for member in inside:
            if member.parameters is not None:
                pseudo = pseudo_inertia_matrices(member.parameters)[0]
                total += parameters_of(moved_pseudo(pseudo, member.placement))
        if not np.allclose(total, nominal, rtol=1e-6, atol=1e-9 * (1.0 + np.abs(nominal).max())):
            raise InputError(
                f"does not hold the parameters of {robot.segments[segment].link!r} that were loaded",
                source=file,
                remedy="load the robot again",
            )


def _set_inertial(text: XmlText, link: Element, parameters: Array, name: str) -> None:
    body = centred_body(parameters, name)
    found = link.named("inertial")
    if not found:
        values = " ".join(f'{key}="{moment}"' for key, moment in moment_texts(body.inertia).items())
        text.insert_first(
            link,
            f'<inertial><origin xyz="{number_text(*body.com)}"/><mass value="{number_text(body.mass)}"/>'
            f"<inertia {values}/></inertial>",
        )
        return
    inertial = found[0]
    origin, turn = inertial.named("origin"), np.eye(3)
    if origin:
        # Read before with the robot: three numbers.
        turn = pin.rpy.rpyToMatrix(*map(float, origin[0].attributes.get("rpy", "0 0 0").split()))
        text.set(origin[0], xyz=number_text(*body.com))
    else:
        text.insert_first(inertial, f'<origin xyz="{number_text(*body.com)}"/>')
    text.set(inertial.named("mass")[0], value=number_text(body.mass))
    text.set(inertial.named("inertia")[0], **moment_texts(turn.T @ body.inertia @ turn))


def _held_note(robot: Robot) -> list[str]:
    held = held_joints(robot)
    if not held:
        return []
    return [
        "links beyond the joints that robot.yaml holds still kept their nominal inertia; the sum of their "
        f"segment is the identified one while {', '.join(held)} stay where they are held"
    ]


def _mesh_note(text: XmlText, file: Path, path: Path) -> list[str]:
    names = [mesh.attributes.get("filename", "") for mesh in text.root.everywhere("mesh")]
    relative = any("://" not in name and not Path(name).is_absolute() for name in names)
    if relative and Path(path).resolve().parent != file.resolve().parent:
        return [f"mesh paths are relative: put it beside {file.name} to see them"]
    return []


# What a written URDF says of its joints' drives: friction, and the limits that readers insist on.


def _set_dynamics(text: XmlText, joint: Element, values: Mapping[str, str]) -> None:
    """Put friction into ``<dynamics>``; what no passive joint has is left as it was."""
    if values and joint.named("dynamics"):
        text.set(joint.named("dynamics")[0], **values)
    elif values:
        inside = " ".join(f'{key}="{value}"' for key, value in values.items())
        text.insert_first(joint, f"<dynamics {inside}/>")


def complete_limits(text: XmlText, robot: Robot) -> list[str]:
    """Write efforts and velocities where the model has limits without: the robot's, 0 of joints that are held.

    Args:
        text: the URDF, edited here.
        robot: the robot.

    Returns:
        A sentence with the joints concerned; none where all limits are complete.
    """
    known = {"effort": robot.limits.torque, "velocity": robot.limits.velocity}
    found = []
    for joint in text.root.named("joint"):
        name = str(joint.attributes.get("name"))
        for limit in joint.named("limit") if joint.attributes.get("type") in MOVING else ():
            missing = [word for word in known if word not in limit.attributes]
            if missing:
                free = name in robot.joint_names
                place = robot.joint_names.index(name) if free else 0
                values = {word: number_text(float(known[word][place]) if free else 0.0) for word in missing}
                text.set(limit, **values)
                found.append(name)
    return (
        [f"limits of {', '.join(found)} lacked an effort or a velocity: the description's"] if found else []
    )
