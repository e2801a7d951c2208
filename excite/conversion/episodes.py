"""A data set of many episodes looked through: each beside the others, without a model, worst first."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from excite.arrays import Array
from excite.conversion.columns.families import TARGETS
from excite.conversion.columns.words import read_clue
from excite.conversion.recording import Column, Recording
from excite.conversion.recordings import nested_folders, read_recordings, source_files
from excite.conversion.sources.arrays import recordings_of_episodes
from excite.data_tables import read_rows
from excite.display import Row, count
from excite.errors import InputError, LogError
from excite.finding import EpisodeFindings, Examination, Finding, Severity, list_names, worst_first
from excite.formats.lerobot import is_data_set, read_data_set
from excite.formats.tables import csv_text
from excite.parallel.engine import in_order
from excite.parallel.jobs import Jobs
from excite.progress import Progress, silent

MEASURES = ("travel", "asked", "leap", "jump", "gap_s", "follows", "lag_s", "gain", "zero", "friction")
# What differs from the other episodes by so many of their deviations (by the median), and by more than a share of the
# joint's travel or of a gain, or by so many rows.
_DEVIATIONS, _SHARE, _ROWS = 8.0, 0.05, 2.0
# A command explains a joint's velocity where they correlate by more. Commands lead or follow by no more [s]; over a
# tenth of that, velocities stand clear of the encoder's noise.
_FOLLOWS, _LAG_S = 0.6, 1.0
# Of periodic motion half a period is a turned sign: the longest of these lags counts less by this share.
_FAR = 0.2
_STEPS = 3
# Of fewer episodes none is usual.
_FEWEST = 5
# A joint that moves by less of what it does in the other episodes stands.
_STANDS = 0.02


@dataclass(frozen=True, eq=False)
class Episode:
    """What was measured of an episode.

    Attributes:
        name: its name.
        seconds: its length.
        step_s: median time between rows.
        joints: names, as the file has them.
        measures: by name of ``MEASURES``, ``(n_joints,)``, NaN where it cannot be told: travel, commanded travel,
            largest step between rows, and largest beyond those around it, longest time between rows that have a number
            [s], correlation of velocity and commanded velocity, how late it follows [s], slope and constant of the
            position by the command, and dry friction. In the file's own units.
        findings: what differs from the others, worst first.
    """

    name: str
    seconds: float = np.nan
    step_s: float = np.nan
    joints: tuple[str, ...] = ()
    measures: Any = None
    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> str:
        """Kinds of what was found, worst first; ``ok`` for nothing."""
        return ", ".join(dict.fromkeys(found.kind for found in self.findings)) or "ok"

    @property
    def badness(self) -> float:
        """By which episodes are sorted."""
        weights = {"fatal": 1e6, "spoils": 1e3}
        return sum(weights.get(found.severity, 1.0) * len(found.places or ("",)) for found in self.findings)

    @property
    def entry(self) -> EpisodeFindings:
        """Its entry under ``episodes``."""
        told = self.measures or {}
        return EpisodeFindings(
            self.name,
            self.verdict,
            self.findings,
            self.seconds,
            self.step_s,
            float(np.max(told.get("gap_s", np.nan))),
            {name: dict(zip(self.joints, map(float, values), strict=True)) for name, values in told.items()},
        )


@dataclass(frozen=True, eq=False, repr=False)
class EpisodeChart(Examination):
    """What was found in a data set."""

    tables = ("findings", "episodes")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: an episode, or a finding, a row."""
        if table == "findings":
            return super().rows(table)
        return [
            {
                "episode": one.episode,
                "verdict": one.verdict,
                "where": list_names(tuple(dict.fromkeys(p for f in one.findings for p in f.places))),
                "seconds": round(one.seconds, 2),
                "gap_s": round(one.gap_s, 3),
            }
            for one in self.episodes or ()
        ]

    def to_csv(self) -> str:
        """The episodes as a table to be sorted, a measure of a joint a column."""
        rows = [
            dict(row)
            | {f"{name}.{joint}": value for name, of in one.measures.items() for joint, value in of.items()}
            for row, one in zip(self.rows("episodes"), self.episodes or (), strict=True)
        ]
        names = list(dict.fromkeys(name for row in rows for name in row))
        return csv_text(names, [[row.get(name) for name in names] for row in rows])

    def summary(self) -> str:
        """A line for each episode in which something was found, how many are well, and what changes over all."""
        bad = [one for one in self.episodes or () if one.findings]
        width = max((len(one.episode) for one in bad), default=0)
        lines = [f"{one.episode:{width}}  {'; '.join(found.text for found in one.findings)}" for one in bad]
        lines.append(f"{count(len(self.episodes or ()), 'episode')}, {len(bad)} with something wrong")
        if len(self.episodes or ()) < _FEWEST:
            lines.append(f"too few to tell which one differs: record {_FEWEST} or more of one task")
        return "\n".join([*lines, *(found.text for found in self.findings if not found.trials)])


