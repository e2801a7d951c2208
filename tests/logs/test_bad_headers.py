"""Whatever stands in a log.yaml, reading it gives a header or one LogError; clocks and gaps are bounded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from excite.errors import LogError
from excite.logs.files import load_log
from excite.logs.header import read_header
from excite.logs.log import LogHeader
from tests.corpus.practice import ROWS, header, write_log

MANY = settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)
TIME = np.arange(ROWS) / 100.0


def header_or_error(path: Path) -> None:
    try:
        assert isinstance(read_header(path), LogHeader)
    except LogError as error:
        assert str(path) in str(error) and "\n" not in str(error)


@MANY
@given(data=st.binary(max_size=300))
def test_any_bytes(tmp_path, data):
    path = tmp_path / "log.yaml"
    path.write_bytes(data)
    header_or_error(path)


@MANY
@given(field=st.sampled_from([*LogHeader.model_fields, "schema", "other"]), value=VALUES)
@example(field="torque_constants", value={"\n": None})
def test_any_value_of_a_field(tmp_path, field, value):
    path = tmp_path / "log.yaml"
    path.write_text(yaml.safe_dump(header() | {field: value}), encoding="utf-8")
    header_or_error(path)


def loaded(tmp_path: Path, time: np.ndarray) -> np.ndarray:
    write_log(tmp_path, None, {"time": time})
    return load_log(tmp_path).trials[0].time


def test_a_pause_that_its_rows_pay_for_is_read(tmp_path):
    time = loaded(tmp_path, TIME + 60.0 * (np.arange(ROWS) >= 100))
    assert time[-1] == pytest.approx(61.99)


def test_seconds_since_1970_are_read(tmp_path):
    assert loaded(tmp_path, 1.7e9 + TIME)[0] == 1.7e9


def test_stamps_that_differ_by_less_than_a_clock_s_tick_are_one(tmp_path):
    doubled = np.repeat(TIME[: ROWS // 2], 2)
    doubled[1::2] += 1e-12
    assert len(loaded(tmp_path, doubled)) == ROWS // 2


@pytest.mark.parametrize("name", ["a/one.csv", "./one.csv"])
def test_trials_may_lie_in_folders_of_the_log(tmp_path, name):
    stated = header()
    stated["trials"][0]["file"] = name
    (tmp_path / "a").mkdir()
    write_log(tmp_path, stated)
    assert load_log(tmp_path).trials[0].name == "one"


def test_a_chain_of_repetitions_is_no_circle(tmp_path):
    stated = header()
    stated["trials"] = [
        {"file": f"{name}.csv", "role": "identification"} | ({"repeats": f"{before}.csv"} if before else {})
        for name, before in (("three", "two"), ("two", "one"), ("one", None))
    ]
    write_log(tmp_path, stated)
    assert [trial.repeats for trial in load_log(tmp_path).trials] == ["two", "one", None]


def test_the_model_may_lie_beside_the_log(tmp_path):
    folder = tmp_path / "log"
    folder.mkdir()
    write_log(folder, header() | {"robot": "../robot.urdf"})
    (folder / "robot.urdf").rename(tmp_path / "robot.urdf")
    assert load_log(folder).robot_text
