"""A person as a model file: URDF with ``robot.yaml``, and OpenSim 4."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.atomic import write_text
from excite.human.body import Body, BodyInertia, segment_box
from excite.human.markers.inverse_kinematics import MarkerModel
from excite.human.segments import NAMES, PAIRS, PARENTS, SEGMENTS, Segment
from excite.human.skeleton import frame_turn

# A person as a URDF and a ``robot.yaml``: spherical joints are three axes with massless links between.

URDF_FILE, ROBOT_FILE = "human.urdf", "robot.yaml"

PLACES = {"robot_file": ROBOT_FILE, "log_file": "."}
"""Where the robot and the log of a person's results lie: in the same folder."""
_SPEED, _TORQUE = 40.0, 400.0
_MIDDLE_RANGE, _OUTER_RANGE = 1.57, 3.1
_HINGE = (-0.5, 2.9)


def virtual_links() -> tuple[str, ...]:
    """Massless links between the axes of the spherical joints."""
    return tuple(f"{s.name}_axis_{i}" for s in SEGMENTS for i in range(1, len(s.axes)) if len(s.axes) > 1)


def urdf_text(body: Body) -> str:
    """The URDF: one link a segment, angles named as in :data:`~excite.human.segments.JOINT_NAMES`."""
    robot = ElementTree.Element("robot", name="human")
    offsets = body.offsets
    for k, segment in enumerate(SEGMENTS):
        _add_link(robot, segment.name, body.inertias[k], segment_box(body, k), frame_turn(k))
        if k == 0:
            continue
        carrier, turn = NAMES[PARENTS[k]], frame_turn(PARENTS[k])
        for i, axis in enumerate(segment.axes):
            last = i == len(segment.axes) - 1
            child = segment.name if last else f"{segment.name}_axis_{i + 1}"
            if not last:
                ElementTree.SubElement(robot, "link", name=child)
            name = segment.joint if len(segment.axes) == 1 else f"{segment.joint}_{axis.name}"
            joint = ElementTree.SubElement(robot, "joint", name=str(name), type="revolute")
            ElementTree.SubElement(joint, "parent", link=carrier)
            ElementTree.SubElement(joint, "child", link=child)
            place, rotation = (turn @ offsets[k], turn) if i == 0 else (np.zeros(3), np.eye(3))
            _set_origin(joint, place, rotation)
            direction = np.eye(3)[axis.index] * axis.sign
            ElementTree.SubElement(joint, "axis", xyz=_format_values(direction))
            low, high = _joint_range(len(segment.axes), i)
            ElementTree.SubElement(
                joint, "limit", lower=f"{low}", upper=f"{high}", velocity=f"{_SPEED}", effort=f"{_TORQUE}"
            )
            carrier, turn = child, np.eye(3)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _joint_range(n_axes: int, place: int) -> tuple[float, float]:
    if n_axes == 1:
        return _HINGE
    bound = _MIDDLE_RANGE if place == 1 else _OUTER_RANGE
    return -bound, bound


def _add_link(robot: ElementTree.Element, name: str, inertia: BodyInertia, box: Array, turn: Array) -> None:
    link = ElementTree.SubElement(robot, "link", name=name)
    inertial = ElementTree.SubElement(link, "inertial")
    _set_origin(inertial, turn @ inertia.center, np.eye(3))
    ElementTree.SubElement(inertial, "mass", value=f"{inertia.mass:.12g}")
    moments = turn @ inertia.inertia @ turn.T
    pairs = ((i, j) for i in range(3) for j in range(i, 3))
    values = {f"i{'xyz'[i]}{'xyz'[j]}": f"{moments[i, j]:.12g}" for i, j in pairs}
    ElementTree.SubElement(inertial, "inertia", values)
    for kind in ("visual", "collision"):
        shown = ElementTree.SubElement(link, kind)
        _set_origin(shown, turn @ box.mean(axis=0), turn)
        geometry = ElementTree.SubElement(shown, "geometry")
        ElementTree.SubElement(geometry, "box", size=_format_values(box[1] - box[0]))


def _set_origin(parent: ElementTree.Element, place: Array, rotation: Array) -> None:
    # Roll, pitch and yaw about the parent's axes.
    turn = Rotation.from_matrix(rotation).as_euler("xyz")
    ElementTree.SubElement(parent, "origin", xyz=_format_values(place), rpy=_format_values(turn))


def _format_values(values: Array) -> str:
    return " ".join(f"{value + 0.0:.12g}" for value in values)


_FEET = ("right_foot", "left_foot")


