"""Effects written beside a model that cannot express them, and read again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from excite.diagnosis.floating.effects.effect import FloatingEffect
from excite.diagnosis.floating.effects.pressed_contact import PressedContact, Surface
from excite.diagnosis.floating.effects.registry import FLOATING_EFFECTS, FURTHER_FORMS
from excite.diagnosis.floating.effects.unlogged_contact import UnloggedContact
from excite.diagnosis.floating.record import FloatingRecord
from excite.diagnosis.floating.refinement import Placed
from excite.diagnosis.floating.state import State
from excite.diagnosis.model_notes import NOTE, model_notes
from excite.robot.robot import Array

if TYPE_CHECKING:
    import mujoco

_SURFACE = tuple(f"surface.{name}" for name in ("x", "y", "z", "height", "depth", "rounded"))


def note_name(number: int, item: Placed) -> str:
    """Name of the text in which an effect stands; the number keeps the order."""
    return f"{NOTE}.{number}.{item.effect.word}.{item.location}"


def note_data(state: State, item: Placed, theta: Array) -> str:
    """Its parameters, by name; of a contact the surface as well.

    Args:
        state: the nominal state.
        item: the effect.
        theta: its parameters.
    """
    names = [p.name for p in item.effect.parameters(state, item.location)]
    values = dict(zip(names, theta, strict=True))
    if isinstance(item.effect, PressedContact):
        s = item.effect.surface
        values |= dict(zip(_SURFACE, (*s.normal, s.height, s.depth, float(s.rounded)), strict=True))
    if isinstance(item.effect, UnloggedContact) and item.effect.share is not None:
        values |= _spells(item.effect.share, state.record)
    return " ".join(f"{name}={value:.12g}" for name, value in values.items())


def read_notes(model: mujoco.MjModel, record: FloatingRecord) -> tuple[tuple[Placed, ...], tuple[Array, ...]]:
    """The effects noted in a loaded model, in order, and their parameters.

    Args:
        model: the model.
        record: the record that it is run on.
    """
    found = []
    for rest, values in model_notes(model):
        number, word, location = rest.split(".", 2)
        effect = _effect(word, values, record)
        # What is the effect's own and none of its parameters has a point in its name.
        theta = np.array([value for name, value in values.items() if "." not in name])
        found.append((int(number), Placed(effect, location), theta))
    found.sort(key=lambda item: item[0])
    return tuple(item for _, item, _ in found), tuple(theta for *_, theta in found)


def _spells(share: Array, record: FloatingRecord) -> dict[str, float]:
    """When a contact lasts: by trial and number of the spell, from and to [s]."""
    found = {}
    for trial, span in zip(record.trials, record.spans, strict=True):
        on = np.concatenate([[0], share[span] > 0.5, [0]])
        change = np.flatnonzero(np.diff(on.astype(int)))
        for k, (first, last) in enumerate(change.reshape(-1, 2)):
            found[f"{trial}.{k}.from"] = first / record.rate_hz
            found[f"{trial}.{k}.to"] = last / record.rate_hz
    return found


def _lasting(values: dict[str, float], record: FloatingRecord) -> UnloggedContact:
    """The contact with these spells."""
    share = np.zeros(record.n_samples)
    for name, begins in values.items():
        trial, _, rest = name.rpartition(".")[0].rpartition(".")
        if name.endswith(".from") and trial in record.trials:
            span = record.spans[record.trials.index(trial)]
            ends = values[f"{trial}.{rest}.to"]
            share[span][round(begins * record.rate_hz) : round(ends * record.rate_hz)] = 1.0
    return UnloggedContact(share)


def _effect(word: str, values: dict[str, float], record: FloatingRecord) -> FloatingEffect:
    if word == UnloggedContact.name:
        return _lasting(values, record)
    if word == PressedContact.form:
        x, y, z, height, depth, rounded = (values[name] for name in _SURFACE)
        return PressedContact(Surface((x, y, z), height, depth, bool(rounded)))
    further = {form.word: form for forms in FURTHER_FORMS.values() for form in forms}
    return (FLOATING_EFFECTS | further)[word]