def is_of_episodes(path: Path) -> bool:
    """Whether a folder holds episodes rather than a log: a LeRobot data set, or several recordings."""
    is_log = (path / "log.yaml").is_file()
    return path.is_dir() and not is_log and (is_data_set(path) or len(_tasks(path)) > 0)


def examine_episodes(path: Path, *, jobs: Jobs = 1, progress: Progress = silent) -> EpisodeChart:
    """Look a data set through: each episode for rows, and its joints beside those of the other episodes.

    No model is asked and no unit needed. What all episodes have in common is not seen, and neither is what only
    commands or torques tell where none were recorded.

    Args:
        path: a LeRobot data set, or a folder of recordings (bags, tables, …), one or more episodes in each.
        jobs: number of processes.
        progress: told after each file.

    Returns:
        The episodes, worst first.

    Raises:
        LogError: nothing there holds positions of joints.
    """
    measured = in_order(
        _measure_file, _tasks(path), jobs=jobs, stage="look episodes through", progress=progress
    )
    episodes = [one for several in measured for one in several]
    joints = max((one.joints for one in episodes), key=len, default=())
    if not joints:
        text = (
            "; ".join(dict.fromkeys(f.text for one in episodes for f in one.findings))
            or "holds no recordings"
        )
        raise LogError(
            text, source=path, remedy="name columns q.JOINT, q_cmd.JOINT, tau.JOINT, or convert it"
        )
    same = [one for one in episodes if one.joints == joints]
    table = {name: np.array([one.measures[name] for one in same]) for name in MEASURES}
    judged = iter(_judge(same, table))
    done = [next(judged) if one.joints == joints else _without_joints(one, joints) for one in episodes]
    done.sort(key=lambda one: -one.badness)
    findings = tuple(replace(found, trials=(one.name,)) for one in done for found in one.findings)
    return EpisodeChart(
        path.name, worst_first((*_drifts(same, table), *findings)), episodes=tuple(one.entry for one in done)
    )


def _tasks(path: Path) -> list[Path]:
    if is_data_set(path):
        return list(read_data_set(path).files)
    return source_files(path) or [folder for folder, _ in nested_folders(path, 2)]


def _measure_file(_: None, path: Path) -> list[Episode]:
    try:
        root = next((folder for folder in path.parents if is_data_set(folder)), None)
        recordings: Iterator[Recording] | list[Recording]
        if root is not None and path.suffix == ".parquet":
            recordings = recordings_of_episodes(replace(read_data_set(root), files=(path,)))
        else:
            recordings = read_recordings([path])
        return [_measure(one, path.stem) for one in recordings]
    except InputError as error:
        return [Episode(path.stem, findings=(Finding("unreadable", error.what, severity="fatal"),))]


def _measure(recording: Recording, stem: str) -> Episode:
    name = recording.name or stem
    found: dict[tuple[str, str], tuple[Array, Array]] = {}
    for stream in recording.streams:
        named = [(column.values, *_meaning(column)) for column in stream.columns]
        stamps = [values for values, what, _ in named if what == "time"]
        rate = float(recording.said.get("fps") or 0.0)
        clocks = [stream.time, *stamps, np.arange(stream.n_rows) / rate if rate else None]
        clock = next((one for one in clocks if one is not None), np.zeros(0))
        for values, what, joint in named if len(clock) >= 8 else ():
            # A row without a number is a row that is missing.
            if np.count_nonzero(there := np.isfinite(values)) >= 8:
                found.setdefault((what, joint), (clock[there], values[there]))
    joints = tuple(joint for what, joint in found if what == "q")
    if not joints:
        text = "no column is the position of a joint, beside a time"
        return Episode(name, findings=(Finding("unreadable", text, severity="fatal"),))
    time = max((found["q", joint][0] for joint in joints), key=len)
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step) if step > 0.0 else time

    def at_even(what: str) -> Array:
        nothing = (even, np.full(len(even), np.nan))
        return np.column_stack([np.interp(even, *found.get((what, joint), nothing)) for joint in joints])

    q, command, torque = at_even("q"), at_even("q_cmd"), at_even("tau")
    gap = np.array([np.diff(found["q", joint][0]).max() for joint in joints])
    leap, jump = np.array([_measure_leaps(found["q", joint][1]) for joint in joints]).T
    tracked = np.array([_track(even, *pair, step) for pair in zip(q.T, command.T, strict=True)]).T
    friction = np.array([_friction(*pair, step) for pair in zip(q.T, torque.T, strict=True)])
    travel, asked = (np.ptp(x, axis=0) for x in (q, command))
    measures = dict(zip(MEASURES, (travel, asked, leap, jump, gap, *tracked, friction), strict=True))
    return Episode(name, float(time[-1] - time[0]), step, joints, measures)


