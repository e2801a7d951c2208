"""What is hidden in a case."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that the nominal model lacks.

    Attributes:
        effect: its name in a diagnosis, or ``unknown``.
        location: its place.
        value: its main parameter, in the unit of that effect.
        form: which of the forms of the same physics it has; ``plain`` is the textbook's.
        details: further parameters.
        detectability: rest that the modelled terms cannot take, over the channel's noise in the band
            (:mod:`excite.blind.detectability`); None where it was not computed.
    """

    effect: str
    location: str
    value: float
    form: str = "plain"
    details: dict[str, float] = field(default_factory=dict)
    detectability: float | None = None


@dataclass(frozen=True)
class Answer:
    """What a diagnosis of a case should find.

    Attributes:
        kind: ``single``, ``weak``, ``double``, ``none`` or ``unknown``.
        robot: name of the robot.
        modelled: words of ``modelled`` in the log.
        effects: hidden effects, the stronger first; none where there is none.
        noise: factor on the usual noise.
        faults: faults of the record, by kind.
        background: what every joint has a little of beside them; empty where the robot has nothing else.
    """

    kind: str
    robot: str
    modelled: tuple[str, ...]
    effects: tuple[HiddenEffect, ...]
    noise: float
    faults: tuple[str, ...] = ()
    background: tuple[HiddenEffect, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """As it stands in the file of answers."""
        return asdict(self)

    @staticmethod
    def from_json(document: dict[str, Any]) -> Answer:
        """From the file of answers."""
        hidden = {
            name: tuple(HiddenEffect(**item) for item in document[name]) for name in ("effects", "background")
        }
        lists = {name: tuple(document[name]) for name in ("modelled", "faults")}
        return Answer(**{**document, **lists, **hidden})
