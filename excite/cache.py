"""Results that are kept on disk between runs, under a digest of all that decides them.

The folder is ``$EXCITE_CACHE``, else ``excite`` in the user's folder for caches. It may be removed at any time. What
cannot be read or is damaged counts as missing; where nothing can be written, nothing is kept.
"""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path

_CHECKSUM = 20


def cached_file(kind: str, *parts: bytes) -> Path | None:
    """Where a result of a kind is kept that these parts decide; None where the user has no such place."""
    named = os.environ.get("EXCITE_CACHE")
    with suppress(RuntimeError):
        caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folder = Path(named) if named else Path(caches) / "excite"
        if folder.is_absolute():
            digest = blake2b(digest_size=_CHECKSUM)
            for part in parts:
                digest.update(len(part).to_bytes(8, "little"))
                digest.update(part)
            return folder / kind / digest.hexdigest()
    return None


def read_cached(file: Path | None) -> bytes | None:
    """What :func:`write_cached` wrote; None if it is not there or not whole."""
    try:
        content = file.read_bytes() if file is not None else b""
    except OSError:
        return None
    return content[_CHECKSUM:] if content and _checksum(content[_CHECKSUM:]) == content[:_CHECKSUM] else None


def write_cached(file: Path | None, content: bytes) -> None:
    """Keep a result, whole or not at all."""
    if file is None:
        return
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        number, name = tempfile.mkstemp(prefix=".", dir=file.parent)
        temporary = Path(name)
        try:
            with os.fdopen(number, "wb") as stream:
                stream.write(_checksum(content) + content)
            temporary.replace(file)
        finally:
            temporary.unlink(missing_ok=True)


def _checksum(content: bytes) -> bytes:
    return blake2b(content, digest_size=_CHECKSUM).digest()
