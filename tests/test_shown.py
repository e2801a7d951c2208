"""How results show themselves: reprs that fit a screen, HTML without surprises, tables that pandas takes."""

from __future__ import annotations

import builtins
import doctest
import html.parser
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import excite
from excite import display as shown
from excite.diagnosis.answer.answer import Diagnosis
from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.diagnosis.answer.gap import Budget, ChannelBudget, ChannelGap, Gap, UnnamedShare, Where
from excite.display import Shown, Tabled
from excite.documents.campaign import Campaign, Iteration
from excite.errors import ExciteError
from excite.identification import judgement as poor
from excite.logs.log import Trial
from tests.export.identified import identification_of
from tests.export.models.identified_folder import known


def recording(path: Path, trial: Trial) -> Path:
    """A trial as somebody's table."""
    columns = {"t": trial.time[:, None], "q": trial.q, "tau": trial.tau}
    names = [f"{name}{k}" if name != "t" else name for name, x in columns.items() for k in range(x.shape[1])]
    np.savetxt(path, np.hstack(list(columns.values())), delimiter=",", header=",".join(names), comments="")
    return path


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Tabled]:
    folder = tmp_path_factory.mktemp("results")
    robot = excite.load_robot("ur10")
    motions = list(excite.load_motions("ur10"))[:2]
    plan = excite.plan(robot, n_candidates=4, generator="random_joint", seed=3)
    found = identification_of(robot, robot.nominal_parameters, {"viscous.elbow_joint": 2.0})
    candidate = Candidate("backlash", "elbow_joint", {"gap": Estimate(0.01, 0.001, "rad")}, 50.0, 0.1, 0.9)
    known("ur10", folder)
    source = recording(folder / "recording.csv", excite.simulate(robot, motions[:1], seed=3).log.trials[0])
    conversion = excite.convert([source], "ur10", folder / "log")
    assert conversion.chart is not None
    return {
        "plan": plan,
        "check": excite.check(robot, motions),
        "rank": excite.rank(robot, motions),
        "identification": found,
        "campaign": Campaign(
            "ur10", 15.0, (Iteration(3, 20.0, {"m(forearm)": 20.0}, ()),), found, plan.conditioning
        ),
        "diagnosis": Diagnosis(
            "ur10",
            "effect",
            "backlash",
            "elbow_joint",
            ("elbow_joint",),
            (candidate,),
            (candidate,),
            Gap(0.3, 0.04, 0.03, 0.97, {"elbow_joint": ChannelGap(3.0, 0.25, 0.2, "N·m")}),
            (Where("elbow_joint", 1.0, "velocity", (0.1, 1.5), {"velocity": 0.8}),),
        ),
        "conversion": conversion,
        "chart": conversion.chart,
        "model": excite.write_simulator_model(folder, "urdf", folder / "out"),
    }


NAMES = ("plan", "check", "rank", "identification", "campaign", "diagnosis", "conversion", "chart", "model")


@pytest.mark.parametrize("name", NAMES)
def test_a_repr_fits_a_screen_and_says_what_it_is(name: str, results: dict[str, Tabled]) -> None:
    lines = repr(results[name]).splitlines()
    assert lines[0] == f"<{type(results[name]).__name__}>" and len(lines) > 1
    assert len(lines) <= 22 and max(map(len, lines)) <= 110


@pytest.mark.parametrize("name", NAMES)
def test_every_table_is_a_frame_with_a_row_for_each_row(name: str, results: dict[str, Tabled]) -> None:
    pandas = pytest.importorskip("pandas")
    result = results[name]
    pandas.testing.assert_frame_equal(result.to_frame(), result.to_frame(result.tables[0]))
    for table in result.tables:
        frame, rows = result.to_frame(table), result.rows(table)
        assert len(frame) == len(rows)
        for row in rows:
            assert list(row) == list(frame.columns)
            assert all(np.ndim(value) <= 1 and not isinstance(value, np.ndarray) for value in row.values())
    with pytest.raises(ExciteError, match=f"no table 'colours'.*{result.tables[0]}"):
        result.to_frame("colours")