def robot_yaml(body: Body, rate_hz: float, plates: tuple[str, ...] = ()) -> str:
    """The ``robot.yaml`` beside the URDF: pairs, boxes of the centres of mass, soles, joint ranges.

    Args:
        body: the person.
        rate_hz: rate of the recordings.
        plates: names of the force plates; two below the feet where there are none.
    """
    subject, middle = body.subject, "chosen here"
    content: dict[str, Any] = {
        "schema": "excite.robot/1",
        "name": "human",
        "title": f"Person of {subject.height:g} m, {subject.mass:g} kg, {subject.sex}, 34 DoF",
        "model": {
            "path": URDF_FILE,
            "acknowledged": {link: "massless, an axis of a spherical joint" for link in virtual_links()},
            "source": f"segments by table {body.table}, joints from stature or markers",
        },
        "base": "floating",
        "posture": {"joints": {}, "source": "standing"},
        "limits": {
            "position": {"source": "wider than people's ranges"},
            "acceleration": {"default": 500.0, "source": middle},
            "jerk": {"default": 2e4, "source": middle},
        },
        "feet": _foot_blocks(body),
        "sensors": _sensor_block(rate_hz, plates or tuple(f"plate_{side}" for side in ("right", "left"))),
        "drives": {"armature": {"default": 0.02, "source": middle}},
        "controller": {
            "kp": {"default": 2000.0, "source": middle},
            "kd": {"default": 40.0, "source": middle},
        },
        "segments": {"pairs": [list(pair) for pair in PAIRS], "com_box": _com_boxes(body)},
        "collision": {"geometry": "collision", "margin": 0.0, "source": "boxes about the segments"},
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)


def _foot_blocks(body: Body) -> list[dict[str, Any]]:
    """Both feet; the sole is a rectangle of the foot's length, 8 cm wide."""
    d = body.dimensions
    front, height = d.foot_length - d.heel, d.ankle_height
    sole = [
        [-d.heel, -0.04, -height],
        [-d.heel, 0.04, -height],
        [front, 0.04, -height],
        [front, -0.04, -height],
    ]
    return [
        {
            "name": foot,
            "link": foot,
            "sole": [[round(float(v), 4) for v in corner] for corner in sole],
            "friction": 0.8,
            "source": "size of the foot from stature",
        }
        for foot in _FEET
    ]


def _sensor_block(rate_hz: float, plates: tuple[str, ...]) -> dict[str, Any]:
    """Markers and force plates of a usual laboratory."""
    return {
        "rate_hz": float(rate_hz),
        "noise_position": 5e-3,
        "noise_base_position": 1e-3,
        "noise_base_orientation": 5e-3,
        "wrench": [
            {
                "name": name,
                "kind": "force_plate",
                "link": "world",
                "foot": _FEET[i % 2],
                "noise_force": 1.0,
                "noise_moment": 0.3,
            }
            for i, name in enumerate(plates)
        ],
        "source": "usual figures of a motion laboratory",
    }


def _com_boxes(body: Body) -> dict[str, list[list[float]]]:
    """Boxes of the centres of mass, lower and upper corner in the frame of each segment's joint [m]."""
    boxes = {}
    for k, name in enumerate(NAMES):
        turned = np.array([frame_turn(k) @ corner for corner in _box_corners(segment_box(body, k))])
        boxes[name] = [turned.min(axis=0).round(4).tolist(), turned.max(axis=0).round(4).tolist()]
    return boxes


def _box_corners(box: Array) -> Array:
    grid = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T
    return np.take_along_axis(box, grid, axis=0)


# A person as an OpenSim 4 model: bodies, joints and markers, axes of the ISB (x forward, y up, z to the
# right).

_VERSION = "40000"
# From x forward, y left, z up to x forward, y up, z right.
TO_ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns directions of ours into OpenSim's."""
PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz")
"""Coordinates of the pelvis: turns about its z, x and y, then its place."""


def write_osim(body: Body, path: Path, markers: MarkerModel | None = None, name: str = "human") -> Path:
    """Write an ``.osim`` file.

    Args:
        body: the person, nominal or identified.
        path: where to.
        markers: places of markers, which OpenSim's own inverse kinematics then takes.
        name: of the model.

    Returns:
        The path.
    """
    return write_text(path, osim_text(body, markers, name))


def osim_text(body: Body, markers: MarkerModel | None = None, name: str = "human") -> str:
    """The model as XML."""
    document = ElementTree.Element("OpenSimDocument", Version=_VERSION)
    model = ElementTree.SubElement(document, "Model", name=name)
    _add_leaf(model, "gravity", "0 -9.81 0")
    _add_leaf(model, "credits", f"excite; segments by {body.table}")
    ElementTree.SubElement(model, "Ground", name="ground")
    bodies = _add_set(model, "BodySet", "bodyset")
    joints = _add_set(model, "JointSet", "jointset")
    offsets = body.offsets
    for k, segment in enumerate(SEGMENTS):
        _add_body(bodies, segment.name, body, k)
        _add_joint(joints, segment, k, offsets[k])
    if markers is not None:
        _add_markers(_add_set(model, "MarkerSet", "markerset"), markers)
    ElementTree.indent(document)
    return ElementTree.tostring(document, encoding="unicode", xml_declaration=True) + "\n"


