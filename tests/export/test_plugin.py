"""A new format costs one file and its line in the registry: done here on a copy, as CONTRIBUTING says."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import excite

_PACKAGE = Path(excite.__file__).parent
_PLUGIN = """
from excite.atomic import write_text
from excite.export.exporter import Exporter


class TxtExporter(Exporter):
    name = "txt"
    suffix = ".txt"
    summary = "the number of samples"

    def write(self, motion, path):
        write_text(path, str(motion.n_samples))
"""


def test_a_new_format_is_one_file_and_its_line(tmp_path):
    shutil.copytree(_PACKAGE, tmp_path / "excite", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(_PACKAGE.parent / "robots", tmp_path / "robots")
    folder = tmp_path / "excite" / "export"
    (folder / "txt.py").write_text(_PLUGIN)
    registry = folder / "registry.py"
    text = registry.read_text()
    text = text.replace("        CsvExporter,\n", "        CsvExporter,\n        TxtExporter,\n")
    text = text.replace("\nEXPORTERS", "\nfrom excite.export.txt import TxtExporter\n\nEXPORTERS", 1)
    registry.write_text(text)
    run = subprocess.run(
        [sys.executable, "-m", "excite.cli.main", "export", "none.csv", "--format", "bad"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 4
    assert run.stderr.strip() == "excite: unknown format 'bad'; choose one of csv, npz, ros2, txt"
