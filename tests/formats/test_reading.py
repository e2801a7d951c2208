"""Files that people hand over: what is out of bounds is one line before any reader trusts it."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from excite.errors import ExciteError, InputError, RobotError
from excite.formats.child import in_child
from excite.formats.documents import read_json, read_xml, read_yaml
from excite.formats.file import read_bytes, read_text
from excite.formats.matlab import read_mat

BOMB = "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(['*' + chr(97 + i)] * 10)}]\n" for i in range(8)
)
YAML = {
    BOMB: "stands for more than 200000 values",
    "a: 1\nb: {c: 1, c: 2}\n": "b.c: stands twice, again in line 2",
    "a: {g: [0, .nan, 1]}": "a.g.1: is .nan",
    "a: " + "[" * 5000 + "]" * 5000: "nested more than 40 deep",
    "a: &a [*a]": "a.0: contains itself",
    "- 1": "is not a mapping",
    "": "is not a mapping",
    "a: 2024-13-45": "cannot be read",
    "a: !!python/object/apply:os.system ['ls']": "is not valid YAML",
    "a: *b": "undefined alias",
    "[1, 2]: 3": "has a key that is no name",
}
JSON = {
    '{"a": 1, "a": 2}': "'a' stands twice",
    '{"a": NaN}': "NaN is no number",
    "[" * 100_000: "nested too deep",
    "[1]": "is no JSON object",
    '{"schema": "other"}': "schema is 'other', not 'x/1'",
    "{": "is no JSON",
}
XML = {
    "<a>" * 1000: "nested more than 200 deep",
    "<a " + " ".join(f'b{i}="1"' for i in range(1000)) + "/>": "has 1000 attributes",
    "<a>" + "<b/>" * 300_000 + "</a>": "more than 200000 elements",
    '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>': "declares XML entities",
    "": "is not valid XML",
    '<a b="1" b="2"/>': "duplicate attribute",
}


def refused(reader, path: Path, text: str, **options) -> str:
    path.write_text(text)
    started = time.monotonic()
    with pytest.raises(InputError) as caught:
        reader(path, **options)
    assert time.monotonic() - started < 10.0
    assert "\n" not in str(caught.value) and str(path) in str(caught.value) and caught.value.remedy
    return str(caught.value)


@pytest.mark.parametrize(("text", "line"), YAML.items(), ids=list(YAML.values()))
def test_yaml_out_of_bounds_is_one_line(text: str, line: str, tmp_path: Path) -> None:
    assert line in refused(read_yaml, tmp_path / "robot.yaml", text)


@pytest.mark.parametrize(("text", "line"), JSON.items(), ids=list(JSON.values()))
def test_json_out_of_bounds_is_one_line(text: str, line: str, tmp_path: Path) -> None:
    assert line in refused(read_json, tmp_path / "plan.json", text, schema="x/1")


@pytest.mark.parametrize(("text", "line"), XML.items(), ids=list(XML.values()))
def test_xml_out_of_bounds_is_one_line(text: str, line: str, tmp_path: Path) -> None:
    assert line in refused(read_xml, tmp_path / "robot.urdf", text)


def test_aliases_and_merged_keys_within_bounds_are_read(tmp_path: Path) -> None:
    text = "x: &d {q: 1}\ny: {<<: *d, z: 2}\nu: [*d, *d]\n"
    (tmp_path / "a.yaml").write_text(text)
    assert read_yaml(tmp_path / "a.yaml") == yaml.safe_load(text)


def test_only_regular_files_of_sane_size_are_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "huge").open("wb") as huge:
        huge.truncate(1 << 40)
    (tmp_path / "latin").write_bytes(b"caf\xe9")
    cases = {
        tmp_path / "pipe": "is a pipe",
        Path("/dev/zero"): "is a device",
        tmp_path: "is a folder",
        tmp_path / "huge": "has 1099511627776 bytes",
        tmp_path / "missing": "no such file",
        tmp_path / ("x" * 300): "name too long",
        Path("a\0b"): "has a name that no file can have",
        tmp_path / "huge" / "inside": "no such file",
        tmp_path / "latin": "is no UTF-8 text",
    }
    for path, line in cases.items():
        with pytest.raises(InputError, match=line):
            read_text(path)
    (tmp_path / "marked").write_bytes(b"\xef\xbb\xbfname: x")
    assert read_text(tmp_path / "marked") == "name: x"


def test_a_file_above_its_limit_is_refused_and_one_at_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert read_bytes(tmp_path / "a", limit=5) == b"12345"
    with pytest.raises(ExciteError, match="has 5 bytes, more than the 4"):
        read_bytes(tmp_path / "a", limit=4)


def test_a_native_reader_that_crashes_hangs_or_eats_memory_is_one_line(tmp_path: Path) -> None:
    assert in_child("operator:add", 1, 2, source=tmp_path) == 3
    # A processor that others keep busy is no reader without an end.
    assert in_child("time:sleep", 1.2, source=tmp_path, seconds=0.5) is None
    for call, line in (
        ((("os:abort",), {}), "SIGABRT"),
        ((("time:sleep", 30), {"seconds": 1.0}), "more than 1 s"),
        ((("numpy:ones", 1 << 33), {"memory_gb": 1.0}), "fail"),
        ((("sys:exit", 3), {}), "fail"),
    ):
        with pytest.raises(InputError, match=line):
            in_child(*call[0], source=tmp_path, **call[1])


def test_what_the_reader_itself_refuses_arrives_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text("<robot/>")
    with pytest.raises(RobotError) as caught:
        in_child("excite.robot.urdf.reading:read_urdf", tmp_path / "a.urdf", source=tmp_path)
    assert caught.value.source == tmp_path / "a.urdf" and caught.value.remedy


@settings(max_examples=300, deadline=None)
@given(
    content=st.one_of(
        st.binary(max_size=400),
        st.text(max_size=400).map(str.encode),
        st.from_regex(r"[\[\]{}:,&*\-\n a-c\"'<>!|]{0,60}").map(str.encode),
    )
)
def test_whatever_is_in_a_file_it_is_read_or_refused(
    content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "anything"
    path.write_bytes(content)
    for reader in (read_yaml, read_json, read_xml):
        try:
            reader(path)
        except InputError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("name", "command"),
    [("log.yaml", "excite convert"), ("plan.json", "excite plan"), ("robot.yaml", "excite init-robot")],
)
def test_what_a_folder_lacks_is_named_with_what_makes_it(name: str, command: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"no such file; {command}"):
        read_text(tmp_path / name)
    with pytest.raises(InputError, match="check the path"):
        read_text(tmp_path / "nowhere" / name)


def test_objects_of_matlab_alone_are_one_line(tmp_path: Path) -> None:
    """As ``save run.mat t`` of a table leaves them: what they hold stands in a variable without a name."""
    file = io.BytesIO()
    savemat(file, {"x": np.zeros((1, 8), np.uint8)})
    path = tmp_path / "run.mat"
    path.write_bytes(file.getvalue().replace(b"\1\0\1\0x\0\0\0", b"\1\0\0\0\0\0\0\0"))
    with pytest.raises(InputError, match=r"run\.mat: holds objects of MATLAB alone.*table2struct"):
        read_mat(path)
