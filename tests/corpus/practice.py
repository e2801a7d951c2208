"""Small sound inputs, for cases to spoil one thing of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from excite.formats.registry import format_of
from tests.human import c3d_file
from tests.logs.conftest import ARM

ROWS = 200
Columns = dict[str, Any]


def header() -> dict[str, Any]:
    """A ``log.yaml`` of a two-joint arm with two trials."""
    return {
        "schema": "excite.log/1",
        "robot": "robot.urdf",
        "base": "fixed",
        "rate_hz": 100,
        "joints": ["shoulder", "elbow"],
        "torque": "motor_side",
        "trials": [
            {"file": "one.csv", "role": "identification"},
            {"file": "two.csv", "role": "validation"},
        ],
    }


def columns() -> Columns:
    """Columns of a trial."""
    rng = np.random.default_rng(1)
    time = np.arange(ROWS) / 100.0
    found: Columns = {"time": time}
    for k, joint in enumerate(("shoulder", "elbow")):
        found[f"q.{joint}"] = np.sin((1.1 + k) * time)
        found[f"tau.{joint}"] = rng.normal(size=ROWS)
    return found


def write_log(folder: Path, stated: dict[str, Any] | None = None, spoilt: Columns | None = None) -> list[str]:
    """Write a log whose first trial has some columns replaced, or left out where they are None; the arguments."""
    stated = stated or header()
    (folder / "robot.urdf").write_text(ARM)
    (folder / "log.yaml").write_text(yaml.safe_dump(stated, sort_keys=False))
    for k, entry in enumerate(stated["trials"]):
        changed = columns() | (spoilt or {} if k == 0 else {})
        sound = {name: values for name, values in changed.items() if values is not None}
        format_of(Path(entry["file"])).write(sound, folder / entry["file"])
    return arguments(folder)


def arguments(folder: Path) -> list[str]:
    """``identify`` of the log in a folder."""
    return ["identify", str(folder / "robot.urdf"), str(folder)]


def first_trial(folder: Path, suffix: str) -> Path:
    """Write a sound log whose first trial has a format; the file of that trial."""
    stated = header()
    stated["trials"][0]["file"] = f"one{suffix}"
    write_log(folder, stated)
    return folder / f"one{suffix}"


def c3d(folder: Path) -> Path:
    """A sound C3D file of three markers and a plate, too few for a person."""
    n = 60
    t = np.arange(n) / 100.0
    markers = {
        label: np.column_stack([0.1 * np.sin(t), np.full(n, 0.2), np.full(n, height)])
        for label, height in (("C7", 1.4), ("RHEEL", 0.1), ("LHEEL", 0.1))
    }
    corners = 1e3 * np.array([[0.4, 0.6, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    force = np.tile([0.0, 0.0, 700.0], (10 * n, 1))
    plate = c3d_file.plate_of(2, corners, 40.0, force, np.zeros((10 * n, 3)))
    return c3d_file.write(folder / "walk.c3d", markers, 100.0, [plate], c3d_file.Style())


def person(*files: Path) -> list[str]:
    """``human`` with recordings of a person."""
    sound = ["--mass", "70", "--height", "1.75", "--sex", "male"]
    return ["human", *map(str, files), *sound, "--out", str(files[0].parent / "made")]
