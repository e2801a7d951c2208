"""A person as a model file: URDF with ``robot.yaml``."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.formats.documents import read_yaml
from excite.human.body import Body, BodyInertia, segment_box
from excite.human.segments import NAMES, PAIRS, PARENTS, SEGMENTS, Segment
from excite.human.skeleton import frame_turn


def _build_element(tag: str, *content: ElementTree.Element | str, **attributes: str) -> ElementTree.Element:
    """An element with children, or with text."""
    found = ElementTree.Element(tag, attributes)
    for item in content:
        if isinstance(item, str):
            found.text = item
        else:
            found.append(item)
    return found


def _render_document(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _format_values(values: Array) -> str:
    return " ".join(f"{value + 0.0:.12g}" for value in values)


def _coordinate_names(segment: Segment) -> tuple[str, ...]:
    if len(segment.axes) == 1:
        return (str(segment.joint),)
    return tuple(f"{segment.joint}_{axis.name}" for axis in segment.axes)


# A person as a URDF and a ``robot.yaml``: spherical joints are three axes with massless links between.

URDF_FILE, ROBOT_FILE = "human.urdf", "robot.yaml"

PLACES = {"robot_file": ROBOT_FILE, "log_file": "."}
"""Where the robot and the log of a person's results lie: in the same folder."""


def urdf_text(body: Body) -> str:
    """The URDF: one link a segment, angles named as in :data:`~excite.human.segments.JOINT_NAMES`."""
    robot = _build_element("robot", name="human")
    offsets = body.offsets
    limits = {"velocity": "40.0", "effort": "400.0"}
    for k, segment in enumerate(SEGMENTS):
        robot.append(_build_link(segment.name, body.inertias[k], segment_box(body, k), frame_turn(k)))
        if k == 0:
            continue
        carrier, turn = NAMES[PARENTS[k]], frame_turn(PARENTS[k])
        place = turn @ offsets[k]
        for i, (name, axis) in enumerate(zip(_coordinate_names(segment), segment.axes, strict=True)):
            last = i == len(segment.axes) - 1
            child = segment.name if last else f"{segment.name}_axis_{i + 1}"
            if not last:
                robot.append(_build_element("link", name=child))
            bound = 1.57 if i == 1 else 3.1
            low, high = (-0.5, 2.9) if len(segment.axes) == 1 else (-bound, bound)
            robot.append(
                _build_element(
                    "joint",
                    _build_element("parent", link=carrier),
                    _build_element("child", link=child),
                    _build_origin(place, turn),
                    _build_element("axis", xyz=_format_values(np.eye(3)[axis.index] * axis.sign)),
                    _build_element("limit", lower=f"{low}", upper=f"{high}", **limits),
                    name=name,
                    type="revolute",
                )
            )
            carrier, turn, place = child, np.eye(3), np.zeros(3)
    return _render_document(robot)


def _build_link(name: str, inertia: BodyInertia, box: Array, turn: Array) -> ElementTree.Element:
    moments = turn @ inertia.inertia @ turn.T
    values = {f"i{'xyz'[i]}{'xyz'[j]}": f"{moments[i, j]:.12g}" for i in range(3) for j in range(i, 3)}
    inertial = _build_element(
        "inertial",
        _build_origin(turn @ inertia.center, np.eye(3)),
        _build_element("mass", value=f"{inertia.mass:.12g}"),
        _build_element("inertia", **values),
    )
    shapes = [
        _build_element(
            kind,
            _build_origin(turn @ box.mean(axis=0), turn),
            _build_element("geometry", _build_element("box", size=_format_values(box[1] - box[0]))),
        )
        for kind in ("visual", "collision")
    ]
    return _build_element("link", inertial, *shapes, name=name)


def _build_origin(place: Array, rotation: Array) -> ElementTree.Element:
    # Roll, pitch and yaw about the parent's axes.
    turn = Rotation.from_matrix(rotation).as_euler("xyz")
    return _build_element("origin", xyz=_format_values(place), rpy=_format_values(turn))


def robot_yaml(body: Body, rate_hz: float, plates: tuple[str, ...] = ()) -> str:
    """The ``robot.yaml`` beside the URDF: pairs, boxes of the centres of mass, soles, joint ranges.

    Args:
        body: the person.
        rate_hz: rate of the recordings.
        plates: names of the force plates; two below the feet where there are none.
    """
    subject, d = body.subject, body.dimensions
    content = read_yaml(Path(__file__).with_name("robot_template.yaml"))
    content["title"] = f"Person of {subject.height:g} m, {subject.mass:g} kg, {subject.sex}, 34 DoF"
    # Massless links between the axes of the spherical joints.
    axes = [f"{s.name}_axis_{i}" for s in SEGMENTS for i in range(1, len(s.axes))]
    content["model"] |= {
        "acknowledged": {link: "massless, an axis of a spherical joint" for link in axes},
        "source": f"segments by table {body.table}, joints from stature or markers",
    }
    # A rectangle of the foot's length, 8 cm wide.
    front, back = round(float(d.foot_length - d.heel), 4), round(float(-d.heel), 4)
    corners = ((back, -0.04), (back, 0.04), (front, 0.04), (front, -0.04))
    for foot in content["feet"]:
        foot["sole"] = [[x, y, round(float(-d.ankle_height), 4)] for x, y in corners]
    plate = {"kind": "force_plate", "link": "world"}
    noise = {"noise_force": 1.0, "noise_moment": 0.3}
    content["sensors"] |= {
        "rate_hz": float(rate_hz),
        "wrench": [
            {"name": name, **plate, "foot": content["feet"][i % 2]["name"], **noise}
            for i, name in enumerate(plates or ("plate_right", "plate_left"))
        ],
    }
    boxes = {}
    for k, name in enumerate(NAMES):
        low, high = segment_box(body, k)
        turned = np.array([frame_turn(k) @ corner for corner in product(*zip(low, high, strict=True))])
        boxes[name] = [turned.min(axis=0).round(4).tolist(), turned.max(axis=0).round(4).tolist()]
    content["segments"] = {"pairs": [list(pair) for pair in PAIRS], "com_box": boxes}
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=110)
