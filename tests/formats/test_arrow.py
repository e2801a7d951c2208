"""Columns to Arrow and back, and that neither way loads pandas."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pyarrow as pa

from excite.formats.arrow import arrow_table, numpy_columns

COLUMNS = {
    "time": np.arange(5) / 200.0,
    "single": np.linspace(0.0, 1.0, 5, dtype=np.float32),
    "every other": np.arange(10.0)[::2],
    "count": np.arange(5, dtype=np.int8),
    "touches": np.arange(5) % 2 == 0,
    "missing": np.array([1.0, np.nan, 3.0, np.nan, 5.0]),
    "name": np.array(["a", "b", "c", "d", "e"]),
}


def test_columns_come_back_with_their_types():
    found = numpy_columns(arrow_table(COLUMNS))
    assert list(found) == list(COLUMNS)
    for name, column in COLUMNS.items():
        np.testing.assert_array_equal(found[name], column)
        assert found[name].dtype == column.dtype or column.dtype.kind == "U"


def test_a_table_is_arrows_own():
    table, expected = arrow_table(COLUMNS), pa.table(COLUMNS)
    assert table.schema == expected.schema
    assert table.drop_columns("missing") == expected.drop_columns("missing")


def test_gaps_and_chunks_are_read():
    table = pa.concat_tables([pa.table({"x": [1.0, None], "n": [1, 2]}), pa.table({"x": [3.0], "n": [3]})])
    found = numpy_columns(table)
    np.testing.assert_array_equal(found["x"], [1.0, np.nan, 3.0])
    np.testing.assert_array_equal(found["n"], [1, 2, 3])


def test_numbers_load_no_pandas(tmp_path):
    code = (
        "import sys, pathlib, numpy as np, pyarrow as pa, pyarrow.parquet\n"
        "from excite.formats.arrow import arrow_table, numpy_columns, read_parquet\n"
        f"path = pathlib.Path({str(tmp_path / 'x.parquet')!r})\n"
        "pa.parquet.write_table(arrow_table({'x': np.ones(3)}), path)\n"
        "assert numpy_columns(read_parquet(path))['x'].sum() == 3.0\n"
        "sys.exit('pandas' in sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
