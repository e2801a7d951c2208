"""Independent work on several cores."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from excite.diagnosis.diagnose import diagnose
from excite.diagnosis.search import side_by_side as module
from excite.diagnosis.search.side_by_side import side_by_side


@pytest.mark.parametrize("cores", [1, 2, 5])
def test_results_come_in_the_order_of_their_items(monkeypatch: pytest.MonkeyPatch, cores: int) -> None:
    monkeypatch.setattr(module, "_cores", lambda: cores)
    later = threading.Event()

    def work(item: int) -> int:
        # With a core to spare the first ends after all others.
        if item == 0 and cores > 1:
            later.wait(10.0)
        if item == 19:
            later.set()
        return item * item

    assert side_by_side(work, range(20)) == [k * k for k in range(20)]
    assert side_by_side(work, []) == []


def test_what_one_item_raises_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda item: 1 / item, [2, 1, 0])


def test_a_diagnosis_does_not_depend_on_the_cores(monkeypatch: pytest.MonkeyPatch, gap_dir: Path) -> None:
    said = []
    for cores in (1, 4):
        monkeypatch.setattr(module, "_cores", lambda cores=cores: cores)
        said.append(diagnose(gap_dir / "arm" / "case_023").to_json())
    assert said[0] == said[1]
