"""Corners of mesh files, in STL, Collada and OBJ, also of damaged ones."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import RobotError, in_one_line, raised_as
from excite.formats.child import in_child
from excite.formats.file import MAX_TEXT_BYTES, check_file, read_bytes
from excite.robot.refusal import robot_error

# The trunk of a quadruped in Collada takes 6 s. Of 300 damaged Collada files four kept the loader busy without end, so
# that the search for the one among many shall not take a minute.
BATCH_SECONDS = 20.0
SECONDS_A_MEGABYTE = 0.7

_BINARY_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_DAMAGED = "it is damaged: export it again"


def read_meshes(paths: Iterable[Path], faults: dict[Path, RobotError] | None = None) -> dict[Path, Array]:
    """Corners of mesh files by path, ``(n, 3)``, in their own unit and frame; shared corners may be repeated.

    STL is read here; any other format (Collada, OBJ) goes through coal's loader, in a process of its own: all in one,
    since starting it takes longer than most meshes, and one by one where that fails, since a process that hangs or
    crashes does not say at which of them.

    Args:
        faults: gets the errors of files that cannot be read, which are then left out; None raises the first.

    Raises:
        RobotError: a file is missing, unreadable, damaged or too large, or holds no finite point.
    """
    found: dict[Path, Array] = {}
    files = dict.fromkeys(paths)
    stl = [[path] for path in files if path.suffix.lower() == ".stl"]
    others = [path for path in files if path.suffix.lower() != ".stl"]
    # Grows by each of those that cannot be read together.
    batches = [*stl, others] if others else stl
    for batch in batches:
        try:
            points = (
                [_stl_points(*batch)]
                if batch[0].suffix.lower() == ".stl"
                else _load_meshes(batch, alone=batch is not others)
            )
            found |= {path: _check_points(one, path) for path, one in zip(batch, points, strict=True)}
        except RobotError as error:
            if len(batch) > 1:
                batches += [[path] for path in batch]
            elif faults is None:
                raise
            else:
                faults[batch[0]] = error
    return found


def load_points(paths: tuple[Path, ...]) -> list[Array]:
    """Corners of mesh files as coal loads them, in this process: a damaged file may take it down."""
    import coal

    loaded = []
    for path in paths:
        try:
            loaded.append(np.array(coal.MeshLoader().load(str(path), np.ones(3)).vertices()).reshape(-1, 3))
        except (RuntimeError, ValueError) as error:
            what = f"mesh cannot be read ({in_one_line(error)[:160]})"
            raise robot_error(path, None, what, "check the mesh's format") from error
    return loaded


@raised_as(RobotError)
def _load_meshes(paths: list[Path], *, alone: bool) -> list[Array]:
    """By a process of its own; one of them again, ``alone``, is given less time."""
    for path in paths:
        check_file(path, limit=MAX_TEXT_BYTES)
    megabytes = sum(path.stat().st_size for path in paths) / 1e6
    points: list[Array] = in_child(
        "excite.robot.shapes.mesh_files:load_points",
        tuple(paths),
        source=paths[0],
        seconds=(12.0 if alone else BATCH_SECONDS) + SECONDS_A_MEGABYTE * megabytes,
        memory_gb=8.0,
    )
    return points


def _check_points(points: Array, path: Path) -> Array:
    if len(points) == 0 or not np.isfinite(points).all():
        raise robot_error(path, None, "mesh has no corners or one that is not finite", "export it again")
    # A part of 1 km in micrometres.
    if np.abs(points).max() > 1e9:
        raise robot_error(
            path, None, f"mesh has a corner {np.abs(points).max():.3g} from its origin", _DAMAGED
        )
    return points


@raised_as(RobotError)
def _stl_points(path: Path) -> Array:
    content = read_bytes(path, limit=MAX_TEXT_BYTES)
    n_triangles = int.from_bytes(content[80:84], "little") if len(content) >= 84 else -1
    if len(content) == 84 + 50 * n_triangles:
        triangles = np.frombuffer(content, _BINARY_STL, n_triangles, offset=84)
        return triangles["corners"].reshape(-1, 3).astype(np.float64)
    # What begins so is text, unless it holds what no text does.
    if content[:5].lower() == b"solid" and b"\0" not in content:
        return _text_points(content, path)
    what = f"has {len(content)} bytes"
    if n_triangles >= 0:
        what += f", and its {n_triangles} triangles take {84 + 50 * n_triangles}"
    raise robot_error(path, None, f"mesh is no whole STL file: it {what}", _DAMAGED)


def _text_points(content: bytes, path: Path) -> Array:
    text = content.decode("ascii", "replace")
    rows = [line.split()[1:] for line in text.splitlines() if line.lstrip().startswith("vertex")]
    whole = text.rstrip().splitlines()[-1].lstrip().lower().startswith("endsolid") and len(rows) % 3 == 0
    if not whole or any(len(row) != 3 for row in rows):
        raise robot_error(path, None, "mesh is no whole STL file: its text ends early", _DAMAGED)
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise robot_error(
            path, None, f"mesh is no STL file ({in_one_line(error)[:100]})", _DAMAGED
        ) from error


def binary_stl(triangles: NDArray[np.floating]) -> bytes:
    """Binary STL of triangles ``(n, 3, 3)`` [m]."""
    records = np.zeros(len(triangles), dtype=_BINARY_STL)
    a, b, c = np.asarray(triangles, dtype="<f4").transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records["normal"], records["corners"] = normals / np.where(lengths > 0.0, lengths, 1.0), triangles
    return bytes(80) + len(records).to_bytes(4, "little") + records.tobytes()
