"""Compilation at first call."""

from __future__ import annotations

import subprocess
import sys

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
