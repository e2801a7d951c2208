"""Pages that are written from the program itself while the manual is built, so that they cannot be out of date."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from command_pages import commands_page
from field_pages import fields_page
from notebook_pages import notebook_pages
from registry_pages import names_page

PAGES = {"commands": commands_page, "names": names_page, "fields": fields_page}


def write_pages(app: Any) -> None:
    """Write the pages into folders ``generated``; a page that would be the same is left alone."""
    for part, pages in (
        ("reference", lambda folder: {name: page() for name, page in PAGES.items()}),
        ("tutorials", notebook_pages),
    ):
        folder = Path(app.srcdir) / part / "generated"
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in pages(folder).items():
            path = folder / f"{name}.md"
            if not path.is_file() or path.read_text(encoding="utf-8") != text:
                path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
