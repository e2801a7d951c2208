"""A person as an OpenSim 4 model: bodies, joints and markers, axes of the ISB (x forward, y up, z to the right)."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.human.body import Body
from excite.human.markers.inverse_kinematics import MarkerModel
from excite.human.posture.joint_angles import frame_turn
from excite.human.segments import NAMES, PARENTS, SEGMENTS, Segment

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
    with atomic_path(path) as temporary:
        temporary.write_text(osim_text(body, markers, name), encoding="utf-8")
    return path


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


def _format_values(values: Array) -> str:
    return " ".join(f"{value + 0.0:.12g}" for value in values)


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
    x = np.arctan2(-rotation[1, 2], rotation[2, 2])
    y = np.arcsin(np.clip(rotation[0, 2], -1.0, 1.0))
    z = np.arctan2(-rotation[0, 1], rotation[0, 0])
    _add_leaf(frame, "orientation", _format_values(np.array([x, y, z])))


def _add_axis(transform: ElementTree.Element, name: str, axis: Array, coordinate: str | None) -> None:
    element = ElementTree.SubElement(transform, "TransformAxis", name=name)
    if coordinate is not None:
        _add_leaf(element, "coordinates", coordinate)
    _add_leaf(element, "axis", _format_values(axis))
    if coordinate is None:
        function = ElementTree.SubElement(element, "Constant", name="function")
        _add_leaf(function, "value", "0")
    else:
        function = ElementTree.SubElement(element, "LinearFunction", name="function")
        _add_leaf(function, "coefficients", "1 0")


def _add_markers(markers: ElementTree.Element, model: MarkerModel) -> None:
    for label, segment, local in zip(model.labels, model.segment, model.local, strict=True):
        marker = ElementTree.SubElement(markers, "Marker", name=label)
        _add_leaf(marker, "socket_parent_frame", f"/bodyset/{NAMES[int(segment)]}")
        _add_leaf(marker, "location", _format_values(TO_ISB @ local))
        _add_leaf(marker, "fixed", "true")