def _measure_leaps(q: Array) -> tuple[float, float]:
    """The largest step between two rows, and beyond those two rows before and after it, which fast motion has too."""
    steps = np.abs(np.diff(q))
    return float(steps.max()), float(np.max(steps[2:-2] - np.maximum(steps[:-4], steps[4:])))


def _meaning(column: Column) -> tuple[str, str]:
    """Channel and joint of a column, by its format or else by its name, which a log folder's says whole."""
    channel, _, joint = column.name.partition(".")
    if column.channel or (joint and channel in TARGETS.values()):
        return (column.channel, column.label) if column.channel else (channel, joint)
    clue = read_clue(column.name, ())
    joint = "_".join([clue.label] * bool(clue.label) + [str(number) for number in clue.numbers])
    return f"{clue.quantity}_cmd" if clue.commanded else clue.quantity, joint or column.name


def _track(time: Array, q: Array, command: Array, step: float) -> tuple[float, ...]:
    """How a joint follows its command: correlation of the velocities (negative where it is turned), lag, gain, zero.

    Gauss and Newton's steps from the lag of the largest correlation: ``q(t) = g c(t − d) + z`` has the derivative
    ``−g c'(t − d)`` in d.
    """
    n, most = len(q), min(round(_LAG_S / step), len(q) - 2)
    rows = min(max(round(0.1 * _LAG_S / step), 1), n // 2)
    speed, asked = (x - x.mean() for x in (q[rows:] - q[:-rows], command[rows:] - command[:-rows]))
    size = float(np.linalg.norm(speed) * np.linalg.norm(asked)) or np.nan
    lags = np.arange(-most, most + 1)
    shape = np.fft.irfft(np.fft.rfft(speed, 2 * n) * np.conj(np.fft.rfft(asked, 2 * n)), 2 * n)[lags] / size
    best = int(np.argmax(np.abs(np.nan_to_num(shape)) * (1.0 - _FAR * np.abs(lags) / most)))
    if not abs(shape[best]) > _FOLLOWS:
        return float(shape[best]), np.nan, np.nan, np.nan
    late, inner = step * float(lags[best]), slice(n // 20, -n // 20)
    gain = zero = np.nan
    for _ in range(_STEPS):
        asked = np.interp(time - late, time, command)
        columns = np.column_stack([asked, np.gradient(asked, time), np.ones(n)])[inner]
        gain, moved, _ = np.linalg.lstsq(columns, q[inner], rcond=None)[0]
        zero = float(np.median(q[inner] - asked[inner]))
        late = float(np.clip(late - moved / gain, -_LAG_S, _LAG_S)) if gain else late
    return float(shape[best]), late, float(gain), zero


def _friction(q: Array, torque: Array, step: float) -> float:
    """Dry friction of a joint, beside a weight, a constant and what grows with the velocity."""
    if not np.isfinite(torque).all():
        return np.nan
    angle = np.radians(q) if np.abs(q).max() > 4.0 * np.pi else q
    v = np.gradient(q, step)
    slips = np.abs(v) > 0.2 * np.std(v)
    columns = np.column_stack([np.sign(v), v, np.sin(angle), np.cos(angle), np.ones(len(v))])
    return float(np.linalg.lstsq(columns[slips], torque[slips], rcond=None)[0][0])


def _without_joints(one: Episode, joints: tuple[str, ...]) -> Episode:
    """An episode that has other joints than most, or none."""
    if one.findings:
        return one
    lost = tuple(sorted(set(joints) ^ set(one.joints)))
    finding = Finding("channels", f"other joints: {list_names(lost)}", places=lost, severity="fatal")
    return replace(one, findings=(finding,))


def _judge(episodes: list[Episode], table: dict[str, Array]) -> Iterator[Episode]:
    """Each episode with what sets it apart from the others of the same joints."""
    # Joints that follow the other way in all episodes are called so; where half are turned neither way is usual.
    way = np.where(_median(table["follows"]) < 0.0, -1.0, 1.0)
    table = table | {"follows": np.abs(table["follows"])}
    middle = {name: _median(values) for name, values in table.items()}
    spread = {name: 1.4826 * _median(np.abs(values - middle[name])) for name, values in table.items()}
    travel, step = middle["travel"], float(np.median([one.step_s for one in episodes]))
    told = middle["follows"] > _FOLLOWS
    # The least difference that counts.
    floors = {
        "follows": np.zeros(len(travel)),
        "lag_s": _ROWS * step,
        "zero": _SHARE * travel,
        "gain": 2.0 * _SHARE,
        "friction": 0.5 * np.abs(middle["friction"]),
    }
    for k, one in enumerate(episodes):
        now = {name: values[k] for name, values in table.items()}
        away = {name: np.abs(now[name] - middle[name]) for name in floors}
        differs = {n: (away[n] > floor) & (away[n] > _DEVIATIONS * spread[n]) for n, floor in floors.items()}
        stands, idle = (now[name] < _STANDS * middle[name] for name in ("travel", "asked"))
        # A task may leave a joint alone, but not all of them. One that follows in small is scaled.
        idle &= ~idle.all()
        stands &= ~idle & ~(now["follows"] > _FOLLOWS)
        turned = told & (way * one.measures["follows"] < -_FOLLOWS) & ~differs["lag_s"]
        moves = ~stands & ~turned & ~idle
        follows = moves & told
        against = now["friction"] * middle["friction"] < 0.0
        missing = now["gap_s"] > max(3.5 * one.step_s, 0.1)
        leaps = (now["jump"] > 5.0 * middle["leap"]) & (now["jump"] > _SHARE * travel)
        bad = {
            "constant": stands,
            "command_sign": turned,
            "unfollowed": follows & differs["follows"] & (np.abs(now["follows"]) < _FOLLOWS),
            "late": follows & differs["lag_s"],
            "zero_position": follows & differs["zero"] & ~differs["gain"],
            "gain": follows & differs["gain"],
            "torque_sign": moves & differs["friction"] & against & (middle["friction"] > 0.0),
            "friction": moves & differs["friction"] & ~against,
            "missing_rows": missing,
            "steps": leaps & ~missing,
        }
        findings = []
        for row in read_rows(__file__, "episodes.csv"):
            which, name = bad[row["kind"]], row["measure"]
            pairs = zip(
                one.measures[name][which],
                (way * middle[name] if name == "follows" else middle[name])[which],
                strict=True,
            )
            figures = ", ".join(
                f"{is_now:.4g} for {usual:.4g}" for is_now, usual in itertools.islice(pairs, 3)
            )
            if places := tuple(np.array(one.joints)[which].tolist()):
                text = f"{list_names(places)} {row['text']} ({figures})"
                severity = cast(Severity, row["severity"])
                findings.append(Finding(row["kind"], text, places=places, severity=severity))
        yield replace(one, findings=worst_first(tuple(findings)))


def _median(values: Array) -> Array:
    """Of the episodes that tell it, ``(n_joints,)``; NaN where none does."""
    return np.array([np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else np.nan for c in values.T])


def _drifts(episodes: list[Episode], table: dict[str, Array]) -> list[Finding]:
    """What goes on changing from the first episode to the last, or leaps, by more than ten of its deviations."""
    found, travel = [], _median(table["travel"])
    for name, (j, joint) in itertools.product(("zero", "gain", "friction"), enumerate(episodes[0].joints)):
        k = np.flatnonzero(np.isfinite(table[name][:, j]))
        values, half = table[name][k, j], len(k) // 2
        if len(k) < 2 * _FEWEST:
            continue
        # The median of slopes over half of the episodes (Theil 1950, of pairs that are far apart).
        slope = float(np.median((values[half:] - values[: len(k) - half]) / (k[half:] - k[: len(k) - half])))
        places = range(_FEWEST, len(k) - _FEWEST + 1)
        pairs = [np.repeat([*map(np.median, np.split(values, [m]))], [m, len(k) - m]) for m in places]
        levels = min(pairs, key=lambda pair: float(np.abs(values - pair).sum()))
        slides, steps, step = values - slope * k, values - levels, float(levels[-1] - levels[0])
        leap = bool(np.abs(steps).sum() < np.abs(slides - np.median(slides)).sum())
        # Episodes of two kinds in turn lie on both levels.
        leap &= bool(np.quantile(np.abs(steps), 0.75) < 0.25 * abs(step))
        rest, change = (steps, step) if leap else (slides, slope * float(k[-1] - k[0]))
        noise = 1.4826 * float(np.median(np.abs(rest - np.median(rest)))) * np.sqrt(12.0 / len(k))
        least = 0.02 * travel[j] if name == "zero" else 0.1 * abs(float(np.median(values)))
        if abs(change) > max(10.0 * noise, least):
            at = episodes[k[np.argmax(levels == levels[-1])]].name
            how = f"leaps by {change:.3g} at {at}" if leap else f"drifts by {change:.3g}"
            text = f"{name} of {joint} {how} over {len(k)} episodes"
            severity: Severity = "spoils" if leap else "limits"
            found.append(Finding("drift", text, {name: change}, (joint,), severity=severity))
    return found
