"""Effects written beside a model that cannot express them, and read again."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.floating.effects.registry import EVERY_FORM
from excite.diagnosis.floating.equations.record import FloatingRecord
from excite.diagnosis.floating.equations.state import State
from excite.diagnosis.floating.search.refinement import Placed
from excite.diagnosis.simulator.model_text import NOTE, model_notes

if TYPE_CHECKING:
    import mujoco


def note_name(number: int, item: Placed) -> str:
    """Name of the text in which an effect stands; the number keeps the order."""
    return f"{NOTE}.{number}.{item.effect.word}.{item.location}"


def note_data(state: State, item: Placed, theta: Array) -> str:
    """Its parameters by name, in order, and what else it holds, as JSON.

    Args:
        state: the nominal state.
        item: the effect.
        theta: its parameters.
    """
    names = [p.name for p in item.effect.parameters(state, item.location)]
    said = {"parameters": dict(zip(names, theta.tolist(), strict=True))}
    return json.dumps(said | item.effect.holds(state.record))


def read_notes(model: mujoco.MjModel, record: FloatingRecord) -> tuple[tuple[Placed, ...], tuple[Array, ...]]:
    """The effects noted in a loaded model, in order, and their parameters.

    Args:
        model: the model.
        record: the record that it is run on.
    """
    found = []
    for rest, data in model_notes(model):
        number, word, location = rest.split(".", 2)
        said = json.loads(data)
        effect = EVERY_FORM[word].holding(said, record)
        found.append((int(number), Placed(effect, location), np.array([*said["parameters"].values()])))
    found.sort(key=lambda item: item[0])
    return tuple(item for _, item, _ in found), tuple(theta for *_, theta in found)
