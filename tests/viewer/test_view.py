"""What can be watched, what the handles do, and the page of it that needs no server."""

from __future__ import annotations

import importlib.util
import json
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.cli.main import _run
from excite.errors import ExciteError
from excite.logs.files import load_log
from excite.motion.collection import load_motions
from excite.motion.files import save_motion
from excite.report.comparisons import ReportData, save_report_data
from excite.report.replay.tracks import unpack_table
from excite.results import write_json
from excite.robot.loading import load_robot
from excite.viewer.serve import record_page, serve
from excite.viewer.source import read_thing
from tests.report.diagnosed import two_joints_diagnosed
from tests.report.sample import sample_path
from tests.report.scripts import islands, strange_scripts

needs_viser = pytest.mark.skipif(
    importlib.util.find_spec("viser") is None, reason="no viser here: pip install 'excite[viz]'"
)


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_motion(load_motions("ur10")[0], tmp_path_factory.mktemp("motions") / "one.parquet")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, motion: Path) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "log"
    assert _run(["simulate", "ur10", str(motion), "--out", str(folder)]) == 0
    return folder


def test_a_motion_knows_its_robot(motion: Path) -> None:
    thing = read_thing(motion)
    assert thing.robot.name == "ur10" and len(thing.clips) == 1
    assert set(thing.clips[0].curves) == set(thing.robot.joint_names)


def test_a_folder_of_results_holds_no_motion(tmp_path: Path) -> None:
    """What its report draws from has the suffix of a motion."""
    save_report_data(ReportData(path=sample_path(load_robot("ur10"))), tmp_path / "report_data.npz")
    with pytest.raises(ExciteError, match="holds no motion, plan, log or diagnosis"):
        read_thing(tmp_path)
    with pytest.raises(ExciteError, match="folder holds no motions"):
        load_motions([tmp_path], load_robot("ur10"))


def test_a_log_has_the_command_as_a_ghost(log: Path) -> None:
    thing = read_thing(log)
    clip, trial = thing.clips[0], load_log(log).trials[0]
    assert clip.ghost is not None and clip.ghost[0] == "commanded"
    at = np.searchsorted(trial.time - trial.time[0], clip.time[30])
    np.testing.assert_allclose(clip.q[30], trial.q[at], atol=0.02)
    np.testing.assert_allclose(clip.ghost[1][30], trial.q_cmd[at], atol=0.02)


def test_a_diagnosis_has_the_simulator_as_a_ghost_and_residuals(log: Path, tmp_path: Path) -> None:
    robot, path = load_robot("ur10"), sample_path(load_robot("ur10"))
    document = {**two_joints_diagnosed().to_json(), "log_file": str(log)}
    write_json(document, tmp_path / "diagnosis.json")
    save_report_data(ReportData(path=path), tmp_path / "report_data.npz")
    thing = read_thing(tmp_path)
    assert [clip.ghost[0] for clip in thing.clips if clip.ghost] == [
        "the simulator as it was",
        "the simulator with the effects",
    ]
    apart = [np.abs(clip.ghost[1] - clip.q).max(axis=0) for clip in thing.clips if clip.ghost]
    np.testing.assert_allclose(apart[1][-1], 0.1 * apart[0][-1], rtol=1e-6)
    assert apart[0][-1] > 0.25 and apart[0][:-1].max() == 0.0
    curve = thing.clips[0].curves[robot.joint_names[-1]][-1]
    np.testing.assert_allclose(curve.lines["difference"], path.nominal[:, -1] - path.measured[:, -1])


def test_the_page_needs_nothing_and_holds_the_motion(motion: Path, tmp_path: Path) -> None:
    thing = read_thing(motion)
    page = record_page(thing, tmp_path / "one.html").read_text(encoding="utf-8")
    assert strange_scripts(page) == [] and len(page) < 2_000_000
    assert "default-src 'none'" in page and 'src="' not in page and "<link" not in page
    np.testing.assert_allclose(unpack_table(islands(page)["view-0"]["q"]), thing.clips[0].q, atol=1e-4)


