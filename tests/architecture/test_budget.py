"""The package grows in no room: lines, files, functions, tokens, branches and constants may only fall."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.architecture import budget

ALLOWED = budget.allowed()
# Share of a number that may be unused before the table has to be lowered.
_SLACK = 0.02


@pytest.fixture(scope="module")
def now() -> dict[str, dict[str, int]]:
    """What the rooms weigh: every file of the package is read, so not while tests are gathered."""
    return budget.measured()


def test_the_table_has_every_room(now):
    assert set(ALLOWED) == set(now)


def test_a_room_holds_its_budget(now):
    """Where a number has to rise, it is edited by hand, with the reason in the commit."""
    risen = {
        (room, count): value
        for room, row in now.items()
        for count, value in row.items()
        if value > ALLOWED[room][count]
    }
    assert risen == {}


def test_the_table_follows_what_has_fallen(now):
    """``python -m tests.architecture.budget --lower`` writes it."""
    loose = {
        (room, count): value
        for room, row in now.items()
        for count, value in row.items()
        if ALLOWED[room][count] - value > max(2, _SLACK * ALLOWED[room][count])
    }
    assert loose == {}


def test_what_is_counted(tmp_path: Path):
    file = tmp_path / "module.py"
    file.write_text(
        '"""Doc."""\n\n_MOST, NAME = 3, "x"\n_RATE: float = -2.5\n_UNUSED = 1\n\n\n'
        "def read(a: int) -> tuple[int, int, int]:\n    # a comment\n    if a > _MOST:\n        return a, a, a\n"
        "    return (1, 2, 3) if a < _RATE else (0, 0, 0)\n"
    )
    found = budget._weighed(file)
    assert (found["lines"], found["functions"], found["ifs"], found["one_word_functions"]) == (12, 1, 2, 1)
    assert (found["constants"], found["deciding_constants"], found["bare_tuples"]) == (3, 2, 1)
    laid_out = tmp_path / "laid_out.py"
    laid_out.write_text(
        file.read_text().replace("_UNUSED = 1", "_UNUSED =  1  # many").replace("\n\n\n", "\n\n\n\n")
    )
    other = budget._weighed(laid_out)
    assert other["tokens"] == found["tokens"] == 63 and other["lines"] > found["lines"]
