"""What ``robot.yaml`` says of a mechanism: where loops close, which joints are coupled, which no motor drives."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from excite.robot.per_joint import Block, Name, Source
from excite.robot.quantities import MAX_RATIO, JointValue, Length, Ratio, Rotation3, Vector3


class LoopEnd(Block):
    """Where a loop is closed on one of its two links: a point, and axes where the links keep their orientation."""

    link: Name
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Rotation3 = (0.0, 0.0, 0.0)


class TieBlock(Block):
    """What ties joints together; ``passive`` names those of them that no motor drives and nobody logs."""

    name: Name
    passive: tuple[Name, ...] = ()
    source: Source


class LoopBlock(TieBlock):
    """Two links that meet beside their tree: in a point, as at a rod's ball, rigidly, or over a rod.

    A ``rod`` without mass holds two points at their distance in the model's zero posture, or at ``length``.
    """

    kind: Literal["point", "weld", "rod"] = "point"
    ends: Annotated[tuple[LoopEnd, ...], Field(min_length=2, max_length=2)]
    length: Length | None = None

    @model_validator(mode="after")
    def _rod(self) -> LoopBlock:
        if self.length is not None and self.kind != "rod":
            raise ValueError(f"loops {self.name}: a length goes with kind rod")
        return self


class CouplingBlock(TieBlock):
    """Joints that move together, as gears, belts and tendons make them: ``Σ p(q) = offset``.

    ``joints`` gives each joint's ``p``: a factor, or factors of q, q², q³ and q⁴. A URDF's ``<mimic>`` is such a
    coupling and need not be repeated.
    """

    joints: Annotated[
        dict[str, Ratio | Annotated[tuple[Ratio, ...], Field(min_length=1, max_length=4)]],
        Field(min_length=2),
    ]
    offset: JointValue = 0.0

    @model_validator(mode="after")
    def _moves(self) -> CouplingBlock:
        largest = max(abs(factor) for name in self.joints for factor in self.factors(name))
        for name, factors in self.joints.items():
            # What moves less than a gear of a gear would is tied to nothing, and follows from nothing.
            if max(map(abs, self.factors(name))) <= largest / MAX_RATIO**2:
                raise ValueError(f"couplings {self.name}: the factor of {name} is {factors}")
        return self

    def factors(self, joint: str) -> tuple[float, ...]:
        """Factors of a joint's q, q², …"""
        found = self.joints[joint]
        return found if isinstance(found, tuple) else (found,)
