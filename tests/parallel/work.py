"""Tasks for workers to do: they have to be able to import them."""

from __future__ import annotations

import os
import resource
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from excite.errors import InputError


def draw(shared: int, seed: int) -> tuple[int, bytes]:
    """Random numbers, and a product of matrices that BLAS would share among threads."""
    matrix = np.random.default_rng([shared, seed]).normal(size=(300, 300))
    return seed, (matrix @ matrix).tobytes()


def folder(shared: None, number: int) -> str:
    """The working directory."""
    return os.getcwd()


def refuse_three(shared: None, number: int) -> int:
    """Refuse one task."""
    if number >= 3:
        raise InputError(f"is {number}", source="tasks", field="number", remedy="give less")
    return number


def unforeseen(shared: None, number: int) -> int:
    """Fail as nobody foresaw."""
    return number // 0


def die_once(marker: Path, number: int) -> int:
    """End the worker in the middle of the work, but for once."""
    if number == 5 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def poison(shared: None, number: int) -> int:
    """End the worker whenever that task is done."""
    if number == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return number


def sleep(folder: Path, number: int) -> int:
    """Say which process it is, then take long."""
    (folder / str(os.getpid())).touch()
    time.sleep(600.0)
    return number


def identity(shared: object, number: int) -> int:
    """Nothing."""
    return number


def busy(seconds: float, number: int) -> tuple[int, int]:
    """Keep a core busy for some time."""
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        pass
    return number, os.getpid()


def process(shared: object, number: int) -> int:
    """Which process it is."""
    return os.getpid()


def counted(count: int, taken: list[int]) -> Iterator[int]:
    """Tasks that notice when they are taken."""
    for number in range(count):
        taken.append(number)
        yield number


def pages_fetched(shared: None, rounds: int) -> int:
    """Pages that the system hands out while 16 arrays of a megabyte are made and freed, after a first time."""
    before = 0
    for k in range(rounds):
        if k == 1:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        arrays = [np.ones(1 << 17) for _ in range(16)]
        del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
