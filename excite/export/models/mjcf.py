"""A MuJoCo model with identified inertials: a given MJCF text with other numbers, or one made here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.errors import NoSolutionError
from excite.export.models.bodies import changed_segments
from excite.export.models.mjcf_bodies import segment_bodies, segment_difference
from excite.export.models.mjcf_compiled import compile_mjcf
from excite.export.models.mjcf_template import read_template, template_names
from excite.export.models.parameters import Found
from excite.export.models.servos import with_servos
from excite.export.models.urdf import TOLERANCE
from excite.export.models.verification import mujoco_error
from excite.export.models.written import WrittenModel
from excite.export.models.xml_text import XmlText, number_text
from excite.robot.robot import Robot
from excite.simulation.drives import Drives, nominal_drives
from excite.simulation.mjcf import World, build_spec

if TYPE_CHECKING:
    import mujoco

# Bodies of a template that are nearer to the identified parameters, relatively, are left alone.
_SAME_INERTIA = 1e-4
_ORIENTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")


def write_mjcf(
    robot: Robot,
    identification: Found,
    path: Path,
    *,
    template: Path | None = None,
    names: Mapping[str, str] | None = None,
    drives: bool = False,
) -> WrittenModel:
    """Write a MuJoCo model with the identified inertials.

    With a template its text is edited: only inertials change (one is added where the template leaves them to
    its geometry). Without one the model is what :func:`~excite.simulation.mjcf.build_spec` makes of the
    robot, all digits written. What MuJoCo then computes has to agree with the identified parameters.

    Args:
        robot: the robot that was identified.
        identification: what was identified.
        path: file to write; mesh paths of a template stay relative to it.
        template: an MJCF file of the same robot.
        names: names of links and joints in the template, where they are not the robot's.
        drives: also write viscous and Coulomb friction and rotor inertia that were identified.

    Returns:
        The file and what was checked.

    Raises:
        InconsistentModelError: a segment is no rigid body; MuJoCo refuses such models.
        InputError: the identification is of another robot, or the template is another robot's or not there.
        NoSolutionError: MuJoCo does not give the identified parameters' torques (a bug here).
    """
    changed = changed_segments(robot, identification, force=False)
    ten = identification.parameters.reshape(-1, 10)
    if template is None:
        moving = with_servos(robot)
        friction = identified_drives(moving, identification) if drives else nominal_drives(moving)
        content = exact_text(build_spec(moving, identification.parameters, friction, World()))
        links = tuple(robot.segments[k].link for k in changed)
        model, names_here = compile_mjcf(content, None), template_names(robot, {})
        error = mujoco_error(robot, model, names_here, identification.parameters)
        return _write_mjcf(content, WrittenModel(Path(path), links, (), None, error))
    names = names or {}
    given = read_template(robot, template, names)
    edit = given.edited(robot, identification, drives=drives)
    content, notes = edit.text.edited(), list(edit.notes)
    if template.resolve().parent != Path(path).resolve().parent and list(edit.text.root.everywhere("mesh")):
        notes.append(f"mesh paths are relative: put it beside {template.name}")
    model = compile_mjcf(content, template)
    places = template_names(robot, names)
    taken = segment_bodies(robot, model, places, names)
    error = max((segment_difference(taken[k], ten[k]) for k in edit.segments), default=0.0)
    in_motion = mujoco_error(robot, model, places, identification.parameters)
    if in_motion > TOLERANCE:
        notes.append(
            f"its torques are {in_motion:.1e} off the robot's: that is how far its geometry (or the inertia of "
            "bodies that were left alone) is from the URDF's"
        )
    return _write_mjcf(content, WrittenModel(Path(path), edit.changed, tuple(notes), None, error))


def exact_text(spec: mujoco.MjSpec) -> bytes:
    """A specification as XML with all digits of its kinematics and inertials; MuJoCo writes six."""
    text = XmlText(spec.to_xml().encode("utf-8"), spec.modelname)
    for element in text.root.everywhere("body"):
        body = spec.body(str(element.attributes["name"]))
        text.set(element, pos=number_text(*body.pos), quat=number_text(*body.quat))
        joints = {joint.name: joint for joint in body.joints}
        for joint in element.named("joint"):
            found = joints[str(joint.attributes["name"])]
            text.set(joint, axis=number_text(*found.axis), range=number_text(*found.range))
            drive = {"damping": found.damping, "frictionloss": found.frictionloss, "armature": found.armature}
            stated = {name: value for name, value in drive.items() if name in joint.attributes}
            text.set(joint, **{name: number_text(np.ravel(value)[0]) for name, value in stated.items()})
        for inertial in element.named("inertial"):
            text.set(
                inertial,
                pos=number_text(*body.ipos),
                quat=number_text(*body.iquat),
                mass=number_text(body.mass),
                diaginertia=number_text(*body.inertia),
            )
    return text.edited()


def _write_mjcf(content: bytes, model: WrittenModel) -> WrittenModel:
    error = model.mujoco_error or 0.0
    if not error <= TOLERANCE:
        raise NoSolutionError(
            f"{model.path} was not written: what MuJoCo reads from it is off by {error:.1e}",
            remedy="report this with the model",
        )
    with atomic_path(model.path) as temporary:
        temporary.write_bytes(content)
    return model


def identified_drives(robot: Robot, identification: Found) -> Drives:
    """The robot's drives with the friction and rotor inertia that were identified and are not negative."""
    found = identification.identified.by_drive()
    nominal = nominal_drives(robot)

    def values(term: str, declared: Array) -> Array:
        identified = [found.get(f"{term}.{joint}", np.nan) for joint in robot.joint_names]
        return np.array([new if new >= 0.0 else old for new, old in zip(identified, declared, strict=True)])

    return replace(
        nominal,
        viscous=values("viscous", nominal.viscous),
        coulomb=values("coulomb", nominal.coulomb),
        armature=values("armature", nominal.armature),
    )
