"""Processes that end with the one that started them, however that ends."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of Linux
# How often a process looks whether its parent is still there where the system does not tell it [s].
_LOOK_S = 1.0


def die_with_parent(parent: int | None = None) -> None:
    """Let this process be killed when its parent ends, by SIGKILL too.

    On Linux the kernel does it, when the thread ends that started this process: start processes from a thread that
    lasts. Elsewhere a thread looks every second, which waits for native code that keeps the interpreter to itself.

    Args:
        parent: process number of the parent; this process ends at once if it has another by now. None: do not look.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
    if parent is None:
        return
    if os.getppid() != parent:
        os._exit(1)
    if sys.platform != "linux":
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)
