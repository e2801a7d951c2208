"""Workers of a Dask cluster that runs somewhere already."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from excite.errors import InputError
from excite.parallel.jobs import Executor

# Time for a scheduler to answer [s]: longer than one takes that is busy, shorter than patience with a wrong address.
TIMEOUT_S = 15.0


@contextmanager
def executor(address: str) -> Iterator[Executor]:
    """The workers of a Dask cluster, for as long as the block lasts; the cluster stays.

    Its workers need the same version of excite and a ``TMPDIR`` that they share with this machine. One thread a
    worker is enough: models are used by one thread of a process at a time. Where a worker dies, the scheduler gives
    its tasks to another one.

    Args:
        address: of the scheduler, such as ``tcp://10.0.0.1:8786``.

    Raises:
        InputError: the package ``distributed`` is not installed, or no scheduler answers there within
            :data:`TIMEOUT_S`.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "needs the package distributed", field="--cluster", remedy="pip install 'excite[cluster]'"
        ) from error
    try:
        client = Client(address, timeout=TIMEOUT_S, set_as_default=False, name="excite")
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            f"no scheduler answers at {address!r} within {TIMEOUT_S:g} s",
            field="--cluster",
            remedy="give the address that `dask scheduler` prints, such as tcp://10.0.0.1:8786",
        ) from error
    try:
        # A key of its own for each task: a task that is run again is not to find the failure of the first run.
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=2)
