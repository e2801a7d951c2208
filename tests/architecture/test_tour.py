"""The tour of the package names files and folders that are there, and every room."""

from __future__ import annotations

import re

from tests.architecture.source_tree import PACKAGE, ROOT
from tests.architecture.test_rooms import order

TOUR = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`((?:excite|robots|benchmarks)/[\w/.]*)`", TOUR)))


def test_every_file_and_folder_that_it_names_is_there():
    assert len(NAMED) > 50
    assert [name for name in NAMED if not (ROOT / name).exists()] == []


def test_it_names_every_room():
    spoken = set(re.findall(r"\w+", TOUR))
    assert {room for room in order() if (ROOT / PACKAGE / room).is_dir()} <= spoken


def test_it_is_two_pages_at_most():
    assert len(TOUR.splitlines()) < 110
