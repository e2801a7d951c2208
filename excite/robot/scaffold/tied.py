"""Joints of a bare model that move together: which of its loops and couplings stay when joints are held still."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from excite.robot.scaffold.guesses import JointGuess
from excite.robot.scaffold.held import Held, nearest_to_zero
from excite.robot.urdf.tree import MOVING


@dataclass(frozen=True, eq=False)
class Tied:
    """Loops and couplings as blocks of a ``robot.yaml``, with the joints that each moves.

    Attributes:
        loops: ``(block, names of its joints)`` each.
        couplings: the same.
    """

    loops: tuple[tuple[Mapping[str, Any], frozenset[str]], ...] = ()
    couplings: tuple[tuple[Mapping[str, Any], frozenset[str]], ...] = ()

    @property
    def joints(self) -> frozenset[str]:
        """All joints that it moves."""
        return frozenset().union(*(names for _, names in (*self.loops, *self.couplings)))

    @property
    def closing(self) -> frozenset[str]:
        """Joints of its loops alone."""
        return frozenset().union(*(names for _, names in self.loops))

    def groups(self) -> list[frozenset[str]]:
        """Joints that loops and couplings with joints in common move together."""
        found: list[frozenset[str]] = []
        for _, names in (*self.loops, *self.couplings):
            touched = [group for group in found if group & names]
            found = [group for group in found if not group & names]
            found.append(names.union(*touched))
        return found

    def holding(self, held: Mapping[str, Held], guesses: tuple[JointGuess, ...]) -> dict[str, Held]:
        """What is held besides: of joints that move together all where one is, each where its model rests."""
        rests = {guess.name: nearest_to_zero(guess) for guess in guesses}
        more: dict[str, Held] = {}
        for group in self.groups():
            if group & set(held):
                more |= {
                    name: Held(rests[name], "it moves with a joint that is held")
                    for name in sorted(group - set(held))
                    if name in rests
                }
        return more

    def moving(self, held: Mapping[str, Held]) -> dict[str, list[dict[str, Any]]]:
        """Blocks ``loops`` and ``couplings`` of which no joint is held; nothing where there are none."""
        blocks = {"loops": self.loops, "couplings": self.couplings}
        kept = {
            field: [dict(block) for block, names in found if not names & set(held)]
            for field, found in blocks.items()
        }
        return {field: found for field, found in kept.items() if found}


def tied_blocks(
    joints: dict[str, ElementTree.Element],
    loops: tuple[Mapping[str, Any], ...],
    couplings: tuple[Mapping[str, Any], ...],
) -> Tied:
    """What blocks of a ``robot.yaml`` tie together in a URDF with these joints."""
    carriers = {}
    for name, joint in joints.items():
        parent, child = (str(joint.find(end).get("link")) for end in ("parent", "child"))  # type: ignore[union-attr]
        carriers[child] = (name, parent)

    def chain(link: str) -> set[str]:
        found = set()
        while link in carriers:
            name, link = carriers[link]
            if joints[name].get("type") in MOVING:
                found.add(name)
        return found

    return Tied(
        tuple(
            (block, frozenset(chain(block["ends"][0]["link"]) ^ chain(block["ends"][1]["link"])))
            for block in loops
        ),
        tuple((block, frozenset(block["joints"])) for block in couplings),
    )
