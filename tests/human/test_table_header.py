"""Names of a laboratory's table in several lines; plates sampled faster than markers, or slower."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.errors import LogError
from excite.human.recording_files import read_recording

N, EVERY = 12, 5
HEADERS = {
    "names above axes": "Time,RSHO,,,LSHO,,,FP1,,,,,\n,X,Y,Z,X,Y,Z,Fx,Fy,Fz,Mx,My,Mz\n",
    "names above axes, units below": (
        "Subject,Anna\nRate,100\n\n,RSHO,,,LSHO,,,FP1,,,,,\nTime,X,Y,Z,X,Y,Z,Fx,Fy,Fz,Mx,My,Mz\n"
        "s,mm,mm,mm,mm,mm,mm,N,N,N,Nmm,Nmm,Nmm\n"
    ),
    "one line of names, units below": (
        "Time,RSHO_X,RSHO_Y,RSHO_Z,LSHO_X,LSHO_Y,LSHO_Z,FP1_Fx,FP1_Fy,FP1_Fz,FP1_Mx,FP1_My,FP1_Mz\n"
        "(s),(m),(m),(m),(m),(m),(m),(N),(N),(N),(Nm),(Nm),(Nm)\n"
    ),
}


def values() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(N * EVERY, 12))


def written(file: Path, header: str, time: np.ndarray, cells: np.ndarray, separator: str = ",") -> Path:
    rows = [
        separator.join([f"{t:.3f}", *("" if np.isnan(x) else f"{x:.6f}" for x in row)])
        for t, row in zip(time, cells, strict=True)
    ]
    file.write_text(header.replace(",", separator) + "\n".join(rows) + "\n")
    return file


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("habit", HEADERS)
def test_names_in_several_lines(habit, separator, tmp_path):
    cells = values()
    time = 0.01 * np.arange(len(cells))
    found = read_recording(written(tmp_path / "a.csv", HEADERS[habit], time, cells, separator))
    milli = 1e-3 if "mm" in HEADERS[habit] else 1.0
    assert sorted(found.markers) == ["LSHO", "RSHO"] and [plate.name for plate in found.plates] == ["FP1"]
    np.testing.assert_allclose(found.markers["LSHO"], milli * cells[:, 3:6], atol=1e-6)
    np.testing.assert_allclose(found.plates[0].force, cells[:, 6:9], atol=1e-6)
    np.testing.assert_allclose(found.plates[0].moment, milli * cells[:, 9:], atol=1e-6)


@pytest.mark.parametrize("faster", ["plates", "markers"])
def test_what_is_sampled_less_often_has_its_own_times(faster, tmp_path):
    cells = values()
    time = 0.001 * np.arange(len(cells))
    slow = slice(0, 6) if faster == "plates" else slice(6, 12)
    cells[np.arange(len(cells)) % EVERY != 0, slow] = np.nan
    if faster == "plates":
        # A frame in which nothing was seen is one all the same.
        cells[2 * EVERY, slow] = np.nan
    header = HEADERS["names above axes"]
    found = read_recording(written(tmp_path / "a.csv", header, time, cells))
    times = {"markers": found.time, "plates": found.plates[0].time}
    np.testing.assert_allclose(times.pop(faster), time)
    np.testing.assert_allclose(times.popitem()[1], time[::EVERY])
    assert len(found.markers["RSHO"]) == len(found.time)
    assert len(found.plates[0].force) == len(found.plates[0].time)


def test_a_table_of_numbers_alone_has_no_names(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("0,1,2,3\n0.1,1,2,3\n")
    with pytest.raises(LogError, match="has no column time"):
        read_recording(file)
