"""Serves the stage to browsers until it is interrupted."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout

from excite.errors import InputError
from excite.viewer.stage import Stage
from excite.viewer.thing import Thing

# Of a browser's picture.
_FRAMES_HZ = 30.0


def serve(thing: Thing, port: int, ready: Callable[[str], None], *, seconds: float | None = None) -> None:
    """Show a thing in the browser.

    Args:
        thing: what is watched.
        port: where; the next free one where it is taken.
        ready: told the address once it is served.
        seconds: how long; None until it is interrupted.

    Raises:
        InputError: viser is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise InputError("excite view needs the package viser", remedy="pip install 'excite[viz]'") from error

    # viser says on stdout where it serves, which is where results stand.
    with redirect_stdout(sys.stderr):
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
        try:
            stage = Stage(server, thing)
            ready(f"http://127.0.0.1:{server.get_port()}")
            begun = before = time.monotonic()
            while seconds is None or before - begun < seconds:
                time.sleep(1.0 / _FRAMES_HZ)
                now = time.monotonic()
                stage.advance(now - before)
                before = now
        finally:
            server.stop()
