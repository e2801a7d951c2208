"""One thread for linear algebra, so that no result depends on how many there are."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

_P = ParamSpec("_P")
_R = TypeVar("_R")


def one_blas_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Run a function with one BLAS thread.

    Threads split sums, and sums of other order round otherwise; many small factorisations are also faster
    on one.
    """

    @wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@cache
def _controller() -> ThreadpoolController:
    # Its BLAS has to be loaded before the controller looks.
    import scipy.linalg  # noqa: F401

    return ThreadpoolController()


@cache
def blas_kernels() -> str:
    """The kernels that numpy's BLAS has chosen for this machine's processor: with others, the last bits are others.

    That of scipy's wheels, which many processes never load, is left out.
    """
    libraries = [
        one for one in ThreadpoolController().info() if Path(one["filepath"]).parent.name != "scipy.libs"
    ]
    return " ".join(sorted({f"{one.get('version')} {one.get('architecture')}" for one in libraries}))
