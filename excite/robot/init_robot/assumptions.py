"""What a first description assumes, in the words of ``assumed.yaml``."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from excite.formats.documents import read_yaml
from excite.results import Assumed


@cache
def _read_words() -> dict[str, dict[str, str]]:
    return read_yaml(Path(__file__).with_name("assumed.yaml"))


def assume(name: str, **values: Any) -> Assumed:
    """An assumption by its key in the file, with values in its places."""
    return Assumed(**{part: text.format(**values) for part, text in _read_words()[name].items()})
