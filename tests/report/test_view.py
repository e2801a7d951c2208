"""What can be watched, what the handles do, and the page of it that needs no server."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest

from excite.cli.main import _run_command
from excite.errors import ExciteError
from excite.logs.files import load_log
from excite.motion.collection import load_motions
from excite.motion.files import save_motion
from excite.report.comparisons import ReportData, save_report_data
from excite.report.view import page_text, read_thing, record_page, serve_page
from excite.results import write_json
from excite.robot.loading import load_robot
from tests.report.diagnosed import two_joints_diagnosed
from tests.report.sample import sample_path
from tests.report.scripts import islands, strange_scripts
from tests.report.unpacked import unpack_table


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_motion(load_motions("ur10")[0], tmp_path_factory.mktemp("motions") / "one.parquet")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, motion: Path) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "log"
    assert _run_command(["simulate", "ur10", str(motion), "--out", str(folder)]) == 0
    return folder


def test_a_motion_knows_its_robot(motion: Path) -> None:
    thing = read_thing(motion)
    assert thing.robot.name == "ur10" and len(thing.clips) == 1
    assert [one["title"] for clip in thing.clips.values() for one in clip["signals"]] == [
        "position",
        "velocity",
        "torque",
    ]


def test_a_folder_of_results_holds_no_motion(tmp_path: Path) -> None:
    """What its report draws from has the suffix of a motion."""
    save_report_data(ReportData(path=sample_path(load_robot("ur10"))), tmp_path / "report_data.npz")
    with pytest.raises(ExciteError, match="holds no motion, plan, log or diagnosis"):
        read_thing(tmp_path)
    with pytest.raises(ExciteError, match="folder holds no motions"):
        load_motions([tmp_path], load_robot("ur10"))


def test_a_log_has_the_command_as_a_ghost(log: Path) -> None:
    thing = read_thing(log)
    clip, trial = next(iter(thing.clips.values())), load_log(log).trials[0]
    assert clip["ghost"]["label"] == "commanded"
    time = trial.time - trial.time[0]
    at = np.searchsorted(time, unpack_table(clip["time"])[30, 0])
    np.testing.assert_allclose(unpack_table(clip["q"])[30], trial.q[at], atol=0.02)
    np.testing.assert_allclose(unpack_table(clip["ghost"]["q"])[30], trial.q_cmd[at], atol=0.02)
    torque = next(one for one in clip["signals"] if one["title"] == "torque")
    between = np.interp(unpack_table(clip["time"])[:, 0], time, trial.tau[:, 1])
    np.testing.assert_allclose(unpack_table(torque["values"])[:, 1], between, atol=0.2)


def test_a_diagnosis_has_the_simulator_as_a_ghost_and_residuals(log: Path, tmp_path: Path) -> None:
    path = sample_path(load_robot("ur10"))
    document = {**two_joints_diagnosed().to_json(), "log_file": str(log)}
    write_json(document, tmp_path / "diagnosis.json")
    save_report_data(ReportData(path=path), tmp_path / "report_data.npz")
    thing = read_thing(tmp_path)
    clips = list(thing.clips.values())
    assert [clip["ghost"]["label"] for clip in clips] == [
        "the simulator as it was",
        "the simulator with the effects",
    ]
    apart = [np.abs(unpack_table(clip["ghost"]["q"]) - unpack_table(clip["q"])).max(axis=0) for clip in clips]
    np.testing.assert_allclose(apart[1][-1], 0.1 * apart[0][-1], rtol=1e-3)
    assert apart[0][-1] > 0.25 and apart[0][:-1].max() < 1e-4
    signal = clips[0]["signals"][0]
    left = unpack_table(signal["other"])[:, -1] - unpack_table(clips[0]["q"])[:, -1]
    difference = np.interp(
        unpack_table(clips[0]["time"])[:, 0], path.time - path.time[0], (path.nominal - path.measured)[:, -1]
    )
    np.testing.assert_allclose(left, difference, atol=1e-3)


def test_the_page_needs_nothing_and_holds_the_motion(motion: Path, tmp_path: Path) -> None:
    thing = read_thing(motion)
    page = record_page(thing, tmp_path / "one.html").read_text(encoding="utf-8")
    assert strange_scripts(page) == [] and len(page) < 2_000_000
    assert "default-src 'none'" in page and 'src="' not in page and "<link" not in page
    drawn, moved = unpack_table(islands(page)["view-0"]["q"]), load_motions("ur10")[0]
    np.testing.assert_allclose(drawn[[0, -1]], moved.q[[0, -1]], atol=1e-4)
    np.testing.assert_allclose(np.ptp(drawn, axis=0), np.ptp(moved.q, axis=0), atol=0.01)


def test_the_command_writes_the_page(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run_command(["view", str(motion), "--record", "one.html", "--out", str(tmp_path), "--json"]) == 0
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
    assert _run_command(["view", str(tmp_path / what), "--record", str(tmp_path / "page.html")]) == 4
    said = capsys.readouterr().err
    assert said.startswith("excite: ") and said.count("\n") == 1 and ";" in said
    assert not (tmp_path / "page.html").exists()


def test_it_is_served_until_it_is_told_to_end(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At the next free port where the one that was asked for is taken."""
    thing, pages = read_thing(motion), []
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = int(taken.getsockname()[1])

        def read(address: str) -> None:
            assert address != f"http://127.0.0.1:{port}"
            pages.append(urlopen(address).read().decode("utf-8"))

        serve_page(thing, port, read, seconds=0.1)
    assert pages == [page_text(thing)]
    said = capsys.readouterr()
    assert said.out == said.err == ""
