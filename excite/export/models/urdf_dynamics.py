"""What a written URDF says of its joints' drives: friction, and the limits that readers insist on."""

from __future__ import annotations

from collections.abc import Mapping

from excite.export.models.xml_text import XmlText, number_text
from excite.robot.robot import Robot
from excite.robot.urdf.tree import MOVING


def set_dynamics(text: XmlText, found: Mapping[str, float]) -> list[str]:
    """Put friction into ``<dynamics>``; what no passive joint has is left as it was.

    Args:
        text: of a URDF, edited in place.
        found: friction by name, such as ``viscous.JOINT``; other parameters are passed over.

    Returns:
        What was not written, a sentence each.
    """
    joints = {str(joint.attributes.get("name")): joint for joint in text.root.named("joint")}
    notes = []
    for name, joint in joints.items():
        values = {}
        for term, attribute in (("viscous", "damping"), ("coulomb", "friction")):
            value = found.get(f"{term}.{name}")
            if value is not None and value < 0.0:
                notes.append(
                    f"{name}: {term} friction was identified as {value:.3g}, below zero; not written"
                )
            elif value is not None:
                values[attribute] = number_text(value)
        if not values:
            continue
        if joint.named("dynamics"):
            text.set(joint.named("dynamics")[0], **values)
        else:
            inside = " ".join(f'{key}="{value}"' for key, value in values.items())
            text.insert_first(joint, f"<dynamics {inside}/>")
    return notes


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
