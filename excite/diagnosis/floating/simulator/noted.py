"""Effects written beside a model that cannot express them, and read again."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.form import StandingNote
from excite.diagnosis.floating.effects.registry import EVERY_FORM
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.search.refinement import Placed
from excite.diagnosis.simulator.model_text import NOTE, model_notes
from excite.errors import InputError

if TYPE_CHECKING:
    import mujoco


def write_note(spec: mujoco.MjSpec, number: int, note: StandingNote) -> None:
    """Leave a note in a specification; the number keeps the order."""
    spec.add_text(name=f"{NOTE}.{number}.{note.word}.{note.location}", data=note.text())


def read_notes(model: mujoco.MjModel, record: FloatingRecord) -> tuple[tuple[Placed, ...], tuple[Array, ...]]:
    """The effects noted in a loaded model, in order, and their parameters.

    Args:
        model: the model.
        record: the record that it is run on.

    Raises:
        InputError: a note is of no effect that is known.
    """
    found = []
    for rest, data in model_notes(model):
        number, word, location = rest.split(".", 2)
        said = json.loads(data)
        if word not in EVERY_FORM:
            raise InputError(
                f"the model has a note of no effect that is known ({NOTE}.{rest})",
                field=word,
                remedy="name it by a form that `excite effects` lists",
            )
        effect = EVERY_FORM[word].holding(said, record)
        found.append((int(number), Placed(effect, location), np.array([*said["parameters"].values()])))
    found.sort(key=lambda item: item[0])
    return tuple(item for _, item, _ in found), tuple(theta for *_, theta in found)