def test_numbers_in_frames_are_those_of_the_result(results: dict[str, Tabled]) -> None:
    found = results["identification"]
    frame = found.to_frame("parameters").set_index(["link", "parameter"])
    ten = np.reshape(found.parameters, (-1, 10))
    np.testing.assert_array_equal(frame["value"].to_numpy().reshape(-1, 10), ten)
    assert frame.loc[("forearm_link", "m"), "value"] == ten[2, 0]
    checked = results["check"]
    motions = checked.to_frame()
    assert list(motions["motion"]) == [one.motion for one in checked.verdicts]
    assert motions["joint_position_rad"].iloc[0] == checked.verdicts[0].margins.joint_position_rad
    assert results["plan"].to_frame()["duration_s"].sum() == pytest.approx(results["plan"].duration_s)


class _Balanced(html.parser.HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attributes: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_gets_balanced_html_with_the_table(name: str, results: dict[str, Tabled]) -> None:
    parser = _Balanced()
    parser.feed(results[name]._repr_html_())
    assert parser.open == [] and type(results[name]).__name__ in parser.text
    assert len(results[name]._repr_html_()) < 30_000


def test_html_takes_any_text_for_text() -> None:
    class Odd(Shown):
        def summary(self) -> str:
            return "<script>alert(1)</script>\n" + "line & more\n" * 100

    assert "<script>" not in Odd()._repr_html_() and "&amp;" in Odd()._repr_html_()
    assert repr(Odd()).splitlines()[-1] == "… and 81 lines more in .summary()"


def test_without_pandas_a_table_is_one_line(
    results: dict[str, Tabled], monkeypatch: pytest.MonkeyPatch
) -> None:
    original = builtins.__import__

    def without(name: str, *others: object) -> object:
        if name == "pandas":
            raise ImportError(name)
        return original(name, *others)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ExciteError, match=r"need pandas.*pip install pandas.*to_json"):
        results["check"].to_frame()


def test_logs_motions_and_budgets_are_short_too(results: dict[str, Tabled], tmp_path: Path) -> None:
    robot = excite.load_robot("ur10")
    motion = next(iter(excite.load_motions("ur10")))
    assert repr(motion).startswith("Motion('") and len(repr(motion)) < 120 and "6 joints" in repr(motion)
    run = excite.simulate(robot, [motion], nominal=True)
    assert repr(run).startswith("<Experiment>\n") and len(repr(run)) < 2000
    assert repr(run.log).startswith("Log(") and "1 trial, " in repr(run.log) and len(repr(run.log)) < 120
    assert repr(run.log.trials[0]).startswith("Trial(") and len(repr(run.log.trials[0])) < 120


def test_shares_of_a_budget_are_rows_that_add_up() -> None:
    from excite.diagnosis.answer.answer import budget_rows

    channel = ChannelBudget(0.1, 1.0, (), (UnnamedShare("velocity", 0.3),), 0.7)
    rows = budget_rows(Budget({"elbow_joint": channel}, (), ()))
    assert [row["follows"] for row in rows] == ["velocity", "the rest"]
    assert sum(row["share"] for row in rows) == pytest.approx(1.0)


def test_numbers_are_written_as_a_person_writes_them() -> None:
    for module in (shown, poor):
        found = doctest.testmod(module)
        assert found.attempted and not found.failed


def test_one_of_something_is_not_several(results: dict[str, Tabled]) -> None:
    campaign = results["campaign"]
    assert isinstance(campaign, Campaign)
    one = replace(campaign, iterations=(Iteration(1, 20.0, {"m(forearm)": 20.0}, ()),))
    assert "iteration 1: 1 motion, 20 s in all" in one.summary()
