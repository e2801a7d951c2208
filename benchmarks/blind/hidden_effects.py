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
            (:mod:`benchmarks.blind.detectability`); None where it was not computed.
        shares: of the gap of each joint (:mod:`benchmarks.blind.arms_with_everything`); empty where not computed.
    """

    effect: str
    location: str
    value: float
    form: str = "plain"
    details: dict[str, float] = field(default_factory=dict)
    detectability: float | None = None
    shares: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class JointGap:
    """The true gap of a joint.

    Attributes:
        gap: root mean square of what the modelled terms leave because of the hidden effects [N·m].
        noise: that of the torque's noise in the same band [N·m].
        together: share of the gap that only several effects at once take; with the shares of all effects, one.
    """

    gap: float
    noise: float
    together: float


@dataclass(frozen=True)
class Answer:
    """What a diagnosis of a case should find.

    Attributes:
        kind: ``single``, ``weak``, ``double``, ``none``, ``unknown`` or ``everything``.
        robot: name of the robot.
        modelled: words of ``modelled`` in the log.
        effects: hidden effects, the stronger first; none where there is none.
        noise: factor on the usual noise.
        faults: faults of the record, by kind.
        background: what every joint has a little of beside them; empty where the robot has nothing else.
        joints: true gap of the joints that have one; empty where it was not computed.
    """

    kind: str
    robot: str
    modelled: tuple[str, ...]
    effects: tuple[HiddenEffect, ...]
    noise: float
    faults: tuple[str, ...] = ()
    background: tuple[HiddenEffect, ...] = ()
    joints: dict[str, JointGap] = field(default_factory=dict)

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
        joints = {name: JointGap(**item) for name, item in document.get("joints", {}).items()}
        return Answer(**{**document, **lists, **hidden, "joints": joints})
