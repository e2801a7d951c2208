"""One CSV in fourteen dresses, read by every user: the numbers are right, or it is refused with the reason."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from excite.conversion.sources.registry import read_source
from excite.errors import ExciteError, InputError
from excite.formats.documents import read_yaml
from excite.human.recording_files import read_recording
from excite.logs.files import load_log
from excite.motion.files import load_motion
from excite.robot.load import load_robot
from tests.logs.conftest import ARM

N = 60
TIME = np.arange(N) / 100.0
Table = dict[str, np.ndarray]
# Of each user, columns whose values no other column has.
WAVES = [0.1 * np.sin((1.0 + 0.3 * k) * TIME + k) for k in range(9)]
MOTION: Table = {"time": TIME, "q.shoulder": WAVES[0], "q.elbow": WAVES[1]}
LOG: Table = MOTION | {"tau.shoulder": WAVES[2], "tau.elbow": WAVES[3]}
PERSON: Table = {"time": TIME} | {
    f"{marker}.{axis}": WAVES[3 * k + i]
    for k, marker in enumerate(("RSHO", "LSHO"))
    for i, axis in enumerate("xyz")
}
PERSON |= {f"FP1.{kind}{axis}": 100.0 * WAVES[i] for kind in "fm" for i, axis in enumerate("xyz")}


def text(table: Table, separator: str = ",", decimal: str = ".", quote: str = "", pad: str = "") -> str:
    def cell(value: float) -> str:
        return f"{quote}{value:.9f}{quote}".replace(".", decimal)

    names = separator.join(f"{pad}{quote}{name}{quote}{pad}" for name in table)
    rows = [separator.join(map(cell, row)) for row in np.column_stack(list(table.values()))]
    return "\n".join([names, *rows]) + "\n"


def with_units(table: Table) -> str:
    """Milliseconds, degrees and millimetres, as the line below the names says."""
    said = {"time": ("ms", 1e3), "q": ("deg", 180.0 / math.pi), "RSHO": ("mm", 1e3), "LSHO": ("mm", 1e3)}
    units = [
        said.get(name.partition(".")[0], ("N·m" if "tau" in name or ".m" in name else "N", 1.0))
        for name in table
    ]
    scaled = {name: factor * values for (name, values), (_, factor) in zip(table.items(), units, strict=True)}
    names, _, rows = text(scaled).partition("\n")
    return f"{names}\n{','.join(unit for unit, _ in units)}\n{rows}"


DRESSES: dict[str, Callable[[Table], bytes]] = {
    "plain": lambda t: text(t).encode(),
    "semicolons": lambda t: text(t, ";").encode(),
    "tabs": lambda t: text(t, "\t").encode(),
    "blanks": lambda t: text(t, "  ").encode(),
    "decimal commas": lambda t: text(t, ";", ",").encode(),
    "byte order mark": lambda t: b"\xef\xbb\xbf" + text(t).encode(),
    "UTF-16": lambda t: text(t).encode("utf-16"),
    "quotation marks": lambda t: text(t, quote='"').encode(),
    "quoted decimal commas": lambda t: text(t, ",", ",", '"').encode(),
    "line of units": lambda t: with_units(t).encode(),
    "comments above": lambda t: ("# recorded by somebody\n# rate: 100 Hz\n" + text(t)).encode(),
    "carriage returns": lambda t: text(t).replace("\n", "\r\n").encode(),
    "no last line feed": lambda t: text(t).rstrip("\n").encode(),
    "blanks around names": lambda t: text(t, pad="  ").encode(),
    "index column": lambda t: "\n".join(
        f"{k - 1 if k else ''},{line}" for k, line in enumerate(text(t).splitlines())
    ).encode(),
    "bars": lambda t: text(t, "|").encode(),
    "title": lambda t: ("Recording of Monday\n\n" + text(t)).encode(),
    "spreadsheet's own first line": lambda t: ("sep=;\n" + text(t, ";")).encode(),
    "old line ends": lambda t: text(t).replace("\n", "\r").encode(),
    "lines between rows": lambda t: text(t).replace("\n", "\n\n# paused\n").encode(),
    "separator at the end": lambda t: text(t).replace("\n", ",\n").encode(),
}


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "robot.urdf"
    path.write_text(ARM)
    return path


def read_as_motion(file: Path, arm: Path) -> Table:
    motion = load_motion(file, load_robot(arm))
    return {"time": motion.time} | {f"q.{j}": motion.q[:, i] for i, j in enumerate(motion.joint_names)}


def read_as_log(file: Path, arm: Path) -> Table:
    (file.parent / "robot.urdf").write_text(ARM)
    header = {"schema": "excite.log/1", "robot": "robot.urdf", "base": "fixed", "rate_hz": 100}
    header |= {"joints": ["shoulder", "elbow"], "torque": "motor_side"}
    header |= {"trials": [{"file": file.name, "role": "identification"}]}
    (file.parent / "log.yaml").write_text(yaml.safe_dump(header))
    (trial,) = load_log(file.parent).trials
    found = {"time": trial.time}
    for k, joint in enumerate(("shoulder", "elbow")):
        found |= {f"q.{joint}": trial.q[:, k], f"tau.{joint}": trial.tau[:, k]}
    return found


def read_as_recording(file: Path, arm: Path) -> Table:
    (recording,) = read_source(file)
    (stream,) = recording.streams
    factors = {"ms": 1e-3, "deg": math.pi / 180.0, "mm": 1e-3}
    return {c.name: c.values * factors.get(c.unit, 1.0) for c in stream.columns}


def read_as_person(file: Path, arm: Path) -> Table:
    recording = read_recording(file)
    found = {"time": recording.time}
    found |= {f"{m}.{axis}": v[:, i] for m, v in recording.markers.items() for i, axis in enumerate("xyz")}
    (plate,) = recording.plates
    found |= {f"FP1.f{axis}": plate.force[:, i] for i, axis in enumerate("xyz")}
    return found | {f"FP1.m{axis}": plate.moment[:, i] for i, axis in enumerate("xyz")}


USERS = {
    "motion": (read_as_motion, MOTION),
    "log": (read_as_log, LOG),
    "recording": (read_as_recording, LOG),
    "person": (read_as_person, PERSON),
}


@pytest.mark.parametrize("packed", [False, True], ids=["", "packed"])
@pytest.mark.parametrize("dress", DRESSES)
@pytest.mark.parametrize("user", USERS)
def test_every_user_reads_every_dress(user, dress, packed, arm, tmp_path):
    read, table = USERS[user]
    content = DRESSES[dress](table)
    file = tmp_path / ("a.csv.gz" if packed else "a.csv")
    file.write_bytes(gzip.compress(content) if packed else content)
    found = read(file, arm)
    for name, values in table.items():
        np.testing.assert_allclose(
            found[name], values, atol=2e-9 * max(1.0, np.abs(values).max()), err_msg=name
        )


FAULTS = {
    "a row too short": (lambda t: text(t).encode().replace(b"\n", b"\n1,2\n", 2), "line .* has 2 fields for"),
    "a word": (
        lambda t: text(t).encode().replace(b"\n0.010000000", b"\nlate", 1),
        "not numeric|does not rise",
    ),
    "a name twice": (
        lambda t: text(t).replace("elbow", "shoulder").replace("LSHO", "RSHO").encode(),
        "stands twice",
    ),
    "nothing": (lambda t: b"", "cannot be read|no column time"),
    "another unit": (
        lambda t: with_units(t).replace("deg", "gon").replace("mm", "ell").encode(),
        "is in '(gon|ell)', a unit that is not known",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("user", ["motion", "log", "person"])
def test_what_is_wrong_is_refused_in_one_line_that_says_what(user, fault, arm, tmp_path):
    read, table = USERS[user]
    spoil, line = FAULTS[fault]
    file = tmp_path / "a.csv"
    file.write_bytes(spoil(table))
    with pytest.raises(ExciteError, match=line) as raised:
        read(file, arm)
    assert "a.csv" in str(raised.value) and "\n" not in str(raised.value)


def test_brackets_of_a_joints_own_name_are_no_unit(arm, tmp_path):
    robot = tmp_path / "arm.urdf"
    robot.write_text(ARM.replace("elbow", "elbow (m)"))
    table = {name.replace("elbow", "elbow (m)"): values for name, values in MOTION.items()}
    (tmp_path / "a.csv").write_text(text(table))
    motion = load_motion(tmp_path / "a.csv", load_robot(robot))
    np.testing.assert_allclose(
        motion.q[:, motion.joint_names.index("elbow (m)")], MOTION["q.elbow"], atol=1e-9
    )


def test_units_in_brackets_behind_names(arm, tmp_path):
    names, units, rows = with_units(LOG).split("\n", 2)
    pairs = zip(names.split(","), units.split(","), strict=True)
    (tmp_path / "a.csv").write_text(",".join(f"{name} [{unit}]" for name, unit in pairs) + "\n" + rows)
    for read, table in (USERS["log"], (read_as_motion, MOTION)):
        found = read(tmp_path / "a.csv", arm)
        for name, values in table.items():
            np.testing.assert_allclose(found[name], values, atol=1e-8)


def test_a_recording_that_was_cut_within_a_row_is_read_up_to_it(arm, tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes(text(LOG).encode()[:-25])
    found = read_as_recording(file, arm)
    for name, values in LOG.items():
        np.testing.assert_allclose(found[name], values[:-1], atol=1e-8)


@pytest.mark.parametrize(
    "content",
    [b"\xef\xbb\xbfa: 1\nb: x\n", b"a: 1\r\nb: x\r\n", b"a: 1\nb: x", b"# said\na: 1\nb: x\n"],
    ids=["byte order mark", "carriage returns", "no last line feed", "comment"],
)
def test_tables_of_limits_and_maps_in_their_dresses(content, tmp_path):
    (tmp_path / "map.yaml").write_bytes(content)
    assert read_yaml(tmp_path / "map.yaml") == {"a": 1, "b": "x"}


def test_a_map_in_utf_16_is_refused_with_the_reason(tmp_path):
    (tmp_path / "map.yaml").write_bytes("a: 1\n".encode("utf-16"))
    with pytest.raises(InputError, match=r"map\.yaml: is no UTF-8 text .*; save it as UTF-8"):
        read_yaml(tmp_path / "map.yaml")
