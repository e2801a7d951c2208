"""A new member of an axis is one file and its line: done on a copy of the package, seen through the public door."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from excite.campaign.searches import SEARCHES
from excite.export.registry import EXPORTERS
from excite.identification.estimators.registry import ESTIMATORS
from excite.motion.generators.registry import GENERATORS
from tests.architecture.source_tree import PACKAGE, ROOT
from tests.architecture.toys import TOYS, add_toys, touched_files


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package, the toys in it, and the robots.

    Folders that no toy touches are links, so that what numba compiles of them is kept for all, and taken from there.
    """
    folder = tmp_path_factory.mktemp("axes")
    touched = {Path(PACKAGE, file).parent for file in touched_files()}
    copy_around(Path(PACKAGE), folder, touched)
    (folder / "robots").symlink_to(ROOT / "robots")
    (folder / "tests").symlink_to(ROOT / "tests")
    add_toys(folder / PACKAGE)
    return folder


def copy_around(place: Path, folder: Path, touched: set[Path]) -> None:
    """Copy the files of a place below the root, and link those of its folders that hold nothing touched."""
    (folder / place).mkdir()
    for path in (ROOT / place).iterdir():
        inner = place / path.name
        if not path.is_dir():
            shutil.copy2(path, folder / inner)
        elif any(one.is_relative_to(inner) for one in touched):
            copy_around(inner, folder, touched)
        elif path.name != "__pycache__":
            (folder / inner).symlink_to(path)


def run(folder: Path, *arguments: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(folder), "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def seen(copy: Path) -> dict[str, Any]:
    """By axis, what users see of its toy; all in one process, since starting one takes the longest."""
    return json.loads(run(copy, "-m", "tests.architecture.toys", str(copy)))


def test_no_toy_needs_more_than_its_file_and_two_lines():
    """A registry that imports takes an import and an entry; an effect's word in the log format is a line more.

    What is installed beside the package takes no line at all.
    """
    for axis, toy in TOYS.items():
        registries = [name for name, _, _ in toy.lines if name != "logs/vocabulary.py"]
        assert len(set(registries)) == (not toy.axis) and len(registries) <= 2, axis


def test_generator(seen):
    assert "toy" in seen["generator"]["known"]
    assert seen["generator"]["by"] == "toy"


def test_search_for_candidates(seen):
    assert seen["search"]["accepted"] == 1
    assert "toy_search" in seen["generator"]["known"]


def test_safety_check(seen):
    assert seen["check"] == [["toy"]]


def test_safety_repair(seen):
    assert seen["repair"]["toy"] == 1


def test_estimator(seen):
    assert seen["estimator"]["method"] == "toy"
    assert "toy" in seen["estimator"]["known"]


def test_injected_effect(seen):
    assert seen["injected effect"]["changed"] > 1.0
    assert "toy" in seen["injected effect"]["known"]


def test_diagnosed_effect(seen):
    found = seen["diagnosed effect"]
    assert (found["verdict"], found["effect"]) == ("effect", "toy")
    assert found["listed"] == ["τ = c q v: damping that grows with the position."]
    assert found["modelled"] == "toy"
    assert any("toy has no form in a simulator" in text for text in found["warnings"])


def test_format(seen):
    """One file and one line: a log and a motion are read in it, and errors name it."""
    assert seen["format"]["log"] and seen["format"]["motion"]
    assert ".toy" in seen["format"]["remedy"]


def test_motion_reader(seen):
    assert seen["motion reader"]["same"]
    assert "JSON by another name (.toymotion)" in seen["motion reader"]["remedy"]


def test_exporter(seen):
    assert seen["exporter"]["text"].endswith(" samples")
    assert "toy" in seen["exporter"]["known"]


def test_reader_of_recordings(seen):
    assert abs(seen["reader"] - 0.5) < 0.01


def test_report_section(seen):
    assert seen["report section"]


@pytest.mark.parametrize("command", ["plan", "identify", "export"])
def test_help_lists_what_can_be_asked_for(copy, command):
    assert "toy" in run(copy, "-m", "excite", command, "--help")


@pytest.mark.parametrize("registry", [ESTIMATORS, EXPORTERS, GENERATORS, SEARCHES])
def test_names_of_a_registry_are_those_of_its_members(registry):
    assert {name: member.name for name, member in registry.items()} == {name: name for name in registry}
