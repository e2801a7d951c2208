"""Which scripts are on a page: its own, of which it says so, and data; anything else is strange."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from importlib.resources import files


class _Scripts(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[dict[str, str | None], str]] = []
        self.policy = ""
        self._inside = False

    def handle_starttag(self, tag, attrs):
        said = dict(attrs)
        if tag == "meta" and said.get("http-equiv") == "Content-Security-Policy":
            self.policy = said["content"] or ""
        self._inside = tag == "script"
        if self._inside:
            self.found.append((said, ""))

    def handle_endtag(self, tag):
        self._inside = False

    def handle_data(self, data):
        if self._inside:
            self.found[-1] = (self.found[-1][0], self.found[-1][1] + data)


def _parsed(page: str) -> _Scripts:
    parser = _Scripts()
    parser.feed(page)
    return parser


def islands(page: str) -> dict[str, object]:
    """By id, the data that a page holds for its scripts."""
    return {
        str(said["id"]): json.loads(text)
        for said, text in _parsed(page).found
        if said.get("type") == "application/json"
    }


def strange_scripts(page: str) -> list[str]:
    """Scripts that are neither data nor files of the package, or that the page's policy does not allow."""
    parsed = _parsed(page)
    folder = files("excite.report") / "assets"
    own = {item.read_text(encoding="utf-8").strip() for item in folder.iterdir() if item.name.endswith(".js")}
    islands(page)
    strange = []
    for said, text in parsed.found:
        if said.get("type") == "application/json":
            continue
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        if said or text not in own or f"'sha256-{digest}'" not in parsed.policy:
            strange.append(text[:200])
    return strange


def without_scripts(page: str) -> str:
    """The page less its scripts and data."""
    return re.sub(r"<script\b.*?</script>", "", page, flags=re.DOTALL)
