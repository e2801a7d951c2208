"""A commented ``log.yaml`` for trial files that already have the contract's columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from excite.atomic import write_text
from excite.errors import LogError, raised_as
from excite.formats.registry import column_suffixes, read_content
from excite.motion.content import BASE_POSE

# Where a person has to write something.
FILL_IN = "FILL IN"


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
    floating, current = set(BASE_POSE) <= set(columns), torque == "current"
    roles = ["identification", *["identification"] * (len(files) - 2), *["validation"] * (len(files) > 1)]
    # Lines, none where they do not apply, with what is to be filled in.
    rows = (
        ("schema: excite.log/1", ""),
        (f"robot: {models[0].name}   # nominal model beside this file", "")
        if models
        else (
            f"robot: robot.urdf   # nominal model beside this file   # {FILL_IN}",
            "robot: copy the nominal model's URDF into the folder",
        ),
        (
            f"base: {'suspended' if floating else 'fixed'}"
            "   # fixed, floating (on feet with wrench sensors) or suspended",
            "",
        ),
        ("gravity: [0.0, 0.0, -9.81]   # in the world frame [m/s²]", ""),
        (f"rate_hz: {rate:.5g}   # rows a second; the stamps are believed where they differ", ""),
        (f"joints: [{', '.join(joints)}]", ""),
        (
            f"torque: {torque}   # motor_side, link_side, current (columns i.JOINT) or none",
            "torque: motor_side if it contains the joint's friction, link_side if measured behind the gear"
            if "tau" in channels
            else "",
        ),
        (
            current and f"# torque_constants: {{{joints[0]}: 1.0}}   # N·m per A at the joint   # {FILL_IN}",
            "torque_constants: N·m per A of each joint, where they are known",
        ),
        ("# no_torque: []   # joints that move but whose torque was not measured", ""),
        ("# coupling: {}   # turns of a motor per turn of another joint, {wrist_6: {wrist_5: 1.0}}", ""),
        ("# lowpass_hz: 50   # only where all channels went through the same low-pass already", ""),
        (
            "q_cmd" in channels
            and "# controller: {mode: position, kp: {}, kd: {}, rate_hz: 1000}   # what the servo does with q_cmd",
            "controller: the servo's gains, where they are known",
        ),
        (
            floating and f"base_link: base_link   # link whose pose is logged   # {FILL_IN}",
            "base_link: the link whose pose is logged",
        ),
        (
            "modelled: [rigid_body, viscous_friction, coulomb_friction, armature]   # what the baseline has",
            "",
        ),
        (
            "trials:   # role: identification or validation; repeats: the file whose command it runs again",
            "trials: which of them validate, which repeat others",
        ),
        *((f"  - {{file: {file.name}, role: {role}}}", "") for file, role in zip(files, roles, strict=True)),
    )
    lines = [line for line, _ in rows if line]
    return "\n".join(lines) + "\n", [what for line, what in rows if line and what]
