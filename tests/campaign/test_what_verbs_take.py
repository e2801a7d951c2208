"""The verbs take a robot, its name or its file; motions and logs, or where they lie."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import excite
from excite.campaign.journal import CampaignSettings
from excite.errors import InputError


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verbs") / "plan"
    excite.plan("ur10", n_candidates=4, seed=1).save(folder)
    return folder


@pytest.fixture(scope="module")
def log(planned: Path) -> Path:
    excite.simulate("ur10", planned).save(planned.parent / "log")
    return planned.parent / "log"


def test_names_and_folders_say_the_same_as_what_was_loaded(planned: Path, log: Path) -> None:
    """Each of these ended in an AttributeError of a string."""
    robot = excite.load_robot("ur10")
    motions = excite.load_motions([planned], robot)
    assert excite.check("ur10", str(planned)).to_json() == excite.check(robot, motions).to_json()
    mixed = [motions[0], *sorted((planned / "motions").iterdir())[1:]]
    assert excite.rank("ur10", mixed).to_json() == excite.rank(robot, motions).to_json()
    found = excite.identify("ur10", str(log), "wls").to_json()
    assert found == excite.identify(robot, excite.load_log(log, robot), "wls").to_json()
    assert excite.capture("ur10", planned).path.is_file()
    with pytest.raises(InputError, match=r"^no_plan/plan\.json: no such file"):
        excite.capture("ur10", "no_plan")
    waiting = excite.campaign(
        "ur10", planned.parent / "campaign", CampaignSettings(n_candidates=4, on_robot=True)
    )
    assert waiting.awaits is not None


def test_a_robot_by_its_name_is_as_good_as_a_loaded_one(planned: Path, log: Path, tmp_path: Path) -> None:
    robot = excite.load_robot("ur10")
    assert excite.doctor(log, "ur10").to_json() == excite.doctor(log, robot).to_json()
    in_memory = excite.load_log(log, "ur10")
    assert excite.doctor(in_memory, "ur10").robot == "ur10"
    file = sorted((planned / "motions").iterdir())[0]
    assert (excite.load_motion(str(file), "ur10").q == excite.load_motion(file, robot).q).all()
    assert [one.name for one in excite.load_motions(file, "ur10")] == [file.stem]
    (written,) = excite.export_motions(file, "csv", out=tmp_path, robot=robot)
    assert written == tmp_path / f"{file.stem}.csv"
    models = excite.write_models("ur10", excite.identify(robot, log, "wls"), tmp_path / "models")
    assert models.differences.is_file()
    with pytest.raises(InputError, match="is a int; give a Robot"):
        excite.diagnose(log, 7)  # type: ignore[arg-type]
    with pytest.raises(
        InputError, match=r"is a list; give a log folder .*join_logs makes one log of several"
    ):
        excite.identify(robot, [log])  # type: ignore[arg-type]


def test_what_is_no_robot_is_said_in_one_line() -> None:
    with pytest.raises(InputError, match="is a int; give a Robot, a bundled name or a file"):
        excite.plan(7)  # type: ignore[arg-type]


def test_a_notebook_shows_the_page(planned: Path) -> None:
    page = excite.report(str(planned))
    assert isinstance(page, Path) and page == planned / "report.html"
    shown = page._repr_html_()
    assert shown.startswith('<iframe srcdoc="&lt;!doctype html&gt;') and shown.count('"') == 4


def test_one_of_what_is_asked_for_is_taken_as_one(planned: Path) -> None:
    """A motion ended in a TypeError, and a path was read letter by letter, the first of which is a whole disk."""
    robot = excite.load_robot("ur10")
    file = sorted((planned / "motions").iterdir())[0]
    (motion,) = excite.load_motions(file, robot)
    assert excite.check(robot, motion).to_json() == excite.check(robot, [motion]).to_json()
    (written,) = excite.export_motions(str(file), "csv", out=planned.parent / "one")
    assert written.is_file()
    bias = "torque_bias:elbow_joint:1.0"
    one, several = (
        excite.simulate(robot, motions, inject=inject, nominal=True).log.trials[0].tau
        for motions, inject in ((motion, bias), ([motion], [bias]))
    )
    assert (one == several).all()


@pytest.mark.parametrize("effect", ["coulomb_friction", "viscous_friction", "torque_gain", "payload"])
def test_what_is_injected_stands_in_the_truth_and_not_in_the_baseline(
    effect: str, planned: Path, tmp_path: Path
) -> None:
    robot = excite.load_robot("ur10")
    motion = excite.load_motions(sorted((planned / "motions").iterdir())[0], robot)
    plain = excite.simulate(robot, motion, nominal=True)
    found = excite.simulate(robot, motion, inject=effect, nominal=True)
    assert set(found.log.header.modelled) == set(plain.log.header.modelled) - {effect}
    found.save(tmp_path / "log")
    truth = json.loads((tmp_path / "log" / "truth.json").read_text())
    (injected,) = truth["injected"]
    assert injected["effect"] == effect and injected["value"] != 0.0 and injected["unit"]
    assert injected["location"] in (*robot.joint_names, *(segment.link for segment in robot.segments))
    assert plain.truth_json()["injected"] == []
