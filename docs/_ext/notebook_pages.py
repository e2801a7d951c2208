"""Pages of the notebooks, of what is stored in them: text, code, and what the code gave when it was last run."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[2] / "notebooks"


def notebook_pages(folder: Path) -> dict[str, str]:
    """Markdown by name of the notebook; figures are written into ``folder``, named after what is in them."""
    return {path.stem: "\n".join(_page(path, folder)) for path in sorted(FOLDER.glob("*.ipynb"))}


def _page(path: Path, folder: Path) -> Iterator[str]:
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"]):
        text = "".join(cell["source"]).strip()
        if cell["cell_type"] == "markdown":
            yield f"{text}\n"
            if number == 0:
                yield f"The notebook itself is `notebooks/{path.name}`.\n"
        elif cell["cell_type"] == "code" and text:
            yield f"```python\n{text}\n```\n"
            for output in cell["outputs"]:
                yield from _output(output, folder)


def _output(output: dict[str, Any], folder: Path) -> Iterator[str]:
    """What a cell gave: a picture, else a table, else text."""
    data = output.get("data", {})
    if "image/png" in data:
        content = base64.b64decode("".join(data["image/png"]))
        name = f"{hashlib.sha256(content).hexdigest()[:16]}.png"
        if not (folder / name).is_file():
            (folder / name).write_bytes(content)
        yield f"![What the cell drew]({name})\n"
    elif "text/html" in data:
        yield "```{raw} html\n" + "".join(data["text/html"]).strip() + "\n```\n"
    else:
        said = "".join(data.get("text/plain", output.get("text", ""))).rstrip()
        if said:
            yield f"```text\n{said}\n```\n"
