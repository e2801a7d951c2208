"""Who does a command's work: ``--jobs`` or ``--cluster``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from excite.parallel.cluster import executor
from excite.parallel.jobs import AtMost, Jobs


@contextmanager
def requested_workers(jobs: int | None, cluster: str | None) -> Iterator[Jobs]:
    """What the options of a command ask for; up to one process a core where the work is long, if neither is given."""
    if cluster is None:
        yield jobs or AtMost(os.cpu_count() or 1)
        return
    if jobs is not None:
        raise typer.BadParameter("give this or --jobs, not both", param_hint="'--cluster'")
    with executor(cluster) as found:
        yield found
