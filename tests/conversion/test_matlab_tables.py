"""Tables and timetables in a ``.mat`` of version 7, written byte by byte as MATLAB does."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import excite
from tests.conversion.test_habits import check
from tests.conversion.written import RATE, WHOLE

_INT8, _UINT8, _INT32, _UINT32, _MATRIX = 1, 2, 5, 6, 14
_CELL, _STRUCT, _BYTES, _OPAQUE = 1, 2, 9, 17


def _element(kind: int, payload: bytes) -> bytes:
    return struct.pack("<II", kind, len(payload)) + payload + b"\0" * (-len(payload) % 8)


def _array(values: object, name: str = "x") -> bytes:
    """As scipy writes it, without the file's header."""
    file = io.BytesIO()
    savemat(file, {name: values})
    return file.getvalue()[128:]


def _object(reference: bytes, cls: str, name: str = "") -> bytes:
    words = [_element(_INT8, word.encode()) for word in (name, "MCOS", cls)]
    return _element(_MATRIX, _element(_UINT32, struct.pack("<II", _OPAQUE, 0)) + b"".join(words) + reference)


def _struct(fields: dict[str, bytes], name: str = "") -> bytes:
    head = _element(_UINT32, struct.pack("<II", _STRUCT, 0)) + _element(_INT32, struct.pack("<ii", 1, 1))
    names = b"".join(field.encode().ljust(32, b"\0") for field in fields)
    head += _element(_INT8, name.encode()) + struct.pack("<HHi", _INT32, 4, 32) + _element(_INT8, names)
    return _element(_MATRIX, head + b"".join(fields.values()))


def _number(object_number: int) -> bytes:
    return _array(np.array([[0xDD000000], [2], [1], [1], [object_number], [1]], dtype=np.uint32))


def _cells(members: list[bytes]) -> bytes:
    """A cell array of elements: that of numbers, with these in their place."""
    count = len(members)
    head = _element(_UINT32, struct.pack("<II", _CELL, 0)) + _element(_INT32, struct.pack("<ii", count, 1))
    return _element(_MATRIX, head + _element(_INT8, b"") + b"".join(members))


def _described(objects: list[dict[str, int]]) -> np.ndarray:
    """Which cell is which property of which object, as MATLAB packs it."""
    names = list(dict.fromkeys(name for held in objects for name in held))
    text = b"".join(name.encode() + b"\0" for name in names)
    text += b"\0" * (-len(text) % 8)
    classes = [0, 0, 0, 0, 0, 1, 0, 0]
    listed, numbered = [0, 0], [0] * 6
    for number, held in enumerate(objects, start=1):
        listed.append(len(held))
        for name, cell in held.items():
            listed += [names.index(name) + 1, 1, cell]
        listed += [0] * (len(listed) % 2)
        numbered += [1, 0, 0, 0, number, number]
    regions = [classes, [0, 0], numbered, listed]
    ends = 40 + len(text) + 4 * np.cumsum([0, *(len(region) for region in regions)])
    words = [4, len(names), *ends.tolist(), 0, 0, 0]
    packed = (
        struct.pack("<10I", *words)
        + text
        + struct.pack(f"<{sum(map(len, regions))}I", *(word for region in regions for word in region))
    )
    return np.frombuffer(packed, dtype=np.uint8)[:, None]


def _write(path: Path, variables: dict[str, str], objects: list[dict[str, int]], values: list[bytes]) -> Path:
    """A file of objects by their classes, the first ones of those described, with their values by cell."""
    inside = _cells([_array(_described(objects)), _array(np.zeros((0, 0))), *values])
    workspace = b"\0\1IM\0\0\0\0" + _struct({"MCOS": _object(inside, "FileWrapper__")})
    file = io.BytesIO()
    savemat(file, {})
    made = file.getvalue()[:128]
    for number, (name, cls) in enumerate(variables.items(), start=1):
        made += _object(_number(number), cls, name)
    head = _element(_UINT32, struct.pack("<II", _BYTES, 0)) + _element(
        _INT32, struct.pack("<ii", 1, len(workspace))
    )
    path.write_bytes(made + _element(_MATRIX, head + _element(_INT8, b"") + _element(_UINT8, workspace)))
    return path


def _columns(data: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"{name}{k + 1}": data[name][:, k : k + 1] for name in ("q", "tau") for k in range(3)}


def _cell(members: list[object]) -> np.ndarray:
    found = np.empty((1, len(members)), dtype=object)
    found[0, :] = members
    return found


def test_two_tables(data, arm, tmp_path):
    columns = {"t": data["time"][:, None]} | _columns(data)
    values = [_array(_cell([*columns.values()])), _array(_cell([*columns]))]
    held = {"data": 0, "varnames": 1}
    path = _write(tmp_path / "runs.mat", {"first": "table", "second": "table"}, [held, held], values)
    found = excite.convert([path], arm, tmp_path / "log", WHOLE)
    assert {name for name, _, _ in found.trials} == {"first", "second"}
    check(found, data, "q", "tau")


@pytest.mark.parametrize("even", [False, True])
def test_a_timetable_whose_rows_have_durations_or_a_step(data, arm, tmp_path, even):
    columns = _columns(data)
    times = _object(_number(2), "duration")
    if even:
        times = _struct(
            {"origin": times, "stepSize": _object(_number(3), "duration"), "sampleRate": _array(np.nan)}
        )
    inside = {
        "data": _array(_cell([*columns.values()])),
        "varNames": _array(_cell([*columns])),
        "numRows": _array(float(len(data["time"]))),
        "rowTimes": times,
    }
    stamps = np.zeros((1, 1)) if even else 1e3 * data["time"][:, None]
    objects = [{"any": 0}, {"millis": 1}, {"millis": 2}]
    values = [_struct(inside), _array(stamps), _array(10.0)]
    path = _write(tmp_path / "run.mat", {"run": "timetable"}, objects, values)
    found = excite.convert([path], arm, tmp_path / "log", WHOLE)
    assert found.log.header.rate_hz == pytest.approx(RATE)
    check(found, data, "q", "tau")
