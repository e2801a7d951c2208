"""Mistakes in a log's files reach the person who runs ``excite identify``, named with their likely cause."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from excite.cli.main import app
from excite.errors import RobotError
from excite.formats.registry import format_of
from excite.logs.columns import trial_columns
from excite.robot.load import load_robot as bring_robot
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log

JOINTS = load_robot("ur10").joint_names
Columns = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def sound():
    """Header and columns of a log without mistakes."""
    log = arm_log(load_robot("ur10"), 0, trials=3, duration=6.0)
    header = log.header.model_dump(mode="json", by_alias=True, exclude_none=True)
    return header, [trial_columns(trial, log.header) for trial in log.trials]


def identify(folder: Path, sound, spoil, header=None):
    """Write the log with every trial spoilt, run the command; its result and findings by kind."""
    stated, trials = sound
    (folder / "log.yaml").write_text(yaml.safe_dump({**stated, **(header or {})}))
    (folder / "robot.urdf").write_text("<robot/>")
    for entry, columns in zip(stated["trials"], trials, strict=True):
        spoilt = {name: values.copy() for name, values in columns.items()}
        spoil(spoilt)
        path = folder / entry["file"]
        format_of(path).write(spoilt, path)
    run = CliRunner().invoke(
        app, ["identify", "ur10", str(folder), "--method", "wls", "--cutoff", "5", "--json"]
    )
    if run.exit_code:
        return run, {}
    return run, {item["kind"]: item for item in json.loads(run.stdout)["findings"]}


def exchange(channels: tuple[str, ...]):
    def spoil(columns: Columns) -> None:
        for channel in channels:
            a, b = f"{channel}.{JOINTS[1]}", f"{channel}.{JOINTS[2]}"
            columns[a], columns[b] = columns[b], columns[a]

    return spoil


def times(factor: float, *names: str):
    def spoil(columns: Columns) -> None:
        for name in names:
            columns[name] *= factor

    return spoil


def set_to(value: float, name: str):
    def spoil(columns: Columns) -> None:
        columns[name][:] = value

    return spoil


def cut(n: int):
    def spoil(columns: Columns) -> None:
        for name in columns:
            columns[name] = columns[name][:n]

    return spoil


def swap_two_rows(columns: Columns) -> None:
    for name in columns:
        columns[name][[200, 201]] = columns[name][[201, 200]]


def nothing(columns: Columns) -> None:
    """A sound log."""


NAMED = {
    "joints exchanged": (exchange(("q", "tau", "q_cmd")), {}, "order", "exchanged", JOINTS[1:3]),
    "degrees": (
        times(180 / np.pi, *(f"{c}.{j}" for c in ("q", "q_cmd") for j in JOINTS)), {}, "degrees", "degrees", JOINTS,
    ),
    "all torques turned": (times(-1.0, *(f"tau.{j}" for j in JOINTS)), {}, "torque_sign", "reaction", JOINTS),
    "one torque turned": (times(-1.0, f"tau.{JOINTS[2]}"), {}, "torque_sign", "opposite sign", JOINTS[2:3]),
    "motor side called link side": (nothing, {"torque": "link_side"}, "torque_side", "motor_side", JOINTS),
    "two rows in the wrong order": (swap_two_rows, {}, "reordered_rows", "put in order", ()),
    "a dead torque": (set_to(1.0, f"tau.{JOINTS[3]}"), {}, "constant", "dead channel", (f"tau.{JOINTS[3]}",)),
    "a dead position": (set_to(0.3, f"q.{JOINTS[3]}"), {}, "constant", "locked", (f"q.{JOINTS[3]}",)),
    "too few rows": (cut(150), {}, "too_few_rows", "record longer", ()),
}  # fmt: skip
FALSE_ALARMS = {"order", "degrees", "torque_sign", "torque_side", "torque_scale", "position_sign", "constant"}


# Units and signs that tests of the findings themselves go through too.
LATER = {"degrees", "one torque turned", "two rows in the wrong order", "a dead position", "joints exchanged"}


@pytest.mark.parametrize(
    "mistake", [pytest.param(name, marks=[pytest.mark.battery] if name in LATER else []) for name in NAMED]
)
def test_a_mistake_is_named_with_its_cause(mistake, tmp_path, sound):
    spoil, header, kind, cause, places = NAMED[mistake]
    run, found = identify(tmp_path, sound, spoil, header)
    assert run.exit_code == 0, run.output
    assert cause in f"{found[kind]['text']}: {found[kind]['remedy']}"
    assert tuple(found[kind]["places"]) == tuple(places)
    assert not (found.keys() & FALSE_ALARMS) - {kind}, "another mistake is named that was not made"


def test_a_sound_log_raises_no_alarm(tmp_path, sound):
    _, found = identify(tmp_path, sound, nothing)
    assert not found.keys() & FALSE_ALARMS


def test_a_clock_that_was_reset_ends_in_one_line(tmp_path, sound):
    def spoil(columns: Columns) -> None:
        columns["time"][300:] -= columns["time"][300]

    run, _ = identify(tmp_path, sound, spoil)
    assert run.exception.exit_code == 4
    assert "goes back" in str(run.exception) and "clock was reset" in str(run.exception)
    assert "trial_00" in str(run.exception) and "\n" not in str(run.exception)


@pytest.mark.parametrize("n", [1, 40])
def test_next_to_no_rows_end_in_one_line(n, tmp_path, sound):
    run, _ = identify(tmp_path, sound, cut(n))
    assert run.exception.exit_code == 4
    assert "samples" in str(run.exception) or "record longer" in str(run.exception)


def test_dates_as_times_are_named(tmp_path, sound):
    def dated(columns: Columns) -> None:
        columns["time"] = np.array(["2026-01-01T00:00:00.00"] * len(columns["time"]), dtype=object)

    run, _ = identify(tmp_path, sound, dated)
    assert run.exit_code != 0
    assert "time: " in str(run.exception) and "numeric" in str(run.exception)


def test_xacro_that_includes_itself_is_called_so(tmp_path):
    file = tmp_path / "arm.xacro"
    file.write_text(
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="arm.xacro"/></robot>'
    )
    with pytest.raises(RobotError, match="without end"):
        bring_robot(file)
