"""Forces that were measured at feet, tools or load cells: joints that turn are driven by torques, not by these."""

from __future__ import annotations

from collections.abc import Sequence

from excite.conversion.columns.families import Family
from excite.conversion.columns.vocabulary import FORCES
from excite.conversion.guesses import Guesses
from excite.conversion.machine import Machine


def without_contact_forces(found: Guesses, groups: Sequence[Family], machine: Machine) -> list[Family]:
    """The families without those called forces that are fewer than the joints, which turn.

    A column is called a force where something slides, is pressed or stands: some programs call all joints' torques
    forces, too, and then there is one for each joint of which there are positions.
    """
    placed = [len(family.placed.columns) for family in groups if family.quantity == "q"]
    joints = max(placed, default=machine.n)
    left = []
    for family in groups:
        if _is_force(family) and len(family.columns) < joints and not _is_prismatic_family(family, machine):
            why = "forces, fewer than the joints, which turn: of feet, tools or load cells, and no joint's torques"
            found.facts.append(("nothing", f"{family.columns[0]} …", why))
        else:
            left.append(family)
    return left


def _is_force(family: Family) -> bool:
    words = set(family.stem.split("_"))
    return (
        family.quantity == "tau"
        and not family.stated
        and bool(words & FORCES)
        and family.unit in ("", "N", "kN")
        and not (family.placed.named and family.placed.columns and not family.placed.left_over)
    )


def _is_prismatic_family(family: Family, machine: Machine) -> bool:
    places = [machine.joints.index(joint) for joint in family.placed.columns if joint in machine.joints]
    return any(bool(machine.slides[place]) for place in places)
