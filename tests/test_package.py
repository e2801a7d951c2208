"""The package's face: verbs are callable whatever was imported before."""

from __future__ import annotations

import subprocess
import sys

import pytest

import excite


@pytest.mark.parametrize("verb", ["report", "campaign"])
def test_a_room_does_not_hide_the_verb_of_its_name(verb):
    code = (
        f"import importlib, excite; importlib.import_module('excite.{verb}'); assert callable(excite.{verb})"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def test_every_public_name_is_there():
    assert sorted(excite.__all__) == dir(excite)
    for name in excite.__all__:
        assert getattr(excite, name) is not None


def test_import_is_quick_and_loads_nothing_heavy():
    code = "import sys, excite; print([m for m in ('numpy', 'pinocchio', 'matplotlib') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
