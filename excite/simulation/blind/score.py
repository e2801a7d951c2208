"""Diagnoses compared with what was hidden; reads documents only, whoever wrote them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from excite.simulation.blind.detectability import DETECTABLE
from excite.simulation.blind.hidden import Answer

_SAME = {"payload": "link_inertia"}
_PAIR = frozenset({"torque_bias", "coulomb_asymmetry"})


@dataclass(frozen=True)
class CaseScore:
    """One case.

    Attributes:
        case: its name.
        kind: single, weak, double, none or unknown.
        truth: hidden effects with places and forms, for people.
        said: what the diagnosis says, for people.
        named: whether a hidden effect's name, or none, or unknown, is what it says; ties that hold it count.
        placed: whether a hidden effect's place is its place or among its tied places.
        firm_wrong: a wrong name without a doubt.
        found: hidden effects that are among its effects.
        hidden: number of hidden effects.
        extras: effects that are not there.
        faults: faults of the record, by kind.
        detectable: whether all that is hidden stands far enough above the noise; where nothing is, True.
        probability: that it states for its first candidate, None where it states none.
        share_closed: of the gap.
        interval: 90 % interval of that, None where it states none.
    """

    case: str
    kind: str
    truth: str
    said: str
    named: bool
    placed: bool
    firm_wrong: bool
    found: int
    hidden: int
    extras: int
    faults: tuple[str, ...]
    detectable: bool
    probability: float | None
    share_closed: float
    interval: tuple[float, float] | None


def score_case(case: str, answer: Answer, document: Mapping[str, Any]) -> CaseScore:
    """Compare one diagnosis (``excite.diagnosis/1``) with its answer."""
    verdict, effects = document["verdict"], list(document["effects"])
    if not effects and document["effect"] is not None:
        effects = [document["candidates"][0]]
    names = [_canonical(item.effect) for item in answer.effects]
    said = [_canonical(item["effect"]) for item in effects]
    options = set(said[:1])
    if verdict == "ambiguous":
        options |= {_canonical(item["effect"]) for item in _tied(document)}
    kind = answer.kind
    if not names or names == ["unknown"]:
        right = verdict == ("none" if not names else "unknown")
        places = {document["location"], *document["tied_locations"]}
        placed = right and (not names or answer.effects[0].location in places)
        hits, extras, wrong = int(right), len(effects), verdict == "effect"
    else:
        # What is truly there, in the background, is no mistake, though not what was asked for.
        there = {(_canonical(item.effect), item.location) for item in answer.background}
        real = [(_canonical(item["effect"]), item["location"]) in there for item in effects]
        hits = sum(any(_match(name, other) for other in said) for name in names)
        extras = sum(
            not known and not any(_match(name, other) for name in names)
            for other, known in zip(said, real, strict=True)
        )
        right = verdict in {"effect", "ambiguous"} and any(n in options for n in names)
        places = {p for item in effects for p in (item["location"], *item.get("tied_locations", []))}
        places |= {item["location"] for item in _tied(document)} if verdict == "ambiguous" else set()
        placed = any(item.location in places for item in answer.effects)
        wrong = verdict == "effect" and not (said and (real[0] or said[0] in names))
    first = document["candidates"][0] if document["candidates"] else {}
    interval = document["gap"].get("share_closed_90")
    text = f"{verdict}: " + ", ".join(f"{item['effect']}@{item['location']}" for item in effects)
    if verdict == "ambiguous":
        text += " among " + "/".join(f"{item['effect']}@{item['location']}" for item in _tied(document))
    if verdict == "unknown":
        text += str(document["location"])
    truth = ", ".join(f"{item.effect}@{item.location} ({item.form})" for item in answer.effects) or "none"
    return CaseScore(
        case,
        kind,
        truth,
        text,
        right,
        placed,
        wrong,
        hits,
        max(len(names), 1),
        extras,
        answer.faults,
        all(item.detectability is None or item.detectability >= DETECTABLE for item in answer.effects),
        first.get("probability"),
        float(document["gap"]["share_closed"]),
        None if interval is None else (float(interval[0]), float(interval[1])),
    )


@dataclass(frozen=True)
class BlindScore:
    """All cases of a battery.

    Attributes:
        cases: one a case.
        seconds: by case, how long its diagnosis took; empty where it was not measured.
    """

    cases: tuple[CaseScore, ...]
    seconds: Mapping[str, float]

    def share(self, what: str, *kinds: str) -> float | None:
        """Share of the cases of these kinds (all without any) that are ``named``, ``placed`` or ``firm_wrong``."""
        return _share([bool(getattr(case, what)) for case in self.cases if not kinds or case.kind in kinds])

    @property
    def found(self) -> float | None:
        """Share of the hidden effects of doubles that are found."""
        chosen = [case for case in self.cases if case.kind == "double"]
        return sum(c.found for c in chosen) / sum(c.hidden for c in chosen) if chosen else None

    @property
    def confusion(self) -> dict[str, dict[str, int]]:
        """Counts of what was said first, by what was hidden first."""
        table: dict[str, Counter[str]] = {}
        for case in self.cases:
            truth = case.truth.split("@")[0]
            verdict, _, rest = case.said.partition(": ")
            name = rest.split("@")[0] if verdict in {"effect", "ambiguous"} else verdict
            label = f"{name}?" if verdict == "ambiguous" else name
            table.setdefault(truth, Counter())[label] += 1
        return {truth: dict(row) for truth, row in sorted(table.items())}

    @property
    def calibration(self) -> list[dict[str, float]]:
        """Stated probabilities of the first candidate in four bins: mean stated, share right, count."""
        stated = [(c.probability, c.named) for c in self.cases if c.probability is not None]
        lines = []
        for low, high in ((0.0, 0.5), (0.5, 0.9), (0.9, 0.99), (0.99, 1.01)):
            inside = [(p, right) for p, right in stated if low <= p < high]
            if inside:
                mean = sum(p for p, _ in inside) / len(inside)
                right = sum(right for _, right in inside) / len(inside)
                lines.append({"stated": mean, "right": right, "count": len(inside)})
        return lines

    @property
    def detectable(self) -> BlindScore:
        """The cases whose effects all stand far enough above the noise; those without any are among them."""
        cases = tuple(case for case in self.cases if case.detectable)
        return BlindScore(cases, {c.case: self.seconds[c.case] for c in cases if c.case in self.seconds})

    def figures(self) -> dict[str, float | None]:
        """The battery in numbers."""
        seconds = sorted(self.seconds.values())
        return {
            "cases": len(self.cases),
            "single_named": self.share("named", "single"),
            "single_placed": self.share("placed", "single"),
            "weak_named": self.share("named", "weak"),
            "weak_placed": self.share("placed", "weak"),
            "double_found": self.found,
            "double_extras": sum(c.extras for c in self.cases if c.kind == "double"),
            "none_kept": self.share("named", "none"),
            "none_of_faulty_records_kept": _share(
                [c.named for c in self.cases if c.kind == "none" and c.faults]
            ),
            "unknown_recognised": self.share("named", "unknown"),
            "unknown_placed": self.share("placed", "unknown"),
            "firm_wrong": self.share("firm_wrong"),
            "seconds_median": seconds[len(seconds) // 2] if seconds else None,
        }

    def summary(self) -> str:
        """Figures of all cases and of the detectable ones, then the cases that went wrong."""
        lines = [f"{'':28} {'all':>8} {'detectable':>12}"]
        clear = self.detectable.figures()
        for name, value in self.figures().items():
            if value is not None:
                columns = f"{_figure(name, value):>8} {_figure(name, clear[name]):>12}"
                lines.append(f"{name.replace('_', ' '):28} {columns}")
        for case in self.cases:
            marks = [
                mark
                for mark, bad in (
                    ("name", not case.named),
                    ("place", not case.placed),
                    ("firm wrong", case.firm_wrong),
                    ("extra", case.extras > 0),
                    ("hardly detectable", not case.detectable),
                )
                if bad
            ]
            if marks and marks != ["hardly detectable"]:
                lines.append(f"{case.case}: {case.truth} | {case.said} | {', '.join(marks)}")
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        """The score as a document."""
        return {
            "schema": "excite.blind_score/1",
            "figures": self.figures(),
            "figures_detectable": self.detectable.figures(),
            "confusion": self.confusion,
            "calibration": self.calibration,
            "cases": [asdict(case) for case in self.cases],
        }


def score(
    answers: Mapping[str, Answer], documents: Mapping[str, Mapping[str, Any]], seconds: Mapping[str, float]
) -> BlindScore:
    """Score all diagnoses; cases without one are left out."""
    cases = tuple(score_case(name, answers[name], documents[name]) for name in sorted(documents))
    return BlindScore(cases, dict(seconds))


def _tied(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Candidates that an ambiguous diagnosis cannot tell apart; a document that does not count them has two."""
    return list(document["candidates"][: int(document.get("n_tied", 2))])


_SHARES = frozenset({"named", "placed", "found", "kept", "recognised", "wrong"})


def _share(marks: list[bool]) -> float | None:
    return sum(marks) / len(marks) if marks else None


def _figure(name: str, value: float | None) -> str:
    """A figure for people: shares in percent."""
    if value is None:
        return "-"
    return f"{100 * value:.0f} %" if name.split("_")[-1] in _SHARES else f"{value:.3g}"


def _canonical(name: str | None) -> str:
    return _SAME.get(name or "", name or "")


def _match(hidden: str, said: str) -> bool:
    return hidden == said or {hidden, said} <= _PAIR