def coordinate_names() -> tuple[str, ...]:
    """Coordinates of the model's joints, without the pelvis'; they are the names of the joints in the URDF too."""
    return tuple(
        name for segment in SEGMENTS if segment.joint is not None for name in _coordinate_names(segment)
    )


def _coordinate_names(segment: Segment) -> tuple[str, ...]:
    if len(segment.axes) == 1:
        return (str(segment.joint),)
    return tuple(f"{segment.joint}_{axis.name}" for axis in segment.axes)


def _add_leaf(parent: ElementTree.Element, tag: str, text: str) -> None:
    ElementTree.SubElement(parent, tag).text = text


def _add_set(model: ElementTree.Element, kind: str, name: str) -> ElementTree.Element:
    outer = ElementTree.SubElement(model, kind, name=name)
    return ElementTree.SubElement(outer, "objects")


def _add_body(bodies: ElementTree.Element, name: str, body: Body, k: int) -> None:
    inertia = body.inertias[k]
    element = ElementTree.SubElement(bodies, "Body", name=name)
    _add_leaf(element, "mass", f"{inertia.mass:.12g}")
    _add_leaf(element, "mass_center", _format_values(TO_ISB @ inertia.center))
    moments = TO_ISB @ inertia.inertia @ TO_ISB.T
    _add_leaf(element, "inertia", _format_values(moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]))


def _add_joint(joints: ElementTree.Element, segment: Segment, k: int, offset: Array) -> None:
    free = segment.joint is None
    name = "ground_pelvis" if free else str(segment.joint)
    carrier = "ground" if free else NAMES[PARENTS[k]]
    joint = ElementTree.SubElement(joints, "CustomJoint", name=name)
    _add_leaf(joint, "socket_parent_frame", f"{carrier}_offset")
    _add_leaf(joint, "socket_child_frame", f"{segment.name}_offset")
    if free:
        names: tuple[str, ...] = PELVIS
        axes = [np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])]
    else:
        names = _coordinate_names(segment)
        axes = [TO_ISB @ np.eye(3)[axis.index] * axis.sign for axis in segment.axes]
    coordinates = ElementTree.SubElement(joint, "coordinates")
    for coordinate in names:
        element = ElementTree.SubElement(coordinates, "Coordinate", name=coordinate)
        _add_leaf(element, "default_value", "0")
        _add_leaf(element, "range", "-3.2 3.2" if not coordinate.startswith("pelvis_t") else "-10 10")
    frames = ElementTree.SubElement(joint, "frames")
    place = np.zeros(3) if free else TO_ISB @ offset
    _add_frame(frames, carrier, "/ground" if free else f"/bodyset/{carrier}", place, np.eye(3))
    # The last axis of a shoulder is turned against the arm's own frame.
    turn = TO_ISB @ frame_turn(k).T @ TO_ISB.T
    _add_frame(frames, segment.name, f"/bodyset/{segment.name}", np.zeros(3), turn)
    transform = ElementTree.SubElement(joint, "SpatialTransform")
    used = [*axes, *_complete_axes(axes)][:3]
    for i, axis in enumerate(used):
        _add_axis(transform, f"rotation{i + 1}", axis, names[i] if i < len(axes) else None)
    for i in range(3):
        _add_axis(transform, f"translation{i + 1}", np.eye(3)[i], names[3 + i] if free else None)


def _complete_axes(axes: list[Array]) -> list[Array]:
    """Unit axes that complete the given ones to three independent ones."""
    return [axis for axis in np.eye(3) if not any(abs(axis @ own) > 0.5 for own in axes)]


def _add_frame(frames: ElementTree.Element, owner: str, socket: str, place: Array, rotation: Array) -> None:
    frame = ElementTree.SubElement(frames, "PhysicalOffsetFrame", name=f"{owner}_offset")
    _add_leaf(frame, "socket_parent", socket)
    _add_leaf(frame, "translation", _format_values(place))
    # OpenSim's orientation: turns about body-fixed x, y, z.
    _add_leaf(frame, "orientation", _format_values(Rotation.from_matrix(rotation).as_euler("XYZ")))


def _add_axis(transform: ElementTree.Element, name: str, axis: Array, coordinate: str | None) -> None:
    element = ElementTree.SubElement(transform, "TransformAxis", name=name)
    kind, tag, value = "Constant", "value", "0"
    if coordinate is not None:
        _add_leaf(element, "coordinates", coordinate)
        kind, tag, value = "LinearFunction", "coefficients", "1 0"
    _add_leaf(element, "axis", _format_values(axis))
    _add_leaf(ElementTree.SubElement(element, kind, name="function"), tag, value)


def _add_markers(markers: ElementTree.Element, model: MarkerModel) -> None:
    for label, segment, local in zip(model.labels, model.segment, model.local, strict=True):
        marker = ElementTree.SubElement(markers, "Marker", name=label)
        _add_leaf(marker, "socket_parent_frame", f"/bodyset/{NAMES[int(segment)]}")
        _add_leaf(marker, "location", _format_values(TO_ISB @ local))
        _add_leaf(marker, "fixed", "true")
