"""The page's section on where each channel's gap goes, and the one on simple predictors."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.answer.gap import (
    ChannelGap,
    EffectShare,
    TrivialErrors,
    UnnamedShare,
    find_beaten_channels,
)
from excite.report.page import report
from excite.results import write_json
from tests.report.diagnosed import budgeted, two_joints_diagnosed, unknown


def page_of(diagnosis: Diagnosis, folder: Path) -> str:
    write_json(diagnosis.to_json(), folder / "diagnosis.json")
    return report(folder).read_text(encoding="utf-8")


def budget_of(page: str) -> str:
    start = page.index('<section id="budget">')
    return page[start : page.index("</section>", start)]


def test_one_sentence_opens_the_budget(tmp_path: Path) -> None:
    section = budget_of(page_of(budgeted(), tmp_path))
    sentence = (
        "Of the gap at shoulder (0.41 N·m above 0.050 noise), 63 % is coulomb friction at shoulder, "
        "20 % follows position, without a name, 10 % is torque bias at shoulder, 10 % is the rest."
    )
    assert section.index(sentence) < section.index("<h3>shoulder</h3>") < section.index("<details>")
    # What is hardly any of the whole gap is folded.
    assert section.index("<details>") < section.index("<h3>elbow</h3>")


def test_every_share_has_its_row_and_its_doubt(tmp_path: Path) -> None:
    section = budget_of(page_of(budgeted(), tmp_path))
    rows = {
        "coulomb friction at shoulder": ("63 %", "55 % to 70 %", ""),
        "torque bias at shoulder": ("10 %", "−10 % to 30 %", "may be nothing: too few stretches"),
        "backlash at shoulder": ("−5 %", "−30 % to 10 %", "does harm on the trials that judge"),
        "follows position, without a name": ("20 %", "–", ""),
        "does not repeat": ("2 %", "–", ""),
        "the rest": ("10 %", "–", ""),
    }
    for what, (share, interval, doubt) in rows.items():
        number = r'class="number" data-v="[^"]+"'
        row = rf"<tr><td>{what}</td><td {number}>{share}</td><td>{interval}</td><td>{doubt}"
        assert re.search(row, section), what


def test_the_terminal_says_of_an_interval_what_the_page_says(tmp_path: Path) -> None:
    """Each doubt once below the table, in the page's words, with the mark of the rows that it is about."""
    whole = budgeted()
    wide = EffectShare("torque_bias", "shoulder", 0.3, (-0.48, 2.48))
    shoulder = whole.budget.channels["shoulder"]
    twice = replace(shoulder, effects=(*shoulder.effects[:1], wide, shoulder.effects[2]))
    elbow = replace(
        whole.budget.channels["elbow"],
        effects=(wide, EffectShare("backlash", "elbow", 0.1, (float("nan"), float("nan")))),
    )
    found = replace(whole, budget=replace(whole.budget, channels={"shoulder": twice, "elbow": elbow}))
    text = found.summary()
    assert len(re.findall(r" -48…248%  torque bias at shoulder \[1\]\n", text)) == 2
    assert re.search(r"coulomb friction at shoulder\n", text) and "nan" not in text
    assert re.search(r"-5% .* backlash at shoulder \[2\]\n", text)
    assert re.search(r"10% +backlash at elbow\n", text)
    said = (
        "may be nothing: too few stretches of the record show it for more",
        "does harm on the trials that judge",
    )
    section = budget_of(page_of(found, tmp_path))
    for mark, doubt in enumerate(said, 1):
        assert text.count(f"\n[{mark}] {doubt}") == 1 and doubt in section


def test_a_bar_is_as_long_as_its_shares(tmp_path: Path) -> None:
    section = budget_of(page_of(budgeted(), tmp_path))
    bar = section[section.index('<div class="stack"') :]
    bar = bar[: bar.index("</div>")]
    widths = [float(part.split("%")[0]) for part in bar.split('style="width: ')[1:]]
    # What does harm has no length; the others fill the bar.
    assert widths == pytest.approx([100 * x / 1.05 for x in (0.63, 0.1, 0.2, 0.02, 0.1)], abs=0.01)


def test_figures_that_seem_to_contradict_each_other_are_explained(tmp_path: Path) -> None:
    page = page_of(budgeted(), tmp_path)
    assert "named effects take 67 %, and the accepted effects close 99 %: both are right" in budget_of(page)
    wide = replace(budgeted(), gap=replace(budgeted().gap, interval=(-0.27, 1.0)))
    page = page_of(wide, tmp_path)
    assert "90 % interval −27 to 100 %: so much is closed on the trials that judge" in page
    nothing = page_of(unknown(budgeted()), tmp_path)
    assert "no effect was accepted: both are right" in budget_of(nothing)


def test_without_a_budget_there_is_no_section(tmp_path: Path) -> None:
    page = page_of(two_joints_diagnosed(), tmp_path)
    assert 'id="budget"' not in page and 'id="trivial"' not in page


