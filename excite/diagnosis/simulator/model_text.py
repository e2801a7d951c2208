"""The text of an augmented model: loaded by MuJoCo, and what stands in it of effects that XML cannot express."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from excite.diagnosis.attribution import Attribution, Scored
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Context, Form, Note, Noted, Sizes, Told
from excite.diagnosis.effects.friction import PRESLIDING, BuildUp
from excite.diagnosis.effects.registry import EFFECTS
from excite.errors import InputError

if TYPE_CHECKING:
    import mujoco

# First part of the names of the ``<custom>`` texts in which effects stand.
NOTE = "excite"
MODEL = "augmented.xml"
# By what an effect is made larger to see whether the model hears of it.
LOUDER = 1.5


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A MuJoCo model of an arm, its actuators motors that take torques, or of a standing robot, its sensors sites.

    Attributes:
        xml: the model. What XML cannot express stands in it as ``<custom><text name="excite.EFFECT.PLACE"/>``,
            applied by :class:`excite.diagnosis.simulator.rollout.Simulator` or its twin for standing robots.
        warnings: what it could not take up, one sentence each.
    """

    xml: str
    warnings: tuple[str, ...]


def without(left: Sequence[str]) -> tuple[str, ...]:
    """What is said where a model lacks effects, each ``NAME at PLACE``, that bring roll-outs no nearer."""
    if not left:
        return ()
    reason = "roll-outs of the identification trials are no nearer with it"
    return (f"the model is without {', '.join(left)}: {reason}",)


def ignored(effect: str, location: str) -> str:
    """What is said of an effect that moves no roll-out of the model in which it stands."""
    return f"the simulator ignores {effect} at {location}"


def load_model(xml: str) -> mujoco.MjModel:
    """The model; InputError where MuJoCo refuses it."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise refused(error) from error


def refused(error: ValueError) -> InputError:
    """What is said of a model that MuJoCo refuses."""
    said = " ".join(str(error).split())
    return InputError(f"MuJoCo refuses the model ({said})", remedy="judge by the torques or wrenches")


def model_notes(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """What follows ``excite.`` in the name of each text of an effect, and the text."""
    import mujoco

    found = []
    for k in range(model.ntext):
        head, _, rest = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, k).partition(".")
        if head == NOTE and rest:
            first, size = int(model.text_adr[k]), int(model.text_size[k])
            found.append((rest, bytes(model.text_data[first : first + size]).decode().rstrip("\0")))
    return found


# Sizes of the accepted effects as a simulator needs them.


def found_effects(attribution: Attribution) -> tuple[Found, ...]:
    """The accepted effects with their sizes as fitted together, beside a channel's gain in units of the true torque."""
    found = [_found(item) for item in attribution.accepted]
    forms = [item.form((item.location,)) for item in found]
    reads = {item.location: form.reads for item, form in zip(found, forms, strict=True) if form.reads != 1.0}
    return tuple(
        _read_at(item, reads[item.location]) if item.location in reads and _of_the_joint(item, form) else item
        for item, form in zip(found, forms, strict=True)
    )


def _of_the_joint(item: Found, form: Form) -> bool:
    """Whether an effect is a torque of its joint, neither a body nor of the channel that reads it."""
    return item.effect.own_joint and form.reads == 1.0 and form.bias == 0.0


def _read_at(item: Found, factor: float) -> Found:
    """An effect that a channel reads larger by a factor: its torques, and its shares of the load."""
    torques = {p.name for p in item.effect.linear if item.effect.by_load or p.unit != "1"}
    return replace(item, values={n: v / factor if n in torques else v for n, v in item.values.items()})


def _found(item: Scored) -> Found:
    h = item.hypothesis
    return Found(h.effect, item.location, h.effect.sizes(Context(h.baseline), h.location, h.theta, h.fit))


def told_states(attribution: Attribution) -> tuple[tuple[str, Told], ...]:
    """By place, what the record tells of each accepted effect's own state."""
    hypotheses = [item.hypothesis for item in attribution.accepted]
    return tuple((h.location, h.effect.told(h.context, h.location, h.theta)) for h in hypotheses)


# An accepted effect with its sizes, as a simulator takes it up.


@dataclass(frozen=True)
class Found:
    """An accepted effect with its sizes.

    Attributes:
        effect: the effect, in the form that was fitted.
        location: its place.
        values: its parameters, SI.
    """

    effect: Effect
    location: str
    values: Mapping[str, float]

    def form(self, joints: tuple[str, ...]) -> Form:
        """Its form in a model of an arm with torque at these joints."""
        return self.effect.in_mujoco(Sizes(self.location, self.values, joints))

    @property
    def formless(self) -> str | None:
        """Why no model can have it, in a sentence; None where models can."""
        absent = self.form((self.location,)).absent
        if absent is None:
            return None
        return f"{self.effect.name} has no form in a simulator and is left out of the model: {absent}"


# Notes of effects in a model: written as texts of it, and read again as what they are.


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
