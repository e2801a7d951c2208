"""Motions of the package's own formats that do not say which format they are of."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from excite.formats.arrays import STATEMENT
from tests.corpus.case import Case
from tests.corpus.practice import columns
from tests.logs.conftest import ARM


def _motion(name: str, said: Any) -> Callable[[Path], list[str]]:
    """``check`` of a motion whose metadata are these."""

    def build(folder: Path) -> list[str]:
        path, text = folder / name, json.dumps(said)
        (folder / "robot.urdf").write_text(ARM)
        found = {key: values for key, values in columns().items() if not key.startswith("tau.")}
        if path.suffix == ".npz":
            np.savez(path, allow_pickle=False, **{STATEMENT: np.array(text)}, **found)
        else:
            table = pa.table({key: pa.array(values) for key, values in found.items()})
            pa.parquet.write_table(table.replace_schema_metadata({"excite": text}), path)
        return ["check", str(folder / "robot.urdf"), str(path)]

    return build


CASES: tuple[Case, ...] = tuple(
    Case("motion metadata", f"{what} in {suffix}", _motion(f"motion.{suffix}", said), line)
    for what, said, line in (
        ("nothing", {}, "schema: states no schema"),
        ("a robot alone", {"robot": "small"}, "schema: states no schema"),
        ("null", {"schema": None, "generator": "mine"}, "schema: states no schema"),
        ("another schema", {"schema": "excite.log/1"}, "schema is 'excite.log/1'"),
        ("a list", [], "is no JSON object"),
    )
    for suffix in ("npz", "parquet")
)
