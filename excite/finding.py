"""Something that a careful reader of a log or of a result should know: one form for everything that looks at data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

from excite.display import Row, Tabled
from excite.results import LEFT_OUT, FilePath, Name, Positive, Stated, Unbounded, stated

Severity = Literal["fatal", "spoils", "limits", "note"]
_WORST_FIRST: tuple[Severity, ...] = ("fatal", "spoils", "limits", "note")


@dataclass(frozen=True)
class Finding(Stated):
    """What was found, in a sentence with its figures.

    Attributes:
        kind: what it is about, a word that programs can test for, such as ``degrees``.
        text: the sentence: what was found, the likely cause, what to do.
        figures: the numbers behind it by name, SI.
        places: joints, links, channels or parameters concerned.
        severity: ``fatal`` where nothing can be told; ``spoils`` what is computed until it is mended; ``limits`` what
            can be told; or a ``note``.
        sure: how far it is to be believed, 0 … 1; 1 where it was counted.
        repaired: whether what follows works with it mended.
        remedy: what was done, or what is to be done.
        trials: names of the trials concerned; empty for all.
    """

    kind: Name
    text: str
    figures: Mapping[Name, Any] = field(default_factory=dict)
    places: tuple[str, ...] = ()
    severity: Severity = "note"
    sure: Positive = 1.0
    repaired: bool = False
    remedy: str = ""
    trials: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """Trials and places in words; ``log`` for the whole of it."""
        return " ".join(part for part in (list_names(self.trials), list_names(self.places)) if part) or "log"

    def to_json(self) -> dict[str, Any]:
        """The finding as it stands in documents."""
        return {**super().to_json(), "sure": round(self.sure, 3)}


@dataclass(frozen=True, eq=False)
class EpisodeFindings(Stated):
    """What was found in an episode of a data set.

    Attributes:
        episode: its name.
        verdict: kinds of what was found, worst first; ``ok`` for nothing.
        findings: what differs from the other episodes, worst first.
        seconds: its length.
        step_s: median time between rows.
        gap_s: longest time between rows.
        measures: by measure and joint, in the file's own units; null where it cannot be told.
    """

    episode: Name
    verdict: str
    findings: tuple[Finding, ...]
    seconds: Unbounded
    step_s: Unbounded
    gap_s: Unbounded
    measures: Mapping[str, Mapping[str, Unbounded]]


@dataclass(frozen=True, eq=False, repr=False)
class Examination(Tabled, Stated):
    """What was found in a log or a robot's description, and where the repaired log is.

    Attributes:
        robot: name of the robot, or of its file.
        findings: worst first.
        repaired: folder of the repaired log; null where none was written.
        log_file: the log, relative to the document's folder; null where it was made in memory.
        robot_file: the nominal robot where another than the log's was given, likewise.
        episodes: of a data set: each episode, worst first; left out of a log's.
    """

    SCHEMA = "excite.doctor/1"

    robot: Name
    findings: tuple[Finding, ...]
    repaired: FilePath | None = None
    log_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
    robot_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
    episodes: tuple[EpisodeFindings, ...] | None = field(default=None, metadata=LEFT_OUT)

    tables: ClassVar[Sequence[str]] = ("findings",)

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: one finding a row, worst first."""
        return [
            {
                "kind": f.kind,
                "severity": f.severity,
                "where": f.where,
                "found": f.text,
                "remedy": f.remedy,
                "repaired": f.repaired,
                "sure": f.sure,
            }
            for f in self.findings
        ]

    @property
    @stated
    def healthy(self) -> bool:
        """Whether nothing was found that spoils results."""
        return all(finding.severity in {"note", "limits"} for finding in self.findings)

    def summary(self) -> str:
        """One finding a paragraph, worst first: what, and what was done or is to be done."""
        lines = []
        for finding in self.findings:
            state = "repaired" if finding.repaired else finding.severity
            sure = "" if finding.sure == 1.0 else f", {int(100 * finding.sure)} % sure"
            lines += [f"{finding.kind} ({state}{sure}): {self.sentence(finding)}", f"    {finding.remedy}"]
        return "\n".join(lines) or "nothing wrong was found"

    def sentence(self, finding: Finding) -> str:
        """What was found, in a sentence."""
        return finding.text


def worst_first(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """What spoils most and is not mended first; the order within a class is kept."""
    return tuple(sorted(findings, key=lambda item: (item.repaired, _WORST_FIRST.index(item.severity))))


def merge_findings(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Findings with those of one kind that ask for the same made one, at all their places, in the first one's place.

    Figures that differ are told by the places that they are of, ``NAME.PLACE``; what is said is as sure as the least.
    """
    groups: dict[tuple[str, str, bool, str], list[Finding]] = {}
    for item in findings:
        groups.setdefault((item.kind, item.severity, item.repaired, item.remedy), []).append(item)
    return tuple(group[0] if len(group) == 1 else _merge_group(group) for group in groups.values())


def _merge_group(group: list[Finding]) -> Finding:
    """One finding of several of a kind."""
    names = dict.fromkeys(name for item in group for name in item.figures)
    common = {
        name: group[0].figures[name]
        for name in names
        if all(item.figures.get(name) == group[0].figures.get(name) for item in group)
    }
    own = {
        ".".join((name, *item.places)): value
        for item in group
        for name, value in item.figures.items()
        if name not in common
    }
    texts = tuple(dict.fromkeys(item.text for item in group))
    # A finding that names no trial is of all of them.
    trials = () if any(not item.trials for item in group) else _join_unique(item.trials for item in group)
    return replace(
        group[0],
        text="; ".join(texts),
        figures=common | own,
        places=_join_unique(item.places for item in group),
        sure=min(item.sure for item in group),
        trials=trials,
    )


def _join_unique(parts: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for part in parts for name in part))


def list_names(names: tuple[str, ...] | list[str], most: int = 5) -> str:
    """Names in a sentence, the rest counted."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"


def first_names(names: Sequence[str], most: int = 6, *, by: str = ", ") -> str:
    """The first names of a list in a sentence, where how many more there are does not matter."""
    return by.join([*names[:most], *(["…"] if len(names) > most else [])])
