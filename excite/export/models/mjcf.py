"""MJCF: the author's text with identified physics, or a model made from the robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.export.models.mjcf_compiled import compile_mjcf, compile_text
from excite.export.models.mjcf_template import (
    DRIVE_ATTRIBUTES,
    read_template,
    segment_bodies,
    segment_difference,
)
from excite.export.models.model_format import (
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    move_attribute,
    relocate_path,
    with_friction,
)
from excite.export.models.parameters import Found, changed_segments, model_parameters, with_servos
from excite.export.models.verification import (
    TOLERANCE,
    States,
    WrittenModel,
    mujoco_places,
    mujoco_torques,
    random_states,
    write_verified,
)
from excite.export.models.xml_text import Element, XmlText, number_text
from excite.robot.robot import Robot
from excite.simulation.mjcf import World, build_spec

if TYPE_CHECKING:
    import mujoco

_OWN_MOTORS = "the author's actuators were left as they are; set it there"
FILTERED = "commands pass a filter of {late:.3g} s, which is how late the motors were found to follow"
_FOLDERS = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir"}


class MjcfFormat(ModelFormat):
    """A MuJoCo model.

    Of a robot that came as MJCF it is that text: shapes, contacts, defaults, sensors and actuators stay, inertials,
    ``damping``, ``frictionloss`` and ``armature`` change. Of any other it is made here, with a position servo a joint.
    """

    name = "mjcf"
    summary = "MuJoCo model; of a robot that came as MJCF the author's text is kept (MuJoCo, MJX)"
    held: ClassVar[Mapping[str, str]] = {
        **DRIVE_ATTRIBUTES,
        "kp": "gainprm",
        "kd": "biasprm",
        "torque_limit": "forcerange",
        "delay": "dynprm",
    }
    lacks: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("kp", "kd", "torque_limit", "delay"), _OWN_MOTORS),
        "velocity_limit": "MuJoCo holds no joint below a speed; keep commands below it",
    }

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        given = subject.mjcf
        if given is None:
            notes = () if subject.delay_s is None else (FILTERED.format(late=subject.delay_s),)
            return Rendered({f"{subject.stem}.xml": exact_text(model_spec(subject))}, notes)
        edit = given.edited(subject.robot, subject.found)
        _move_paths(edit.text, given.file.parent, subject.folder)
        return Rendered({f"{subject.stem}.xml": edit.text.edited()}, edit.notes)

    def load(self, subject: Subject, rendered: Rendered, states: States) -> LoadedModel:
        """Read by MuJoCo, where paths in it start at the folder that it is for."""
        content, robot = rendered.files[rendered.main], subject.robot
        model = (
            compile_text(content, None)
            if subject.template is None
            else compile_mjcf(content, subject.folder / rendered.main)
        )
        place = mujoco_places(robot, model).v[robot.n_base_v :]
        own = {
            "viscous": model.dof_damping,
            "coulomb": model.dof_frictionloss,
            "armature": model.dof_armature,
        }
        terms = {term: np.array(values[place], dtype=float) for term, values in own.items()}
        # Dry friction, which MuJoCo solves as a constraint, is that of a joint that moves.
        whole = mujoco_torques(robot, model, states)
        torques = with_friction(robot, whole, states, {"coulomb": terms["coulomb"]})
        return LoadedModel(torques, {**terms, **_servo_terms(model, robot.joint_names)})

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """A text that is kept keeps its actuators."""
        return super().servo(subject) if subject.template is None else ()

    def exact(self, subject: Subject) -> bool:
        """A text that is kept may have springs, and bodies that are some parts in ten thousand off the robot's."""
        return subject.template is None


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
    found, notes, error = model_parameters(identification, drives=drives), [], 0.0
    if template is None:
        changed = tuple(robot.segments[k].link for k in changed_segments(robot, found, force=False))
        content = exact_text(model_spec(Subject(with_servos(robot), found, Path(path).parent)))
        model = compile_text(content, None)
    else:
        edit = read_template(robot, template, names or {}).edited(robot, found)
        changed, content, notes = edit.changed, edit.text.edited(), list(edit.notes)
        if template.resolve().parent != Path(path).resolve().parent and [*edit.text.root.everywhere("mesh")]:
            notes.append(f"mesh paths are relative: put it beside {template.name}")
        model = compile_mjcf(content, template)
        taken, ten = segment_bodies(robot, model, names or {}), found.inertial.reshape(-1, 10)
        error = max((segment_difference(taken[k], ten[k]) for k in edit.segments), default=0.0)
    states = random_states(robot, found.inertial)
    in_motion = states.error(mujoco_torques(robot, model, states, names, drives=False))
    if template is None:
        error = in_motion
    elif in_motion > TOLERANCE:
        notes.append(
            f"its torques are {in_motion:.1e} off the robot's: that is how far its geometry (or the inertia of "
            "bodies that were left alone) is from the URDF's"
        )
    return write_verified(content, WrittenModel(Path(path), changed, tuple(notes), None, error))


def model_spec(subject: Subject) -> mujoco.MjSpec:
    """A model made from the robot, with a servo a joint; a delay is the time constant of a filter of its command."""
    import mujoco

    terms: dict[str, Any] = {term: subject.written(term) for term in MjcfFormat.held if term != "delay"}
    drives = replace(subject.declared, **terms)
    spec = build_spec(subject.robot, subject.parameters, drives, World())
    late = subject.servo("delay")
    for name, constant in zip(subject.robot.joint_names, late, strict=True):
        if np.isfinite(constant):
            motor = spec.actuator(name)
            motor.dyntype, motor.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTEREXACT, constant
    return spec


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


def _servo_terms(model: mujoco.MjModel, names: tuple[str, ...]) -> dict[str, Array]:
    """Terms of the position servos that are named like their joints; NaN where a joint has none."""
    import mujoco

    rows = np.full((4, len(names)), np.nan)
    for column, name in enumerate(names):
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        if motor >= 0:
            late = model.actuator_dynprm[motor, 0] if model.actuator_dyntype[motor] else np.nan
            gain, bias = model.actuator_gainprm[motor], model.actuator_biasprm[motor]
            rows[:, column] = gain[0], -bias[2], model.actuator_forcerange[motor, 1], late
    return dict(zip(("kp", "kd", "torque_limit", "delay"), rows, strict=True))


def _move_paths(text: XmlText, old: Path, new: Path) -> None:
    """Let a text name the same files from another folder."""
    if old.resolve() == new.resolve():
        return
    for include in text.root.everywhere("include"):
        move_attribute(text, include, "file", old, new)
    compilers = text.root.named("compiler")
    for tag, attribute in _FOLDERS.items():
        if not _file_names(text, tag):
            continue
        stated = next((c for c in compilers if {attribute, "assetdir"} & set(c.attributes)), None)
        if stated is not None:
            name = stated.attributes.get(attribute) or stated.attributes.get("assetdir", "")
            text.set(stated, **{attribute: relocate_path(name or ".", old, new)})
            continue
        for element in text.root.everywhere(tag):
            move_attribute(text, element, "file", old, new)


def _file_names(text: XmlText, tag: str) -> list[Element]:
    return [element for element in text.root.everywhere(tag) if "file" in element.attributes]
