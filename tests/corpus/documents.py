"""Edited, cut, exchanged and made-up JSON documents and arrays, as the commands that read them again find them."""

from __future__ import annotations

import io
import json
import os
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from excite.campaign.journal import CampaignSettings
from excite.robot.catalogue import data_folder
from excite.robot.loading import load_robot
from tests.corpus.case import Case
from tests.documents.small import JOURNAL, PLAN, SMALL

_DELETE = object()
_RESUME = [
    "campaign",
    "ur10",
    "--candidates",
    "4",
    "--max-iterations",
    "1",
    "--resume",
    "--jobs",
    "1",
    "--out",
]


def changed(document: dict[str, Any], place: str, value: Any) -> dict[str, Any]:
    """A copy in which one field, named like ``selected.0.motion``, is another, or is gone."""
    # Through text, so that no block stands in two places.
    found = json.loads(json.dumps(document))
    *path, last = (int(part) if part.isdigit() else part for part in place.split("."))
    parent: Any = found
    for key in path:
        parent = parent[key]
    if value is _DELETE:
        del parent[last]
    else:
        parent[last] = value
    return found


def _write(path: Path, document: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(document), encoding="utf-8")


def _field(name: str, place: str, value: Any, line: str) -> Case:
    """A report on a folder whose one document has one field changed."""

    def build(folder: Path) -> list[str]:
        _write(folder / f"{name}.json", changed(SMALL[name], place, value))
        return ["report", str(folder)]

    what = "gone" if value is _DELETE else str(value)[:20]
    return Case(f"document {name}", f"{place} {what}", build, rf"{name}\.json: {place}[^:]*: {line}")


def _text(name: str, text: str | bytes, line: str) -> Case:
    """A report on a folder whose plan holds these bytes."""

    def build(folder: Path) -> list[str]:
        (folder / "plan.json").write_bytes(text if isinstance(text, bytes) else text.encode())
        return ["report", str(folder)]

    return Case("document text", name, build, rf"plan\.json: {line}")


def _place(name: str, make: Callable[[Path], object], line: str) -> Case:
    """A report on a folder in which something else lies where a document should."""

    def build(folder: Path) -> list[str]:
        make(folder)
        return ["report", str(folder)]

    return Case("document place", name, build, line)


_OTHER_CHANNELS = {**SMALL["diagnosis"]["simulation"], "after": {"wrist_joint": 0.1}}
_DEEP: list = []
for _ in range(300):
    _DEEP = [_DEEP]

