"""A candidate that is not drawn yet."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Proposal:
    """All that a candidate depends on, besides the robot: it can be drawn anywhere, any number of times.

    Attributes:
        generator: registry name of its generator.
        seed: of all its random numbers.
        targets: joints that it is aimed at.
        name: unique within a plan.
    """

    generator: str
    seed: int
    targets: tuple[str, ...]
    name: str