def test_the_command_writes_the_page(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run(["view", str(motion), "--record", "one.html", "--out", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said.pop("made")["command"] == f"excite view {motion} --record one.html"
    assert said == {
        "schema": "excite.view/1",
        "file": "one.html",
        "motions": 1,
    }
    assert (tmp_path / "one.html").stat().st_size > 100_000


@pytest.mark.parametrize(
    "what", ["missing", "empty", "text.parquet", "broken/diagnosis.json", "nameless/diagnosis.json"]
)
def test_what_cannot_be_watched_is_one_line(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("empty", "broken", "nameless"):
        (tmp_path / folder).mkdir()
    (tmp_path / "text.parquet").write_text("no motion")
    (tmp_path / "broken" / "diagnosis.json").write_text("{")
    write_json(two_joints_diagnosed().to_json(), tmp_path / "nameless" / "diagnosis.json")
    assert _run(["view", str(tmp_path / what), "--record", str(tmp_path / "page.html")]) == 4
    said = capsys.readouterr().err
    assert said.startswith("excite: ") and said.count("\n") == 1 and ";" in said
    assert not (tmp_path / "page.html").exists()


def test_without_viser_one_line_says_what_to_install(motion: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ExciteError, match=r"needs the package viser; pip install 'excite\[viz\]'"):
        serve(read_thing(motion), 8080, print)


def _free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture
def stage(motion: Path) -> Iterator:
    import viser

    from excite.viewer.serve import Stage

    server = viser.ViserServer(host="127.0.0.1", port=_free_port(), verbose=False)
    yield Stage(server, read_thing(motion))
    server.stop()


@needs_viser
def test_the_stage_shows_the_robot_where_pinocchio_has_it(stage) -> None:
    robot, clip = stage.robot, stage.clip
    stage.show(float(clip.time[40]))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, clip.q[40])
    for frame, place in zip(stage.frames, data.oMi, strict=True):
        np.testing.assert_allclose(frame.position, place.translation, atol=1e-9)
        w, x, y, z = frame.wxyz
        np.testing.assert_allclose(pin.Quaternion(w, x, y, z).matrix(), place.rotation, atol=1e-9)
    np.testing.assert_allclose([slider.value for slider in stage.sliders], clip.q[40], atol=1e-3)
    assert stage.scrubber.value == pytest.approx(clip.time[40])


@needs_viser
def test_what_is_too_near_turns_red_and_a_slider_moves_a_joint(stage) -> None:
    assert not stage.touching
    colors = {tuple(mesh.color) for _, mesh in stage.meshes}
    folded = stage.q.copy()
    folded[1:3] = 0.0, 2.9  # The forearm back onto the upper arm.
    stage.pose(folded)
    assert "forearm_link" in stage.touching or "wrist_1_link" in stage.touching
    assert len({tuple(mesh.color) for _, mesh in stage.meshes} - colors) == 1
    stage.show(0.0)
    stage.sliders[0].value = 1.0
    stage._moved()
    assert stage.q[0] == pytest.approx(1.0) and not stage.playing.value


@needs_viser
def test_the_scrubber_ends_where_the_motion_does(motion: Path, tmp_path: Path) -> None:
    """It ended with the longest of them, so that most of its way was beyond a short one."""
    import viser

    from excite.viewer.serve import Stage

    first, second = (load_motions("ur10")[i] for i in (0, 1))
    for one in (first, second):
        save_motion(one, tmp_path / f"{one.name}.parquet")
    server = viser.ViserServer(host="127.0.0.1", port=_free_port(), verbose=False)
    try:
        shown = Stage(server, read_thing(tmp_path))
        for clip in shown.thing.clips:
            shown.choose(clip.title)
            assert shown.scrubber.max == pytest.approx(clip.time[-1])
        assert first.duration != pytest.approx(second.duration)
    finally:
        server.stop()


@needs_viser
def test_playing_goes_on_and_begins_anew(stage) -> None:
    stage.advance(1.0)
    assert stage.time == 0.0
    stage.playing.value = True
    stage.advance(1.0)
    assert stage.time == pytest.approx(1.0)
    stage.advance(1000.0)
    assert stage.time == stage.clip.time[-1]
    stage.advance(0.1)
    assert stage.time == 0.0


@needs_viser
def test_a_click_shows_the_joint(stage) -> None:
    stage.select("elbow_joint")
    assert stage.joint == "elbow_joint" and len(stage.plots) == 4


@needs_viser
def test_it_is_served_until_it_is_told_to_end(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    addresses: list[str] = []
    serve(read_thing(motion), _free_port(), addresses.append, seconds=0.1)
    assert addresses[0].startswith("http://127.0.0.1:")
    assert capsys.readouterr().out == ""
