"""Hulls kept on disk between processes, so that a humanoid's are computed once a machine and not once a command."""

from __future__ import annotations

import io
import os
import tempfile
from contextlib import suppress
from functools import cache
from hashlib import blake2b
from pathlib import Path

import numpy as np
import scipy

from excite.arrays import Array
from excite.robot.shapes import meshes
from excite.robot.shapes.meshes import Hull, convex_hull
from excite.threads import blas_kernels

# Bytes of names and checksums: none is met by chance.
_CHECKSUM = 20


def kept_hull(points: Array, max_vertices: int, slack: float) -> Hull:
    """What :func:`~excite.robot.shapes.meshes.convex_hull` returns, to the bit, from disk where it was computed before.

    It is kept under a digest of the points, the numbers, and all that decides how they are rounded: the code, numpy,
    scipy and the machine's kernels of linear algebra. What cannot be read or is damaged is computed again; where
    nothing can be written, nothing is kept. The folder is ``$EXCITE_CACHE``, else ``excite`` in the user's folder for
    caches; it may be removed at any time.

    Args:
        points: ``(n, 3)`` [m].
        max_vertices: most corners that the result may have, at least 32.
        slack: growth below which no more corners are added.

    Raises:
        ValueError: the points lie in a plane.
    """
    folder = _cache_folder()
    if folder is None:
        return convex_hull(points, max_vertices, slack)
    digest = blake2b(
        f"{_rounding_key()} {max_vertices} {slack!r} {points.shape}".encode(), digest_size=_CHECKSUM
    )
    digest.update(np.ascontiguousarray(points).data)
    file = folder / f"{digest.hexdigest()}.hull"
    hull = _read_hull(file)
    if hull is None:
        hull = convex_hull(points, max_vertices, slack)
        _write_hull(file, hull)
    return hull


def _cache_folder() -> Path | None:
    """Where hulls are kept; None where the user has no such place."""
    named = os.environ.get("EXCITE_CACHE")
    with suppress(RuntimeError):
        caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(named) if named else Path(caches) / "excite"
        return folder / "hulls" if folder.is_absolute() else None
    return None


@cache
def _rounding_key() -> str:
    """What the same points may have another hull with."""
    code = blake2b(Path(meshes.__file__).read_bytes()).hexdigest()
    return f"{code} {np.__version__} {scipy.__version__} {blas_kernels()}"


def _read_hull(file: Path) -> Hull | None:
    """A hull as it was written; None if it is not there or not whole."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    if _content_checksum(content[_CHECKSUM:]) != content[:_CHECKSUM]:
        return None
    with np.load(io.BytesIO(content[_CHECKSUM:]), allow_pickle=False) as parts:
        return Hull(parts["vertices"], parts["faces"], float(parts["inflation"]))


def _write_hull(file: Path, hull: Hull) -> None:
    """Keep a hull, whole or not at all."""
    parts = io.BytesIO()
    np.savez(parts, vertices=hull.vertices, faces=hull.faces, inflation=hull.inflation)
    content = parts.getvalue()
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        number, name = tempfile.mkstemp(prefix=".", dir=file.parent)
        temporary = Path(name)
        try:
            with os.fdopen(number, "wb") as stream:
                stream.write(_content_checksum(content) + content)
            temporary.replace(file)
        finally:
            temporary.unlink(missing_ok=True)


def _content_checksum(content: bytes) -> bytes:
    return blake2b(content, digest_size=_CHECKSUM).digest()
