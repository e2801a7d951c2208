"""What a diagnosis says of a planted effect, beside what it says of the same log without it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from benchmarks.planted.machines import Machine, Recording
from benchmarks.planted.planting import TERM, TERMS, Bench, Effect, Sight

# The parameter that says how large an effect is; a tilt is said by its angle.
_MAIN = {
    "torque_gain": "gain_error",
    "torque_bias": "bias",
    "coulomb_friction": "level",
    "viscous_friction": "coefficient",
    "time_delay": "delay",
    "base_tilt": "angle",
    "encoder_offset": "offset",
    "joint_spring": "stiffness",
    "payload": "mass",
    "position_gain": "gain_error",
    "torque_crosstalk": "from_previous",
    "coupled_drive": "coulomb",
}
_SAME = {"link_inertia": "payload"}
# Normal deviate of a two-sided interval of 90 %.
_Z90 = 1.645


@dataclass(frozen=True)
class Row:
    """One planted effect.

    Attributes:
        machine, half, effect, place, size: what was planted where.
        visible: whether least squares by hand see it on rows held out.
        named, placed: whether an effect of that name is said, and at that place or one tied to it.
        said: size that is said, NaN for none.
        inside: whether the 90 % interval of the size holds it; None where no interval is said.
        share, share_said: of the gap of the joint where it shows, by hand and as said.
        share_inside: whether the 90 % interval of the share holds it.
        extras: effects besides that the log without the plant has not.
        firm_wrong: the verdict is one wrong effect that the log without the plant has not.
        seconds: wall clock.
    """

    machine: str
    half: str
    effect: str
    place: str
    size: float
    visible: bool
    named: bool
    placed: bool
    said: float
    inside: bool | None
    share: float
    share_said: float
    share_inside: bool | None
    extras: tuple[str, ...]
    firm_wrong: bool
    seconds: float


def save_log(folder: Path, machine: Machine, runs: Sequence[Recording], modelled: Sequence[str]) -> Path:
    """Write recordings as a log whose bodies are right; two thirds of each teach in two trials, the last judges."""
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(machine.urdf(machine.source))
    trials = []
    for k, run in enumerate(runs):
        n = len(run.q)
        for part, role in enumerate(("identification", "identification", "validation")):
            rows = slice(part * n // 3, (part + 1) * n // 3)
            time = np.arange(rows.stop - rows.start) / machine.rate_hz
            columns = {"time": time}
            columns |= {f"q.{name}": run.q[rows, j] for j, name in enumerate(machine.joints)}
            columns |= {f"tau.{name}": run.tau[rows, j] for j, name in enumerate(machine.joints)}
            file = f"trial_{k}{part}.parquet"
            pq.write_table(pa.table(columns), folder / file)
            trials.append({"file": file, "role": role})
    header = {
        "schema": "excite.log/1",
        "robot": "robot.urdf",
        "base": "fixed",
        "gravity": list(machine.gravity),
        "rate_hz": machine.rate_hz,
        "joints": list(machine.joints),
        "torque": machine.torque,
        "modelled": ["rigid_body_fixed", *modelled],
        "trials": trials,
    }
    (folder / "log.yaml").write_text(yaml.safe_dump(header, sort_keys=False))
    return folder


def diagnosis_of(log: Path) -> dict[str, Any]:
    """The document of ``excite diagnose`` for a log, by the command line that users have."""
    command = [sys.executable, "-m", "excite", "diagnose", str(log), "--json", "--jobs", "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{log}: {done.stderr.strip()[-500:]}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def modelled_beside(effect: str) -> list[str]:
    """Terms of the baseline: all but the one that would hide the effect."""
    return [name for name in TERMS if name != TERM[effect]]


def place_of(bench: Bench, effect: Effect) -> str:
    """The planted place, as diagnoses call it."""
    if effect.name == "time_delay":
        return "torque"
    if effect.name == "base_tilt":
        return "base"
    if effect.name == "payload":
        bodies = [frame for frame in bench.model.frames if frame.parentJoint == bench.model.njoints - 1]
        return next(str(frame.name) for frame in bodies if frame.type.name == "BODY")
    return bench.machine.joints[effect.joint]


def score(
    bench: Bench,
    effect: Effect,
    sight: Sight,
    without: Mapping[str, Any],
    document: Mapping[str, Any],
    seconds: float,
) -> Row:
    """Compare the diagnosis of the planted log with what was planted, beside that of the log without it."""
    place = place_of(bench, effect)
    known = {_key(item) for item in without["effects"]}
    same = [item for item in document["effects"] if _key(item)[0] == effect.name]
    right = [item for item in same if place in {item["location"], *(item["tied_locations"] or ())}]
    # What the machine has of the same kind at the same place adds to what is planted.
    size, said, inside = effect.size, float("nan"), None
    if right:
        found = right[0]["parameters"][_MAIN[effect.name]]
        before = [item for item in without["effects"] if _key(item) == _key(right[0])]
        if before and effect.name not in {"base_tilt"}:
            size += before[0]["parameters"].get(_MAIN[effect.name], {"value": 0.0})["value"]
        said = float(found["value"])
        inside = None if found["std"] is None else bool(abs(said - size) <= _Z90 * found["std"])
    budget = document.get("budget", {}).get(sight.channel, {"effects": []})["effects"]
    stated = [item for item in budget if _key(item)[0] == effect.name and right]
    share = float(stated[0]["share"]) if stated else float("nan")
    interval = stated[0].get("interval90") if stated else None
    first = (_SAME.get(document["effect"], document["effect"]), document["location"])
    wrong = {_key(item) for item in document["effects"] if item not in same} - known
    return Row(
        bench.machine.name,
        bench.machine.half,
        effect.name,
        place,
        effect.size,
        sight.visible,
        bool(same),
        bool(right),
        said,
        inside,
        sight.share,
        share,
        bool(interval[0] <= sight.share <= interval[1]) if interval and None not in interval else None,
        tuple(sorted(f"{name}@{where}" for name, where in wrong)),
        document["verdict"] == "effect" and first in wrong,
        seconds,
    )


def _key(item: Mapping[str, Any]) -> tuple[str, str]:
    return _SAME.get(item["effect"], item["effect"]), str(item["location"])


def figures(rows: Sequence[Row]) -> dict[str, tuple[float, int, str]]:
    """Each figure with how many it is of and the bar it has to meet; NaN of nothing."""
    seen = [row for row in rows if row.visible]
    right = sum(row.named and row.placed for row in seen)
    sizes = [row.inside for row in seen if row.inside is not None]
    shares = [row.share_inside for row in seen if row.share_inside is not None]
    extras = sum(len(row.extras) for row in rows)
    rights = sum(row.placed for row in rows)

    def part(count: float, of: int) -> float:
        return count / of if of else float("nan")

    return {
        "named and placed of the visible": (part(right, len(seen)), len(seen), "≥ .90"),
        "precision": (part(rights, rights + extras), rights + extras, "≥ .90"),
        "firm wrong": (part(sum(row.firm_wrong for row in rows), len(rows)), len(rows), "≤ .01"),
        "size in its 90 % interval": (part(sum(sizes), len(sizes)), len(sizes), ".85–.95"),
        "share in its 90 % interval": (part(sum(shares), len(shares)), len(shares), ".85–.95"),
    }


def is_met(value: float, bar: str) -> bool:
    """Whether a figure meets a bar as :func:`figures` writes it."""
    kind = bar[0]
    numbers = [float(text) for text in bar.strip("≥≤ ").split("–")]
    if kind == "≥":
        return value >= numbers[0]
    return value <= numbers[0] if kind == "≤" else numbers[0] <= value <= numbers[1]


def table(rows: Sequence[Row]) -> str:
    """All rows and, by half of the machines and together, the figures; ✗ where a bar is missed."""
    lines = [
        "| machine | planted | visible | named, placed | size said | in "
        "| share by hand, said | in | besides | firm wrong | s |"
    ]
    lines.append("|" + " --- |" * 11)
    mark = {True: "✓", False: "✗", None: "–"}
    for r in rows:
        lines.append(
            f"| {r.machine} | {r.effect}@{r.place} {r.size:.4g} | {mark[r.visible]} | {mark[r.named]} {mark[r.placed]} "
            f"| {r.said:.4g} | {mark[r.inside]} | {r.share:.2f}, {r.share_said:.2f} | {mark[r.share_inside]} "
            f"| {' '.join(r.extras) or '–'} | {'✗' if r.firm_wrong else '–'} | {r.seconds:.0f} |"
        )
    lines += ["", "| figure | bar | half A | half B | all |", "| --- | --- | --- | --- | --- |"]
    halves = [
        figures([r for r in rows if half in {r.half, ""}]) if half else figures(rows)
        for half in ("A", "B", "")
    ]
    for name, (_, _, bar) in halves[2].items():
        cells = []
        for part in halves:
            value, count, _ = part[name]
            cells.append(f"{value:.2f} of {count}{'' if is_met(value, bar) else ' ✗'}" if count else "–")
        lines.append(f"| {name} | {bar} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
