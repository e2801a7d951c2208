"""Whatever the bytes of a trial's file are, reading it gives columns or one InputError; what was written comes back."""

from __future__ import annotations

import bz2
import gzip
import lzma
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from excite.errors import InputError
from excite.formats.registry import FORMATS, format_of, read_content, read_contents, write_columns
from tests.corpus.practice import columns

SUFFIXES = tuple(reader.suffixes[0] for reader in FORMATS.values())
# Files of these are read in this process, where hundreds of examples take seconds.
HERE = tuple(reader.suffixes[0] for reader in FORMATS.values() if not reader.own_process)
MANY = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
# A change: where (as share of the file), what is done there, with which byte.
CHANGES = st.lists(
    st.tuples(
        st.floats(0.0, 1.0), st.sampled_from(["flip", "cut", "zero", "drop", "copy"]), st.integers(0, 255)
    ),
    min_size=1,
    max_size=6,
)
NAMES = st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1, max_size=8)
TABLES = st.integers(1, 40).flatmap(
    lambda rows: st.dictionaries(
        NAMES,
        arrays.arrays(np.float64, rows, elements=st.floats(allow_nan=False, allow_infinity=False, width=64)),
        min_size=1,
        max_size=5,
    )
)


def damaged(data: bytes, changes: list[tuple[float, str, int]]) -> bytes:
    for share, kind, byte in changes:
        at = int(share * max(len(data) - 1, 0))
        if kind == "flip":
            data = data[:at] + bytes([data[at] ^ (byte or 1)]) + data[at + 1 :] if data else data
        elif kind == "cut":
            data = data[:at]
        elif kind == "zero":
            data = data[:at] + bytes(len(data[at : at + byte])) + data[at + byte :]
        elif kind == "drop":
            data = data[:at] + data[at + byte :]
        else:
            data = data[:at] + data[:byte] + data[at + byte :]
    return data


def columns_or_error(path: Path) -> None:
    try:
        found = read_content(path).columns
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)
    else:
        assert all(isinstance(values, np.ndarray) for values in found.values())


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> dict[str, bytes]:
    """Bytes of a good file of each format."""
    folder = tmp_path_factory.mktemp("sound")
    made = {}
    for suffix in SUFFIXES:
        path = folder / f"a{suffix}"
        format_of(path).write(columns(), path)
        made[suffix] = path.read_bytes()
    return made


@pytest.mark.parametrize("suffix", HERE)
@MANY
@given(data=st.binary(max_size=2000))
def test_any_bytes(tmp_path, suffix, data):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(data)
    columns_or_error(path)


@pytest.mark.parametrize("suffix", HERE)
@MANY
@given(changes=CHANGES)
def test_damaged_files(tmp_path, sound, suffix, changes):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(damaged(sound[suffix], changes))
    columns_or_error(path)


def test_damaged_hdf5_is_named_among_others(tmp_path, sound):
    files = [tmp_path / f"{name}.h5" for name in "abc"]
    for file in files:
        file.write_bytes(sound[".h5"])
    files[1].write_bytes(sound[".h5"][:700] + bytes(300) + sound[".h5"][1000:])
    with pytest.raises(InputError, match=r"b\.h5"):
        list(read_contents(files))


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".csv"])
@MANY
@given(table=TABLES)
def test_what_was_written_comes_back_bit_for_bit(tmp_path, suffix, table):
    path = tmp_path / f"a{suffix}"
    format_of(path).write(table, path)
    found = read_content(path).columns
    assert list(found) == list(table)
    for name, values in table.items():
        # Text has no minus zero apart from zero.
        same = values + 0.0 if suffix == ".csv" else values
        read = np.asarray(found[name], dtype=float) + 0.0 if suffix == ".csv" else found[name]
        assert read.tobytes() == same.tobytes()


@pytest.mark.parametrize("suffix", [".csv.gz", ".csv.xz", ".parquet.bz2"])
def test_packed_trials_come_back(tmp_path, suffix):
    """Whoever packs them: here as ``write_columns``, and as Python's own modules would."""
    path = tmp_path / f"a{suffix}"
    write_columns(columns(), path)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    found = read_content(path).columns
    assert all((found[name] == values).all() for name, values in columns().items())
    module = {".gz": gzip, ".xz": lzma, ".bz2": bz2}[path.suffix]
    path.write_bytes(module.compress(module.decompress(path.read_bytes())))
    again = read_content(path).columns
    assert all((again[name] == values).all() for name, values in columns().items())


def test_a_packed_trial_leaves_one_of_the_plain_name_alone(tmp_path):
    plain = tmp_path / "a.csv"
    write_columns(columns(), plain)
    before = plain.read_bytes()
    write_columns({name: 2.0 * values for name, values in columns().items()}, tmp_path / "a.csv.gz")
    assert plain.read_bytes() == before


def test_hdf5_comes_back_bit_for_bit(tmp_path):
    path = tmp_path / "a.h5"
    format_of(path).write(columns(), path)
    found = read_content(path).columns
    assert all(found[name].tobytes() == values.tobytes() for name, values in columns().items())


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".h5"])
def test_a_changed_number_is_noticed(tmp_path, suffix):
    """Formats with check sums do not give numbers that nobody wrote."""
    rng = np.random.default_rng(0)
    table = {"time": rng.normal(size=4000)}
    path = tmp_path / f"a{suffix}"
    format_of(path).write(table, path)
    data = bytearray(path.read_bytes())
    for place in range(len(data) // 2, len(data) // 2 + 4):
        data[place] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError):
        read_content(path).columns


def test_memory_follows_what_a_file_says_before_it_is_read(tmp_path):
    """An archive that would unpack to gigabytes is refused in no time."""
    from tests.corpus.logs import CASES

    case = next(c for c in CASES if (c.family, c.name) == ("log: npz", "bomb"))
    case.build(tmp_path)
    with pytest.raises(InputError, match="more than the"):
        read_content(tmp_path / "one.npz").columns
