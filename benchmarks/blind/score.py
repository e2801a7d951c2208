"""Diagnoses compared with what was hidden; reads documents only, whoever wrote them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

from benchmarks.blind.answers import EntryAnswer, from_diagnosis
from benchmarks.blind.arms_with_everything import MixtureScore, mixture_figures, score_mixture
from benchmarks.blind.case_score import CaseScore, score_case
from benchmarks.blind.documents import Answer


@dataclass(frozen=True)
class BlindScore:
    """All cases of a battery.

    Attributes:
        cases: one a case.
        seconds: by case, how long its diagnosis took; empty where it was not measured.
        mixtures: the cases with a little of everything, by shares.
    """

    cases: tuple[CaseScore, ...]
    seconds: Mapping[str, float]
    mixtures: tuple[MixtureScore, ...] = ()

    def share(self, what: str, *kinds: str) -> float | None:
        """Share of the cases of these kinds (all without any) that are ``named``, ``placed`` or ``firm_wrong``."""
        return _mark_share(
            [bool(getattr(case, what)) for case in self.cases if not kinds or case.kind in kinds]
        )

    @property
    def found(self) -> float | None:
        """Share of the hidden effects of doubles that are found."""
        chosen = [case for case in self.cases if case.kind == "double"]
        return sum(c.found for c in chosen) / sum(c.hidden for c in chosen) if chosen else None

    def _closed(self, quantile: float) -> float | None:
        """Share of the gap closed that this share of the cases with effects stays below."""
        closed = sorted(
            c.share_closed
            for c in self.cases
            if c.kind not in {"none", "unknown"} and c.share_closed is not None
        )
        return closed[int(quantile * len(closed))] if closed else None

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
    def brier(self) -> float | None:
        """Mean square of stated probability less outcome (Brier 1950); None where none is stated."""
        stated = [(c.probability - c.named) ** 2 for c in self.cases if c.probability is not None]
        return sum(stated) / len(stated) if stated else None

    @property
    def parameter_errors(self) -> dict[str, dict[str, float]]:
        """Median relative error of the main parameter, and of how many, by effect."""
        found: dict[str, list[float]] = {}
        for case in self.cases:
            for name, error in case.parameter_errors:
                found.setdefault(name, []).append(error)
        return {
            name: {"median": float(median(errors)), "count": len(errors)}
            for name, errors in sorted(found.items())
        }

    @property
    def detectable(self) -> BlindScore:
        """The cases whose effects all stand far enough above the noise; those without any are among them."""
        cases = tuple(case for case in self.cases if case.detectable)
        return BlindScore(
            cases, {c.case: self.seconds[c.case] for c in cases if c.case in self.seconds}, self.mixtures
        )

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
            "none_of_faulty_records_kept": _mark_share(
                [c.named for c in self.cases if c.kind == "none" and c.faults]
            ),
            "unknown_recognised": self.share("named", "unknown"),
            "unknown_placed": self.share("placed", "unknown"),
            "firm_wrong": self.share("firm_wrong"),
            "median_share_closed": self._closed(0.5),
            "worst_tenth_share_closed": self._closed(0.1),
            "brier": self.brier,
            **(mixture_figures(self.mixtures) if self.mixtures else {}),
            "seconds_median": seconds[len(seconds) // 2] if seconds else None,
        }

    def summary(self) -> str:
        """Figures of all cases and of the detectable ones, then the cases that went wrong."""
        lines = [f"{'':28} {'all':>8} {'detectable':>12}"]
        clear = self.detectable.figures()
        for name, value in self.figures().items():
            if value is not None:
                columns = f"{_figure_text(name, value):>8} {_figure_text(name, clear[name]):>12}"
                lines.append(f"{name.replace('_', ' '):28} {columns}")
        for name, item in self.parameter_errors.items():
            line = f"{100 * item['median']:.1f} % ({item['count']:.0f})"
            lines.append(f"error of {name.replace('_', ' '):19} {line:>8}")
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
            "parameter_errors": self.parameter_errors,
            "cases": [asdict(case) for case in self.cases],
            "everything": [asdict(case) for case in self.mixtures],
        }


def score_diagnoses(
    answers: Mapping[str, Answer], documents: Mapping[str, Mapping[str, Any]], seconds: Mapping[str, float]
) -> BlindScore:
    """Score all diagnoses (``excite.diagnosis/1``); cases without one are left out."""
    said = {name: from_diagnosis(document, seconds.get(name)) for name, document in documents.items()}
    return score_entry(answers, said)


def score_entry(answers: Mapping[str, Answer], said: Mapping[str, EntryAnswer]) -> BlindScore:
    """Score all answers of an entry; cases without one are left out."""
    cases = tuple(score_case(name, answers[name], said[name].document) for name in sorted(said))
    mixtures = tuple(
        score_mixture(name, answers[name], said[name].stated)
        for name in sorted(said)
        if answers[name].kind == "everything"
    )
    seconds = {name: item.seconds for name, item in said.items() if item.seconds is not None}
    return BlindScore(cases, seconds, mixtures)


_SHARES = frozenset({"named", "placed", "found", "kept", "recognised", "wrong", "closed", "right", "inside"})


def _mark_share(marks: list[bool]) -> float | None:
    return sum(marks) / len(marks) if marks else None


def _figure_text(name: str, value: float | None) -> str:
    """A figure for people: shares in percent."""
    if value is None:
        return "-"
    return f"{100 * value:.0f} %" if name.split("_")[-1] in _SHARES else f"{value:.3g}"
