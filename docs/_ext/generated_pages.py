"""Pages that are written from the program itself while the manual is built, so that they cannot be out of date."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from command_pages import commands_page
from registry_pages import names_page

PAGES = {"commands": commands_page, "names": names_page}


def write_pages(app: Any) -> None:
    """Write the pages into ``reference/generated``; a page that would be the same is left alone."""
    folder = Path(app.srcdir) / "reference" / "generated"
    folder.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        path, text = folder / f"{name}.md", page()
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
