"""A recording of a real robot, what its diagnosis says, and what of that is known from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from excite.diagnosis.answer.answer import Diagnosis
from excite.logs.log import Log

RIGID, FRICTION = ("rigid_body",), ("viscous_friction", "coulomb_friction")


@dataclass(frozen=True)
class Bar:
    """Something that the diagnosis has to say, because it is known from elsewhere.

    Attributes:
        what: in words, with the figure that is known.
        reached: what the diagnosis says.
        met: whether that is good enough.
        reason: why it is not met, where that is known. It excuses nothing.
        own: whether the bar is this project's, and stands in no publication.
    """

    what: str
    reached: str
    met: bool
    reason: str = ""
    own: bool = False

    @property
    def mark(self) -> str:
        """A tick or a cross, in brackets where no publication states the bar."""
        return f"({'✓' if self.met else '✗'})" if self.own else "✓" if self.met else "✗"


@dataclass(frozen=True, eq=False)
class Entry:
    """A recording and its diagnosis.

    Attributes:
        title: of the section.
        source: who recorded it and where it is published.
        trials: which parts were fitted and which judged.
        baseline: what the model had, in words.
        known: what is known from the publication.
        diagnosis: what ``excite.diagnose`` says.
        bars: what it has to say.
        remark: what supports it, and what does not agree, in one or two sentences.
        picture: file in ``docs/images``, with its description, None where there is none.
    """

    title: str
    source: str
    trials: str
    baseline: str
    known: str
    diagnosis: Diagnosis
    bars: tuple[Bar, ...]
    remark: str = ""
    picture: tuple[str, str] | None = None


def with_modelled(log: Log, modelled: tuple[str, ...]) -> Log:
    """The log with another baseline."""
    return replace(log, header=log.header.model_copy(update={"modelled": modelled}))


def with_repeats(log: Log, first: dict[str, str]) -> Log:
    """The log in which trials repeat others: by name, the one whose command they run again."""
    files = {Path(entry.file).stem: entry.file for entry in log.header.trials}
    entries = tuple(
        entry.model_copy(update={"repeats": files[first[name]]}) if name in first else entry
        for name, entry in ((Path(entry.file).stem, entry) for entry in log.header.trials)
    )
    trials = tuple(replace(trial, repeats=first.get(trial.name)) for trial in log.trials)
    return replace(log, header=log.header.model_copy(update={"trials": entries}), trials=trials)


def names(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Effects that the verdict names: those that it cannot tell apart, or those accepted."""
    found = diagnosis.ambiguous_with or diagnosis.effects
    return tuple(item.effect for item in found)


def said(diagnosis: Diagnosis) -> str:
    """Verdict, names and place in a few words."""
    if diagnosis.verdict == "unknown":
        return f"unknown at {diagnosis.location}"
    if diagnosis.verdict == "none":
        return "none"
    link = " or " if diagnosis.verdict == "ambiguous" else ", "
    found = diagnosis.ambiguous_with or diagnosis.effects
    return link.join(f"{item.effect.replace('_', ' ')} at {item.location}" for item in found)
