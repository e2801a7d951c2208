"""The files of a first description: ``robot.yaml``, and the URDF and meshes of a MuJoCo model."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

from excite.atomic import all_or_nothing, write_text
from excite.errors import InputError, RobotError
from excite.robot.mjcf.conversion import MjcfConversion, convert_mjcf, is_mjcf
from excite.robot.scaffold.description import scaffold_description


@dataclass(frozen=True)
class ScaffoldFiles:
    """What was written.

    Attributes:
        description: the ``robot.yaml``.
        urdf: the URDF that it names.
        fill_in: what a person must still say, one line each.
        notes: what a MuJoCo model says and the URDF made from it does not; empty for a URDF.
    """

    description: Path
    urdf: Path
    fill_in: tuple[str, ...]
    notes: tuple[str, ...]


def write_scaffold(file: Path, folder: Path, *, seed: int = 0, overwrite: bool = False) -> ScaffoldFiles:
    """Write a commented ``robot.yaml`` for a URDF or a MuJoCo model.

    Args:
        file: the URDF or MJCF.
        folder: where to write; of a MuJoCo model also the URDF, named as the model's file, and its meshes.
        seed: seed of the random postures behind inertia and collision pairs.
        overwrite: whether files of these names may be replaced.

    Raises:
        InputError: a file is there already.
        RobotError: the model is missing or absurd in a way that no description can mend.
    """
    target = folder / "robot.yaml"
    _absent(target, overwrite)
    if not is_mjcf(file):
        text = scaffold_description(file, folder, seed=seed)
        return ScaffoldFiles(write_text(target, text), file, _open_marks(text), ())
    urdf = folder / f"{file.stem}.urdf"
    _absent(urdf, overwrite)
    conversion = convert_mjcf(file)
    text = _described(conversion, urdf, file, seed)
    with all_or_nothing():
        conversion.write(urdf)
        write_text(target, text)
    return ScaffoldFiles(target, urdf, _open_marks(text), conversion.notes)


def _described(conversion: MjcfConversion, urdf: Path, file: Path, seed: int) -> str:
    """Describe the URDF from a copy that goes away again, so that nothing is written where that fails."""
    with tempfile.TemporaryDirectory() as folder:
        copy = conversion.write(Path(folder) / urdf.name)
        try:
            return scaffold_description(copy, folder, seed=seed, floating=conversion.floating)
        except RobotError as error:
            # The person knows the model, not the copy of its URDF.
            raise RobotError(error.what, source=file, field=error.field, remedy=error.remedy) from error


def _absent(path: Path, overwrite: bool) -> None:
    if os.path.exists(path) and not overwrite:
        raise InputError("exists already", source=path, remedy="give --force to overwrite it, or --out DIR")


def _open_marks(text: str) -> tuple[str, ...]:
    marks = (line.partition("FILL IN:") for line in text.splitlines())
    return tuple(mark.strip() for _, found, mark in marks if found)