_FIELDS = (
    _field("plan", "robot", _DELETE, "is missing"),
    _field("plan", "candidates", [], "is .*, not an object"),
    _field("plan", "candidates.rejected.zmp", "many", "is 'many', not a whole number"),
    _field("plan", "candidates.generated", -1, "should be greater than or equal to 0"),
    _field("plan", "candidates.accepted", 2.5, "is 2.5, not a whole number"),
    _field("plan", "selected.0.motion", "/etc/passwd", "path should stay inside the folder"),
    _field("plan", "selected.1.motion", "../../elsewhere.parquet", "path should stay inside the folder"),
    _field("plan", "selected.0.motion", "motions/\x00.parquet", "is .*, not text that can be shown"),
    _field("plan", "selected.0.duration_s", 1e300, "should be less than or equal to"),
    _field("plan", "selected.0.segments", "forearm", "is 'forearm', not a list"),
    _field("plan", "selected.0.segments.0", "x" * 10_000, "string should have at most 255 characters"),
    _field("plan", "conditioning.full", True, "is True, not a number"),
    _field("plan", "conditioning.segments.1", None, "is null, not an object"),
    _field("plan", "stages.0.seconds", _DELETE, "is missing"),
    _field("check", "motions", {}, "is .*, not a list"),
    _field("check", "motions.0.margins", _DEEP, "is .*, not an object"),
    _field("check", "motions.0.margins.zmp_m", "wide", "is 'wide', not a number"),
    _field("check", "motions.0.safe", "yes", "is 'yes', not true or false"),
    _field("check", "motions.1.violations.0.time_s", [1.0], "is .*, not a number"),
    _field("check", "motions.1.violations", _DELETE, "is missing"),
    _field("identification", "n_samples", None, "is null, not a whole number"),
    _field("identification", "method", ["qp"], "is .*, not text"),
    _field("identification", "base_parameters.0.std", -1.0, "should be greater than or equal to 0"),
    _field("identification", "standard_parameters.hand.inertia", [1.0] * 5, "list should have at least 6"),
    _field("identification", "standard_parameters.hand.nominal.mass", "2 kg", "is '2 kg', not a number"),
    _field("identification", "validation.elbow_joint", 0.3, "is 0.3, not an object"),
    _field("identification", "warnings.0", {"text": 1}, "is .*, not text"),
    _field("identification", "consistency.mass_positive", 1, "is 1, not true or false"),
    _field("campaign", "iterations.0.rsd_percent", [], "is .*, not an object"),
    _field("campaign", "iterations.1.not_met", None, "is null, not a list"),
    _field("campaign", "identification.schema", "excite.check/1", "should be 'excite.identification/1'"),
    _field("campaign", "identification.fit.elbow_joint.rmse", "x", "is 'x', not a number"),
    _field("campaign", "targets_met", _DELETE, "is missing"),
    _field("diagnosis", "verdict", "perhaps", "should be 'effect', 'none', 'ambiguous' or 'unknown'"),
    _field("diagnosis", "gap.per_channel.elbow_joint.noise_floor", "?", "is '\\?', not a number"),
    _field("diagnosis", "simulation", _OTHER_CHANNELS, "after should have the channel 'elbow_joint'"),
    _field("diagnosis", "where.0.band_hz", [1.0], "list should have at least 2 items"),
    _field("diagnosis", "candidates.0.parameters.width.unit", _DELETE, "is missing"),
    _field("diagnosis", "effects.0.effect", "\ud800", "is .*, not text that UTF-8 can hold"),
    _field("diagnosis", "next_experiment", "later", "is 'later', not an object"),
)
_CUT = json.dumps(PLAN)
_TEXTS = (
    _text("empty", "", "is no JSON"),
    _text("cut", _CUT[: len(_CUT) // 2], "is no JSON"),
    _text("list", "[]", "is no JSON object"),
    _text("another schema", '{"schema": "excite.plan/2"}', "schema: schema is 'excite.plan/2', not"),
    _text("no schema", "{}", "schema: schema is None, not"),
    _text("nested", "[" * 100_000, "is nested too deep"),
    _text(
        "twice", '{"schema": "excite.plan/1", "robot": "a", "robot": "b"}', "is no JSON .'robot' stands twice"
    ),
    _text("NaN", '{"schema": "excite.plan/1", "robot": NaN}', "is no JSON .NaN is no number"),
    _text("long number", '{"schema": ' + "9" * 5000 + "}", "is no JSON"),
    _text("infinite", _CUT.replace("212.0", "1e400"), "conditioning.full: is inf, not a finite number"),
    _text("Latin-1", '{"schema": "ä"}'.encode("latin-1"), "is no UTF-8 text"),
    _text("binary", bytes(range(256)), "is no UTF-8 text"),
)
_PLACES = (
    _place("folder", lambda folder: (folder / "plan.json").mkdir(), r"plan\.json: is a folder"),
    _place("pipe", lambda folder: os.mkfifo(folder / "check.json"), r"check\.json: is a pipe"),
    _place("device", lambda folder: (folder / "campaign.json").symlink_to("/dev/zero"), "is a device"),
    _place("dead link", lambda folder: (folder / "check.json").symlink_to("gone"), "no such file"),
    _place("nothing", lambda folder: (folder / "notes.txt").touch(), "holds none of plan.json"),
    _place("arrays are a folder", lambda folder: (folder / "report_data.npz").mkdir(), "is a folder"),
)


def arrays() -> dict[str, np.ndarray]:
    """What a report's arrays are, small."""
    ones = np.ones((4, 2))
    return {
        "forces/trial": np.array("one"),
        "forces/channels": np.array(["elbow_joint", "wrist_joint"]),
        "forces/units": np.array(["N·m", "N·m"]),
        "forces/time": np.arange(4.0),
        "forces/measured": ones,
        "forces/nominal": ones,
        "forces/identified": ones,
        "masses/names": np.array(["hand"]),
        "masses/nominal": np.ones(1),
        "masses/identified": np.ones(1),
        "masses/changed": np.array([False]),
    }


def _array(what: str, name: str, value: np.ndarray, line: str) -> Case:
    def build(folder: Path) -> list[str]:
        np.savez(folder / "report_data.npz", **{**arrays(), name: value}, allow_pickle=True)
        return ["report", str(folder)]

    return Case("arrays", what, build, rf"report_data\.npz: {name}: {line}")


def _member(what: str, content: bytes, line: str) -> Case:
    """An archive whose one member is made of these bytes."""

    def build(folder: Path) -> list[str]:
        with zipfile.ZipFile(folder / "report_data.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("masses/nominal.npy", content)
        return ["report", str(folder)]

    return Case("archive", what, build, rf"report_data\.npz: {line}")


def _npy(header: str, content: bytes = b"") -> bytes:
    stream = io.BytesIO()
    padded = header.encode() + b"\n"
    stream.write(b"\x93NUMPY\x01\x00" + len(padded).to_bytes(2, "little") + padded + content)
    return stream.getvalue()


def _whole(what: str, content: bytes, line: str) -> Case:
    def build(folder: Path) -> list[str]:
        (folder / "report_data.npz").write_bytes(content)
        return ["report", str(folder)]

    return Case("archive", what, build, rf"report_data\.npz: {line}")


_ARRAYS = (
    _whole("without arrays", b"PK\5\6" + bytes(18), "holds no arrays"),
    _array("NaN", "forces/measured", np.full((4, 2), np.nan), "holds NaN or infinity"),
    _array("infinite", "masses/nominal", np.array([np.inf]), "holds NaN or infinity"),
    _array("huge", "forces/nominal", np.full((4, 2), 1e200), "holds numbers above 1e.100"),
    _array("shape", "forces/identified", np.ones((4, 3)), r"has shape \(4, 3\), not \(4, 2\)"),
    _array("units", "forces/units", np.array(["N"]), r"has shape \(1,\), not \(2,\)"),
    _array("text for numbers", "forces/time", np.array(["a"] * 4), "is 1-dimensional <U1, not numbers"),
    _array("numbers for text", "forces/channels", np.ones(2), "is 1-dimensional float64, not texts"),
    _array("list for text", "forces/trial", np.array(["one"]), "is 1-dimensional <U3, not a text"),
    _array("complex", "masses/identified", np.ones(1, complex), "holds complex128, not numbers"),
    _array("objects", "masses/nominal", np.array([{}], dtype=object), "holds object, not numbers"),
    _array("control characters", "masses/names", np.array(["\x1b[31m"]), "holds characters that cannot be"),
    _array("no names", "masses/names", np.array([], dtype="<U1"), "has 0 names, not 1 to"),
    _array("unknown", "masses/colour", np.ones(1), "is no array that belongs here"),
    _whole("empty file", b"", "cannot be read"),
    _whole("text", b"time,q\n", "cannot be read"),
    _member("no array", b"hello", "masses/nominal: cannot be read"),
    _member(
        "huge shape",
        _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (999999999999,)}"),
        r"masses/nominal: declares the shape \(999999999999,\), and holds 0 bytes",
    ),
    _member(
        "negative shape",
        _npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}", b"\0" * 8),
        "masses/nominal: declares the shape",
    ),
    _member("nested header", _npy("(" * 3000), "masses/nominal: cannot be read"),
    _member("bomb", b"\0" * (257 * 1024 * 1024), "masses/nominal: declares .* bytes, more than"),
)


def _resumed(folder: Path, **settings: Any) -> Path:
    """The beginnings of a campaign of the UR10 that has planned one motion."""
    _write(
        folder / "journal.json",
        {
            **JOURNAL,
            "robot_hash": load_robot("ur10").hash,
            "settings": {**CampaignSettings(n_candidates=4, max_iterations=1).to_json(), **settings},
        },
    )
    motion = next((data_folder("motion_library") / "ur10").rglob("*.parquet"))
    plan = folder / "iteration_1"
    (plan / "motions").mkdir(parents=True)
    shutil.copy(motion, plan / "motions" / "i1_one.parquet")
    entry = {"motion": "motions/i1_one.parquet", "segments": [], "duration_s": 10.0}
    _write(plan / "plan.json", {**PLAN, "robot": "ur10", "selected": [entry]})
    return plan


def _resume(what: str, spoil: Callable[[Path], object], line: str, *options: str) -> Case:
    """A campaign that is resumed after something in its folder was changed."""

    def build(folder: Path) -> list[str]:
        _resumed(folder)
        spoil(folder)
        return [*_RESUME, str(folder), *options]

    return Case("campaign folder", what, build, line)


def _planned(place: str, value: Any, line: str) -> Case:
    def spoil(folder: Path) -> None:
        path = folder / "iteration_1" / "plan.json"
        _write(path, changed(json.loads(path.read_text()), place, value))

    return _resume(f"plan {place} {str(value)[:20]}", spoil, rf"iteration_1/plan\.json: {line}")


def _journal(place: str, value: Any, line: str, *options: str) -> Case:
    def spoil(folder: Path) -> None:
        path = folder / "journal.json"
        _write(path, changed(json.loads(path.read_text()), place, value))

    return _resume(f"journal {place} {str(value)[:20]}", spoil, rf"journal\.json: {line}", *options)


def _exchanged(path: str, make: Callable[[Path], object]) -> Callable[[Path], None]:
    """Puts something else where a file or a folder was."""

    def spoil(folder: Path) -> None:
        target = folder / path
        if target.is_dir():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)
        make(target)

    return spoil


