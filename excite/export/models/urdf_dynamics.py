"""Friction of joints in the text of a URDF."""

from __future__ import annotations

from collections.abc import Mapping

from excite.export.models.xml_text import XmlText, number_text


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
