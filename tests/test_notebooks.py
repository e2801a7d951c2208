"""Every notebook runs from top to bottom in a fresh kernel, and is stored with what it gave."""

from __future__ import annotations

import ast
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

_FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
NOTEBOOKS = sorted(_FOLDER.glob("*.ipynb"))
_SECONDS = 180  # for a busy machine; on an idle one each takes less than a minute


def test_there_are_notebooks():
    tutorials = {"first_motion", "humanoid_campaign", "arm_to_simulator", "excitation_quality"}
    assert tutorials | {"gap_of_a_real_arm", "person"} <= {path.stem for path in NOTEBOOKS}


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.battery] if k else []) for k, path in enumerate(NOTEBOOKS)],
    ids=[path.stem for path in NOTEBOOKS],
)
def test_notebook_runs(path, tmp_path):
    options = ["--nbmake", f"--nbmake-timeout={_SECONDS}", "-p", "no:cacheprovider", "-p", "no:xdist", "-q"]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(_FOLDER.parent), os.environ.get("PYTHONPATH", "")]),
        "OPENBLAS_NUM_THREADS": "1",
        "IPYTHONDIR": str(tmp_path),
    }
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, "-c", os.devnull, str(path)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=_SECONDS + 60,
    )
    assert run.returncode == 0, run.stdout[-4000:] + run.stderr[-2000:]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_imports_is_there(path):
    cells = [c for c in json.loads(path.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    for node in ast.walk(ast.parse("\n".join("".join(cell["source"]) for cell in cells))):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("excite"):
            module = importlib.import_module(str(node.module))
            assert not [name.name for name in node.names if not hasattr(module, name.name)], node.module


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_stored_with_what_its_cells_gave(path):
    """Run once from top to bottom (`python docs/execute_notebooks.py`), without an error, and small enough to keep."""
    cells = [c for c in json.loads(path.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert len(outputs) >= len(cells) // 2
    assert not [one for one in outputs if one["output_type"] == "error" or one.get("name") == "stderr"]
    assert path.stat().st_size < 2_000_000
