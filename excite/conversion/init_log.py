"""A commented ``log.yaml`` for trial files that already have the contract's columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np

from excite.atomic import write_text
from excite.errors import LogError, raised_as
from excite.formats.documents import read_yaml
from excite.formats.registry import column_suffixes, read_content
from excite.motion.content import BASE_POSE


@dataclass(frozen=True)
class WrittenHeader:
    """A ``log.yaml`` that was written.

    Attributes:
        path: the file.
        fill_in: what a person has to say in it.
    """

    path: Path
    fill_in: tuple[str, ...]


@raised_as(LogError)
def write_header(folder: str | Path, *, overwrite: bool = False) -> WrittenHeader:
    """Write a ``log.yaml`` beside trial files, with what they tell and with comments for what they do not.

    Args:
        folder: holds trial files with columns such as ``time``, ``q.JOINT``, ``tau.JOINT``.
        overwrite: replace a ``log.yaml`` that is there.

    Returns:
        The file, and what a person has to fill in.

    Raises:
        LogError: no such folder, no trial files in it, none with such columns, or there is a ``log.yaml`` already.
    """
    folder = Path(folder)
    path = folder / "log.yaml"
    if not folder.is_dir():
        raise LogError("no such folder", source=folder, remedy="name the folder that holds the trials")
    if path.exists() and not overwrite:
        raise LogError("exists already", source=path, remedy="edit it, or overwrite it by --force")
    files = [
        file
        for file in sorted(folder.iterdir())
        if file.suffix.lower() in column_suffixes() and file.is_file()
    ]
    if not files:
        raise LogError(
            "holds no trials", source=folder, remedy=f"put files there ({', '.join(column_suffixes())})"
        )
    columns = read_content(files[0]).columns
    joints = [name[2:] for name in columns if name.startswith("q.")]
    if not joints or "time" not in columns:
        raise LogError(
            "has no columns time and q.JOINT",
            source=files[0],
            remedy="use `excite convert`, which takes columns of any names",
        )
    steps = np.diff(np.asarray(columns["time"], dtype=float))
    rate = 1.0 / float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 100.0
    models = sorted(folder.glob("*.urdf"))
    text, fill_in = _header_text(files, list(columns), joints, rate, models)
    write_text(path, text)
    return WrittenHeader(path, tuple(fill_in))


def _header_text(
    files: Sequence[Path], columns: Sequence[str], joints: Sequence[str], rate: float, models: Sequence[Path]
) -> tuple[str, list[str]]:
    """The lines that apply, and what a person has to say."""
    channels = {name.partition(".")[0] for name in columns}
    torque = "motor_side" if "tau" in channels else "current" if "i" in channels else "none"
    free = set(BASE_POSE) <= set(columns)
    facts = {
        "model": bool(models),
        "no model": not models,
        "torques": "tau" in channels,
        "currents": torque == "current",
        "commands": "q_cmd" in channels,
        "free base": free,
    }
    words = {
        "model": models[0].name if models else "",
        "base": "suspended" if free else "fixed",
        "rate": f"{rate:.5g}",
        "joints": ", ".join(joints),
        "first": joints[0],
        "torque": torque,
    }
    table = read_yaml(Path(__file__).with_name("log_header.yaml")).values()
    rows = [row for row in table if facts.get(row.get("when"), True)]
    lines = [Template(row["line"]).substitute(words) for row in rows if "line" in row]
    roles = ["identification"] * (len(files) - 1) + ["validation" if len(files) > 1 else "identification"]
    lines += [f"  - {{file: {file.name}, role: {role}}}" for file, role in zip(files, roles, strict=True)]
    return "\n".join(lines) + "\n", [row["fill_in"] for row in rows if "fill_in" in row]
