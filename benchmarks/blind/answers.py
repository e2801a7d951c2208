"""Answers to blind cases as files, and programs side by side in one table."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.blind.documents import Answer, BlindAnswer
from excite.diagnosis.answer.answer import Diagnosis
from excite.documents.document import model_of, read_document
from excite.errors import InputError
from excite.finding import list_names
from excite.formats.documents import read_json
from excite.logs.vocabulary import EFFECTS
from excite.robot.loading import load_robot

# Effects that an answer names, with what it says that each takes of which joint's gap.


@dataclass
class Stated:
    """An effect that an answer names.

    Attributes:
        effect: its name.
        location: its place.
        tied: places that are said to be as likely, its own not among them.
        shares: of each joint's gap, by joint.
        intervals: 90 % interval of those, by joint, where one is stated.
    """

    effect: str
    location: str
    tied: frozenset[str] = frozenset()
    shares: dict[str, float] = field(default_factory=dict)
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)

    def add(self, channel: str, share: float | None, interval: Any) -> None:
        """A share of a joint, and its interval if there is a whole one."""
        if share is None:
            return
        self.shares[channel] = float(share)
        if interval is not None and None not in tuple(interval):
            self.intervals[channel] = (float(interval[0]), float(interval[1]))


def of_answer(content: Mapping[str, Any], joints: Collection[str]) -> tuple[Stated, ...]:
    """Effects of an ``excite.blind_answer/1``; a share without a channel is of the joint that is the place."""
    made: dict[tuple[str, str], Stated] = {}
    for item in content["effects"]:
        stated = _stated_effect(made, item)
        channel = item["channel"] or (item["location"] if item["location"] in joints else None)
        if channel is not None:
            stated.add(channel, item["share"], item["interval90"])
    return tuple(made.values())


def of_diagnosis(document: Mapping[str, Any]) -> tuple[Stated, ...]:
    """Effects of an ``excite.diagnosis/1``: the accepted ones, and what its budget names."""
    made: dict[tuple[str, str], Stated] = {}
    for item in document["effects"]:
        _stated_effect(made, item)
    for channel, budget in document.get("budget", {}).items():
        for item in budget["effects"]:
            _stated_effect(made, item).add(channel, item["share"], item.get("interval90"))
    return tuple(made.values())


def _stated_effect(made: dict[tuple[str, str], Stated], item: Mapping[str, Any]) -> Stated:
    """The effect that an item speaks of, made where it is new."""
    key = (item["effect"], str(item["location"]))
    tied = frozenset(item.get("tied_locations", ())) - {key[1]}
    known = made.setdefault(key, Stated(*key, tied))
    known.tied |= tied
    return known


# Answers to blind cases as files: one a case, a program's own or a diagnosis.

_REMEDY = "docs/benchmark.md shows an answer; a case in which nothing is found has one without effects"
_WHOLE = ("base", "torque", "wrench")


@dataclass(frozen=True)
class EntryAnswer:
    """What is said of one case.

    Attributes:
        document: as ``excite.diagnosis/1`` says it, as far as scores look at it.
        stated: every effect that it names, with its shares.
        seconds: processor time it took [s], None where that is not said.
    """

    document: Mapping[str, Any]
    stated: tuple[Stated, ...]
    seconds: float | None = None


def read_entry(folder: str | Path, answers: Mapping[str, Answer]) -> dict[str, EntryAnswer]:
    """Answers of one entry, a file ``CASE.json`` for every case.

    Args:
        folder: of the files.
        answers: what is hidden, by case; names of robots and the list of cases are taken from it.

    Raises:
        InputError: a case has no file, a file is malformed, or it names an effect or a place that does not exist.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("is no folder", source=folder, remedy="name a folder of answers, one file a case")
    missing = [case for case in sorted(answers) if not (folder / f"{case}.json").is_file()]
    if missing:
        names = list_names([f"{case}.json" for case in missing], 5)
        raise InputError(f"lacks {names}", source=folder, remedy=_REMEDY)
    return {case: _read_answer(folder / f"{case}.json", answers[case]) for case in sorted(answers)}


def _read_answer(path: Path, answer: Answer) -> EntryAnswer:
    said = read_json(path, remedy=_REMEDY).get("schema")
    if said == Diagnosis.SCHEMA:
        return from_diagnosis(read_document(path, model_of(Diagnosis), remedy=_REMEDY).content())
    if said != BlindAnswer.SCHEMA:
        either = f"{BlindAnswer.SCHEMA} or {Diagnosis.SCHEMA}"
        raise InputError(f"schema is {said!r:.60}, not {either}", source=path, field="schema", remedy=_REMEDY)
    content = read_document(path, model_of(BlindAnswer), remedy=_REMEDY).content()
    _check_names(path, [*content["effects"], *content["rivals"]], answer)
    stated = of_answer(content, channels_of(answer))
    return EntryAnswer(_as_diagnosis(content), stated, content["seconds"])


def from_diagnosis(document: Mapping[str, Any], seconds: float | None = None) -> EntryAnswer:
    """A diagnosis (``excite.diagnosis/1``) as an answer."""
    return EntryAnswer(document, of_diagnosis(document), seconds)


def channels_of(answer: Answer) -> tuple[str, ...]:
    """Joints of a case's robot."""
    return load_robot(answer.robot).joint_names


def _check_names(path: Path, effects: Iterable[Mapping[str, Any]], answer: Answer) -> None:
    """Refuse words that no answer could be right with: mostly slips of the pen."""
    robot = load_robot(answer.robot)
    joints = robot.joint_names
    places = {*joints, *_WHOLE, *(segment.link for segment in robot.segments)}
    for item in effects:
        if item["effect"] not in EFFECTS:
            remedy = "choose one of " + ", ".join(EFFECTS)
            raise InputError(f"no effect is called {item['effect']!r:.60}", source=path, remedy=remedy)
        # Sensors of standing robots are named in their logs.
        if not robot.floating and item["location"] not in places:
            remedy = "name a joint or a link of the case's robot.urdf, base or torque"
            raise InputError(f"{answer.robot} has no {item['location']!r:.60}", source=path, remedy=remedy)
        channel = item.get("channel")
        if channel is not None and not robot.floating and channel not in joints:
            remedy = "choose one of " + ", ".join(joints)
            raise InputError(f"{answer.robot} has no joint {channel!r:.60}", source=path, remedy=remedy)


def _as_diagnosis(content: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a diagnosis that scores look at."""
    effects: dict[tuple[str, str], dict[str, Any]] = {}
    for item in content["effects"]:
        place = item["location"]
        made = {"effect": item["effect"], "location": place, "tied_locations": item["tied_locations"]}
        effects.setdefault((item["effect"], place), made)
    named = list(effects.values())
    verdict = content["verdict"] or ("effect" if named else "none")
    rivals = [{**item, "tied_locations": []} for item in content["rivals"]]
    first = named[0] if named else {"effect": None, "location": content["location"], "tied_locations": []}
    return {
        "verdict": verdict,
        **first,
        "effects": named,
        "candidates": [*named[:1], *rivals, *named[1:]],
        "n_tied": 1 + len(rivals) if verdict == "ambiguous" else 0,
        "gap": {"share_closed": None},
    }
