"""Notes of effects in a model: written as texts of it, and read again as what they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from excite.diagnosis.effects.friction.build_up import PRESLIDING, BuildUp
from excite.diagnosis.effects.note import Note, Noted
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.simulator.model_text import NOTE, model_notes
from excite.errors import InputError

if TYPE_CHECKING:
    import mujoco


def write_note(spec: mujoco.MjSpec, item: Noted) -> None:
    """Leave a note in a specification."""
    spec.add_text(name=f"{NOTE}.{item.word}.{item.place}", data=item.note.text())


def read_notes(model: mujoco.MjModel) -> tuple[Noted, ...]:
    """The notes in a loaded model, in order.

    Raises:
        InputError: a note is of no effect that is known, or lacks a number.
    """
    return tuple(_read(name, text) for name, text in model_notes(model))


def _read(name: str, text: str) -> Noted:
    word, _, place = name.partition(".")
    kind = BuildUp if word == PRESLIDING else _of_effect(word)
    if kind is None or not place:
        raise InputError(
            f"the model has a note of no effect that is known ({NOTE}.{name})",
            field=word,
            remedy=f"name it {NOTE}.EFFECT.PLACE, with an effect that leaves notes",
        )
    pairs = [pair.partition("=") for pair in text.split()]
    try:
        values = {key: float(value) for key, _, value in pairs}
        note = kind.of(values)
    except (TypeError, ValueError) as error:
        raise _unreadable(name, text, kind) from error
    if set(values) - set(kind.numbers()):
        raise _unreadable(name, text, kind)
    return Noted(word, place, note)


def _unreadable(name: str, text: str, kind: type[Note]) -> InputError:
    return InputError(
        f"the note {NOTE}.{name} cannot be read ({text})",
        field=name,
        remedy=f"write NAME=NUMBER, with the names {', '.join(kind.numbers())}",
    )


def _of_effect(word: str) -> type[Note] | None:
    effect = EFFECTS.get(word)
    return None if effect is None else effect.note
