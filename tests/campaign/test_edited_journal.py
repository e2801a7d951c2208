"""A campaign's folder that was changed between two calls: resumed, or refused in one line."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.campaign.journal import Journal
from excite.campaign.loop import campaign, true_masses
from excite.campaign.plan_document import merged_plan
from excite.documents.campaign import Campaign
from excite.errors import ExciteError, InputError, LogError
from excite.robot.robot import Robot
from tests.campaign.conftest import SMALL
from tests.documents.mutations import mutated


@pytest.fixture
def begun(small_campaign: tuple[Campaign, Path], tmp_path: Path) -> Path:
    """A copy of a finished campaign."""
    return Path(shutil.copytree(small_campaign[1], tmp_path / "campaign"))


def edit(path: Path, change: Callable[[dict], object]) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def test_a_changed_plan_is_taken_up_or_one_line(
    ur10: Robot, small_campaign: tuple[Campaign, Path], begun: Path
) -> None:
    random = np.random.default_rng(2)
    path = begun / "iteration_1" / "plan.json"
    sound = json.loads(path.read_text(encoding="utf-8"))
    together = small_campaign[0].conditioning
    assert together is not None
    read = 0
    for _ in range(60):
        document, what = mutated(sound, random)
        path.write_text(json.dumps(document), encoding="utf-8")
        try:
            planned = Journal(begun).planned(1, ur10)
            assert planned is not None and planned.chosen
            json.dumps(merged_plan(ur10, [planned.document], together).to_json())
            read += 1
        except ExciteError as error:
            assert "iteration_1" in str(error) and "\n" not in str(error), what
    assert 0 < read < 60


def test_a_changed_journal_is_one_line(ur10: Robot, begun: Path) -> None:
    random = np.random.default_rng(3)
    path = begun / "journal.json"
    sound = json.loads(path.read_text(encoding="utf-8"))
    for _ in range(60):
        document, what = mutated(sound, random)
        path.write_text(json.dumps(document), encoding="utf-8")
        if all(document.get(key) == value for key, value in sound.items()):
            continue
        with pytest.raises(InputError) as caught:
            Journal(begun).open(ur10, SMALL, resume=True)
        assert caught.value.source == path and "\n" not in str(caught.value), what


def exchanged(begun: Path) -> None:
    """The folders of two iterations change places."""
    first, second, aside = (begun / name for name in ("iteration_1", "iteration_2", "aside"))
    first.rename(aside)
    second.rename(first)
    aside.rename(second)


def other_logs(begun: Path) -> None:
    first, second, aside = (begun / name for name in ("iteration_1/log", "iteration_2/log", "aside"))
    first.rename(aside)
    second.rename(first)
    aside.rename(second)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (exchanged, r"iteration_1/plan\.json: selected: '.*' was not planned in iteration 1"),
        (other_logs, r"iteration_1/log/log\.yaml: trials: i2_\w+ is none of the motions of iteration_1"),
        (lambda begun: shutil.rmtree(begun / "iteration_1"), r"iteration_1/plan\.json: is missing, while"),
        (
            lambda begun: (begun / "iteration_2" / "plan.json").write_text("{"),
            r"iteration_2/plan\.json: is no",
        ),
    ],
)
def test_folders_that_changed_are_one_line(
    change: Callable[[Path], object], said: str, ur10: Robot, begun: Path
) -> None:
    change(begun)
    with pytest.raises(InputError, match=said):
        campaign(ur10, begun, SMALL, resume=True)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda truth: truth["masses"].popitem(), "masses: has no 'wrist_3_link'"),
        (lambda truth: truth["masses"].update(forearm_link="4 kg"), "masses.forearm_link: is '4 kg', not"),
        (lambda truth: truth.pop("masses"), "masses: is missing"),
        (lambda truth: truth.update(schema="excite.plan/1"), "schema: schema is 'excite.plan/1'"),
    ],
)
def test_an_edited_truth_is_one_line(
    change: Callable[[dict], object], said: str, ur10: Robot, begun: Path
) -> None:
    path = begun / "iteration_1" / "log" / "truth.json"
    edit(path, change)
    with pytest.raises(LogError, match=re.escape(str(path)) + ": " + said):
        true_masses(ur10, path)


def test_a_folder_for_the_truth_is_one_line(ur10: Robot, begun: Path) -> None:
    path = begun / "iteration_1" / "log" / "truth.json"
    path.unlink()
    path.mkdir()
    with pytest.raises(LogError, match=r"truth\.json: is a folder"):
        campaign(ur10, begun, SMALL, resume=True)


def test_a_campaign_may_go_on_for_longer_and_not_otherwise(ur10: Robot, tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.open(ur10, SMALL, resume=False)
    journal.open(ur10, replace(SMALL, max_iterations=4), resume=True)
    # It is then a campaign of four.
    with pytest.raises(InputError, match="max_iterations 4, not 2"):
        journal.open(ur10, SMALL, resume=True)
    with pytest.raises(InputError, match="target_rsd"):
        journal.open(ur10, replace(SMALL, max_iterations=5, target_rsd=9.0), resume=True)
