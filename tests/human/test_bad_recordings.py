"""Whatever the bytes of a recording are, reading it gives a recording or one LogError; folders are whole or absent."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import excite
from excite.cli.main import app
from excite.errors import InputError, LogError
from excite.formats.markers import check_c3d
from excite.human.measure import MeasureSettings
from excite.human.recording import Recording
from excite.human.recording_files import read_recording
from tests.corpus.practice import c3d
from tests.corpus.recordings import _csv, _mot, _trc
from tests.logs.test_bad_files import CHANGES, damaged

MANY = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SOUND = {"a.trc": _trc(), "a.mot": _mot(), "a.csv": _csv()}


def recording_or_error(path: Path) -> None:
    try:
        found = read_recording(path)
    except LogError as error:
        assert str(path) in str(error) and "\n" not in str(error)
    else:
        assert isinstance(found, Recording)
        assert all(np.isfinite(plate.force).all() for plate in found.plates)
        assert not any(np.isinf(values).any() for values in found.markers.values())


@pytest.mark.parametrize("name", SOUND)
@MANY
@given(changes=CHANGES)
def test_damaged_text(tmp_path, name, changes):
    path = tmp_path / name
    path.write_bytes(damaged(SOUND[name].encode(), changes))
    recording_or_error(path)


@pytest.mark.parametrize("name", [*SOUND, "a.c3d"])
@MANY
@given(data=st.binary(max_size=1500))
def test_any_bytes(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    recording_or_error(path)


@MANY
@given(changes=CHANGES)
def test_the_structure_of_any_c3d_file_is_judged(tmp_path, changes):
    path = tmp_path / "walk.c3d"
    if not path.exists():
        c3d(tmp_path)
    try:
        check_c3d(damaged(path.read_bytes(), changes), path)
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)


def test_a_c3d_file_that_its_library_crashes_on_is_one_line(tmp_path):
    """The channel of a plate lies far outside the analog channels: nothing in the file's structure says so."""
    path = c3d(tmp_path)
    data = bytearray(path.read_bytes())
    place = data.index(b"CHANNEL") + len(b"CHANNEL") + 6
    for k in range(6):
        struct.pack_into("<h", data, place + 2 * k, 30000 + k)
    path.write_bytes(data)
    with pytest.raises(LogError, match=r"walk\.c3d"):
        read_recording(path)


def test_what_fails_late_leaves_no_folder(person, tmp_path, monkeypatch):
    def fails(*_args, **_options):
        raise InputError("fails late")

    monkeypatch.setattr(excite, "measure_person", lambda *_args: person)
    monkeypatch.setattr(excite, "write_person", fails)
    out = tmp_path / "made"
    words = ["human", "a.c3d", "--mass=70", "--height=1.75", "--sex=male", f"--out={out}"]
    run = CliRunner().invoke(app, words)
    assert str(run.exception) == "fails late"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("table", "magic"),
        ("up", "w"),
        ("cutoff_hz", float("nan")),
        ("cutoff_hz", 1e300),
        ("hold_out", 1.0),
        ("hold_out", float("nan")),
        ("segment_mass", {"tail": 1.0}),
        ("segment_mass", {"head": float("inf")}),
    ],
)
def test_settings_are_bounded(field, value):
    with pytest.raises(InputError):
        MeasureSettings(**{field: value})
