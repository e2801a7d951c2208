"""The page of measured figures marks every part whose code has changed since, and follows from what is kept."""

from __future__ import annotations

import importlib
import re

import pytest

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks import freshness

KEPT = benchmarks._kept()


def test_the_page_is_that_of_the_kept_figures():
    """A part whose code changed has to be marked: ``python -m tests.benchmarks --page`` writes the marks."""
    assert benchmarks.PAGE.read_text(encoding="utf-8") == benchmarks.page()


def test_every_part_says_when_and_of_which_commit_it_was_measured():
    assert set(KEPT) <= set(benchmarks.parts())
    for part in KEPT.values():
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", part["measured"]["date"])
        assert re.fullmatch(r"[0-9a-f]{8}\+?", part["measured"]["commit"])


@pytest.mark.parametrize("part", benchmarks.parts())
def test_a_part_can_be_measured(part: str):
    """What it imports is there: nobody wants to hear of that after hours."""
    assert callable(importlib.import_module(f"tests.benchmarks.{part}").rows)


def test_cheap_parts_are_those_that_took_little_of_a_processor(monkeypatch: pytest.MonkeyPatch):
    measured = {"conversion": {"processor_s": 20.0}, "main_job": {"processor_s": 900.0}, "selection": {}}
    monkeypatch.setattr(benchmarks, "_kept", lambda: {k: {"measured": v} for k, v in measured.items()})
    cheap = benchmarks.cheap_parts()
    assert "conversion" in cheap and "main_job" not in cheap
    # Of what was never timed those that are short by their kind.
    assert "regressor_speed" in cheap and not {"selection", "long_campaign"} & set(cheap)


def test_the_hash_of_a_part_moves_with_code_that_it_runs_through(monkeypatch: pytest.MonkeyPatch):
    before = freshness.code_hash("regressor_speed")
    assert freshness.code_hash("regressor_speed") == before
    syntax = freshness._syntax

    def changed(name: str):
        return lambda path: syntax(path) + ("changed" if path.as_posix().endswith(name) else "")

    monkeypatch.setattr(freshness, "_syntax", changed("excite/regressor/kernels.py"))
    assert freshness.code_hash("regressor_speed") != before
    monkeypatch.setattr(freshness, "_syntax", changed("excite/human/plates.py"))
    assert freshness.code_hash("regressor_speed") == before