_ONE = {"motion": "motions/i1_one.parquet", "segments": [], "duration_s": 10.0}
_CAMPAIGNS = (
    _journal("robot_hash", "f" * 64, "robot_hash: the campaign there was started with"),
    _journal("robot_hash", 7, "robot_hash: is 7, not text"),
    _journal("settings", None, "settings: is null, not an object"),
    _journal(
        "settings.seed", 4, "settings: the campaign there was started with seed 4, not 0", "--seed", "0"
    ),
    _journal("settings.seed", -4, "settings.seed: should be greater than or equal to 0, got -4"),
    _journal("settings.method", "guess", "settings: unknown method 'guess'"),
    _journal("settings.target_rsd", "low", "settings.target_rsd: is 'low', not a number"),
    _journal("schema", "excite.plan/1", "schema: schema is 'excite.plan/1'"),
    _planned("selected", [], "selected: names no motion"),
    _planned("selected.0.motion", "/etc/passwd", "selected.0.motion: path should stay inside"),
    _planned("selected.0.motion", "../i1_one.parquet", "selected.0.motion: path should stay inside"),
    _planned("selected.0.motion", "motions/i2_one.parquet", "selected: .* was not planned in iteration 1"),
    _planned("selected", [_ONE, _ONE], "selected: 'motions/i1_one.parquet' stands twice"),
    _planned("validation", ["motions/i1_one.parquet"], "selected: .* stands twice"),
    _planned("candidates.accepted", _DELETE, "candidates.accepted: is missing"),
    _planned("stages.0.seconds", None, "stages.0.seconds: is null, not a number"),
    _resume("no journal", _exchanged("journal.json", lambda path: None), "no campaign to resume"),
    _resume("journal is a folder", _exchanged("journal.json", Path.mkdir), r"journal\.json: is a folder"),
    _resume("journal is a pipe", _exchanged("journal.json", os.mkfifo), r"journal\.json: is a pipe"),
    _resume("plan is a folder", _exchanged("iteration_1/plan.json", Path.mkdir), r"plan\.json: is a folder"),
    _resume("iteration is a file", _exchanged("iteration_1", Path.touch), "iteration_1: is a file"),
    _resume("log is a file", lambda folder: (folder / "iteration_1" / "log").touch(), "log: is a file"),
    _resume(
        "iteration missing",
        lambda folder: (folder / "iteration_1").rename(folder / "iteration_2"),
        r"iteration_1/plan\.json: is missing, while iteration_2 is there",
    ),
    _resume(
        "motion gone",
        lambda folder: (folder / "iteration_1" / "motions" / "i1_one.parquet").unlink(),
        r"i1_one\.parquet: ",
    ),
)


CASES: tuple[Case, ...] = (*_FIELDS, *_TEXTS, *_PLACES, *_ARRAYS, *_CAMPAIGNS)
