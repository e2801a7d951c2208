"""Run the notebooks and store what their cells give: ``python docs/execute_notebooks.py [NAME…]``."""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
_SECONDS = 600
# What the kernel says of its own doings, different each time.
_ASIDE = ("execution", "ExecuteTime")


def execute(path: Path) -> None:
    """Run a notebook from top to bottom in a fresh kernel, and write it with its outputs."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=_SECONDS, resources={"metadata": {"path": str(path.parent)}}).execute()
    for cell in notebook.cells:
        for name in _ASIDE:
            cell.metadata.pop(name, None)
        if "outputs" in cell:
            cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
    notebook.metadata["language_info"] = {"name": "python"}
    nbformat.write(notebook, path)


if __name__ == "__main__":
    names = set(sys.argv[1:])
    for file in sorted(FOLDER.glob("*.ipynb")):
        if not names or file.stem in names:
            execute(file)
            sys.stdout.write(f"{file}\n")
