"""Compilation at first call."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numba
import pytest

from excite.lazy_kernel import LazyKernel


def double(x):
    return 2 * x


def test_importing_the_kernels_does_not_import_numba() -> None:
    code = "import sys, excite.excitation.selection; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_without_a_folder_for_the_cache_it_compiles_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    # numba loads more of itself at the first call, and what it loads must not meet the decorator below.
    genuine = numba.njit
    assert genuine(double)(4) == 8

    def njit(*, cache: bool = False, **options):
        if cache:
            raise RuntimeError("cannot cache function 'double': no locator available")
        return genuine(**options)

    monkeypatch.setattr(numba, "njit", njit)
    assert LazyKernel(double)(21) == 42


def test_a_cache_of_an_older_version_whose_types_are_gone_is_cleared(tmp_path: Path) -> None:
    for name in ("Pair", "Couple"):
        (tmp_path / "sums.py").write_text(
            "from typing import NamedTuple\nfrom excite.lazy_kernel import LazyKernel\n"
            f"class {name}(NamedTuple):\n    a: float\n    b: float\n"
            f"@LazyKernel\ndef add(pair):\n    return pair.a + pair.b\nprint(add({name}(1.0, 2.0)))\n"
        )
        run = [sys.executable, "-c", "import sums"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*sys.path, str(tmp_path)])}
        done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.stdout == "3.0\n", done.stderr


def test_a_kernel_that_runs_leaves_the_interpreter_to_other_threads() -> None:
    def count(n):
        total = 0
        for k in range(n):
            total += k % 7
        return total

    kernel = LazyKernel(count)
    kernel(1)
    begun = threading.Event()
    started, seen = time.perf_counter(), []

    def work() -> None:
        begun.set()
        kernel(300_000_000)

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    while thread.is_alive():
        seen.append(time.perf_counter())
        time.sleep(0.002)
    # A kernel that holds the interpreter shows itself as one gap as long as it runs.
    gaps = [b - a for a, b in itertools.pairwise([started, *seen, time.perf_counter()])]
    assert len(seen) > 5 and max(gaps) < 0.5 * sum(gaps)
