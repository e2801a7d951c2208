"""What there is to say about each effect in a line: its law, what it looks like, what tells it apart."""

from __future__ import annotations

import inspect
from dataclasses import asdict, dataclass

from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.floating.effect import FloatingEffect
from excite.diagnosis.floating.registry import EVERY_FORM

_NOTED = "none of its own: a note for whoever runs the model"


@dataclass(frozen=True)
class EffectSummary:
    """An effect in a line.

    Attributes:
        name: its word in a diagnosis and, where a baseline can have it, in ``modelled``.
        form: which of several forms of the same physics; the name where there is but one.
        base: ``fixed`` for arms, ``floating`` for standing robots and people.
        law: what is added to the nominal model, with its source.
        looks_like: what it may be taken for.
        told_apart_by: motion or measurement that tells it from those; empty where ``looks_like`` says so.
        mujoco: how a MuJoCo model has it.
    """

    name: str
    form: str
    base: str
    law: str
    looks_like: str
    told_apart_by: str = ""
    mujoco: str = ""

    def to_json(self) -> dict[str, str]:
        """The fields by name, ready for JSON."""
        return asdict(self)


def effect_summaries() -> tuple[EffectSummary, ...]:
    """All effects that a diagnosis tries, those of arms first; several forms of one physics are listed apart."""
    arms = (
        EffectSummary(
            name=effect.name,
            form=effect.name,
            base="fixed",
            law=_first_paragraph(effect),
            looks_like=", ".join(effect.confusable_with),
            told_apart_by=effect.separating_motion,
            mujoco=effect.mujoco,
        )
        for effect in EFFECTS.values()
    )
    standing = (
        EffectSummary(
            name=effect.name,
            form=effect.form_name,
            base="floating",
            law=_first_paragraph(effect),
            looks_like=effect.reads_as,
            mujoco=effect.mujoco_part or _NOTED,
        )
        for effect in EVERY_FORM.values()
    )
    return (*arms, *standing)


def _first_paragraph(effect: Effect | FloatingEffect) -> str:
    """The first paragraph of its class' documentation."""
    return " ".join((inspect.getdoc(type(effect)) or "").split("\n\n")[0].replace("``", "").split())