def test_positions_stand_beside_simple_predictors(tmp_path: Path) -> None:
    errors = {
        "shoulder": TrivialErrors(0.0794, 0.0100, 0.0050, 0.0076, model=0.0056),
        "elbow": TrivialErrors(0.05, 0.02, 0.01, None, model=0.002),
    }
    gap = replace(
        two_joints_diagnosed().gap, per_channel={n: ChannelGap(0.02, 0.0056, 0.001, "rad") for n in errors}
    )
    diagnosis = replace(two_joints_diagnosed(), gap=gap, trivial=errors, faults=find_beaten_channels(errors))
    page = page_of(diagnosis, tmp_path)
    section = re.sub(r' data-v="[^"]*"', "", page[page.index('<section id="trivial">') :])
    cells = "".join(f'<td class="number">{x}</td>' for x in ("5.60", "79.4", "10.0", "5.00", "7.60"))
    assert f"<tr><td>shoulder</td><td>mrad</td>{cells}</tr>" in section
    assert "started anew from the record every 0.5 s" in section
    assert "At 1 of 2 joints the simulator is no better on trials left out than" in section


def test_torques_stand_beside_repeats_alone(tmp_path: Path) -> None:
    errors = {"shoulder": TrivialErrors(repeat=0.02, model=0.3, unit="N·m")}
    section = page_of(replace(two_joints_diagnosed(), trivial=errors), tmp_path)
    section = section[section.index('<section id="trivial">') :]
    assert '<th class="number">a repeat</th>' in section and "linear filter</th>" not in section
    alone = {"shoulder": TrivialErrors(model=0.3, unit="N·m")}
    assert 'id="trivial"' not in page_of(replace(two_joints_diagnosed(), trivial=alone), tmp_path)


def test_what_the_baseline_was_fitted_to_is_on_the_page(tmp_path: Path) -> None:
    page = page_of(budgeted(), tmp_path)
    start = page.index('<section id="baseline">')
    rows = re.sub(r"<[^>]+>", "|", page[start : page.index("</section>", start)])
    rows = re.sub(r"[|]+", "|", rows)
    assert "|shoulder|coulomb friction|1.52|0.0200|1.46 to 1.58|N·m|" in rows
    assert "|elbow|kp|210|–|–|N·m/rad|" in rows
    assert 'id="baseline"' not in page_of(two_joints_diagnosed(), tmp_path)


def test_the_answer_says_where_most_of_the_rest_is(tmp_path: Path) -> None:
    part = replace(budgeted(), gap=replace(budgeted().gap, share_closed=0.4), effects=budgeted().effects[1:])
    page = page_of(part, tmp_path)
    assert "Most of the rest is at shoulder." in page
    strange = budgeted()
    assert strange.budget is not None
    shoulder = replace(
        strange.budget.channels["shoulder"], unnamed=(UnnamedShare("velocity", 0.8),), effects=(), rest=0.2
    )
    channels = {**strange.budget.channels, "shoulder": shoulder}
    page = page_of(replace(part, budget=replace(strange.budget, channels=channels)), tmp_path)
    assert "Most of the rest is at shoulder, where it follows velocity and has no name." in page
    assert "Most of the rest" not in page_of(budgeted(), tmp_path)


def test_what_does_harm_is_in_the_sentence_where_the_rest_is_more_than_all(tmp_path: Path) -> None:
    whole = budgeted()
    assert whole.budget is not None
    harm = EffectShare("payload", "arm", -0.13, (-0.58, 0.33))
    shoulder = replace(whole.budget.channels["shoulder"], effects=(harm,), unnamed=(), rest=1.13)
    budget = replace(whole.budget, channels={**whole.budget.channels, "shoulder": shoulder})
    section = budget_of(page_of(replace(whole, budget=budget), tmp_path))
    assert "−13 % is payload at arm, which does harm there, 113 % is the rest." in section


def test_where_the_gap_by_channel_lies_at_another_joint_the_budget_says_why(tmp_path: Path) -> None:
    channels = {"shoulder": ChannelGap(0.21, 0.2, 0.2), "elbow": ChannelGap(1.0, 0.1, 0.1)}
    found = replace(budgeted(), gap=replace(budgeted().gap, per_channel=channels), modelled=("rigid_body",))
    why = "most of it lies at shoulder, before and after count it where most lies at elbow"
    assert why in budget_of(page_of(found, tmp_path))
    assert why in found.summary()
    same = replace(found, gap=budgeted().gap)
    assert "bodies are fitted anew" not in page_of(same, tmp_path)
    assert "bodies are fitted anew" not in same.summary()
    fixed = replace(found, modelled=("rigid_body_fixed",))
    assert "bodies are fitted anew" not in fixed.summary()


def test_a_channel_without_a_gap_is_no_hundred_percent_in_words() -> None:
    found = budgeted()
    nothing = replace(found.budget.channels["elbow"], weight=0.0)
    found = replace(found, budget=replace(found.budget, channels=found.budget.channels | {"elbow": nothing}))
    assert re.search(r"elbow +– +nothing stands above its noise", found.summary())
