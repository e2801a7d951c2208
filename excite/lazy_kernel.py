"""Compile numeric kernels with numba at their first call, so that importing excite stays fast."""

from __future__ import annotations

import pickle
import threading
import types
from collections.abc import Callable
from functools import update_wrapper
from typing import Any


class LazyKernel:
    """A function that numba compiles when it is first called, with its machine code cached on disk.

    Other lazy kernels of the same module that the function calls are compiled along with it. The machine code leaves
    the interpreter to other threads.
    Where no folder for the cache can be written, compilation is repeated in each process.
    """

    # Threads that meet at a kernel's first call are to have one dispatcher, which compiles once.
    _meeting = threading.RLock()

    def __init__(self, function: Callable[..., Any]):
        self._function = function
        self._compiled: Callable[..., Any] | None = None
        update_wrapper(self, function)

    def compiled(self) -> Callable[..., Any]:
        """The numba dispatcher."""
        with self._meeting:
            if self._compiled is None:
                self._compiled = self._dispatcher()
            return self._compiled

    def _dispatcher(self) -> Callable[..., Any]:
        # numba takes 0.4 s to import.
        from numba import njit

        function = self._function
        scope = {
            name: value.compiled() if isinstance(value, LazyKernel) and value is not self else value
            for name, value in function.__globals__.items()
            if name in function.__code__.co_names or name == "__name__"
        }
        bound = types.FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
        bound.__module__, bound.__qualname__ = function.__module__, function.__qualname__
        # No fast mathematics: what the compiler may then fuse or reorder depends on where arrays lie in memory,
        # and the same seed would give other bytes in another process.
        try:
            kernel: Any = njit(cache=True, nogil=True, error_model="numpy")(bound)
        except RuntimeError:  # numba's word for "no folder to cache in"
            return njit(nogil=True, error_model="numpy")(bound)
        _clear_stale_cache(kernel._cache)
        return kernel

    def __call__(self, *arguments: Any) -> Any:
        return self.compiled()(*arguments)


def _clear_stale_cache(cache: Any) -> None:
    """Clear a kernel's cache that names types which the installed version has no more.

    numba unpickles the types of the arguments before it compares the version of the source, and an upgrade would end in
    an AttributeError.
    """
    try:
        cache._cache_file._load_index()
    except (AttributeError, ImportError, EOFError, pickle.UnpicklingError):
        cache.flush()
