"""A document with one thing changed at a random place."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np


def deep(levels: int = 400) -> list:
    """Lists in lists."""
    found: list = []
    for _ in range(levels):
        found = [found]
    return found


VALUES: tuple[Any, ...] = (
    None,
    [],
    {},
    "x",
    "",
    "-",
    1e300,
    1e99,
    -1,
    -1e99,
    0,
    0.5,
    10**400,
    2**64,
    True,
    False,
    [1e99, -1e99],
    [None],
    {"x": 1},
    {"": None},
    "$\\frac",
    "$x_{$",
    "a" * 300_000,
    "b" * 250,
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "../../../etc/passwd",
    "/dev/zero",
    "\x00",
    "\x1b[31m",
    "\ud800",
    "名前 🤖",
    deep(),
    ["x"] * 30_000,
)
"""What a field may be changed to."""


def places(content: Any, path: tuple = ()) -> Iterator[tuple]:
    """Paths of everything inside a document."""
    items = content.items() if isinstance(content, dict) else enumerate(content)
    for key, value in items:
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


def mutated(content: Any, random: np.random.Generator) -> tuple[Any, str]:
    """A copy with one place changed, and what was done in words.

    Every kind of place is equally likely, however long the lists are that it stands in.
    """
    changed = copy.deepcopy(content)
    kinds: dict[tuple, list[tuple]] = {}
    for path in places(content):
        kinds.setdefault(tuple("*" if isinstance(key, int) else key for key in path), []).append(path)
    group = kinds[list(kinds)[int(random.integers(len(kinds)))]]
    path = group[int(random.integers(len(group)))]
    parent = changed
    for key in path[:-1]:
        parent = parent[key]
    way = int(random.integers(8))
    if way == 0:
        del parent[path[-1]]
        return changed, f"{path}: deleted"
    if way == 1 and isinstance(parent, dict):
        name = VALUES[int(random.integers(len(VALUES)))]
        name = name if isinstance(name, str) else str(name)[:80]
        parent[name] = parent.pop(path[-1])
        return changed, f"{path}: renamed {name[:40]!r}"
    if way == 2 and isinstance(parent, list):
        parent.append(copy.deepcopy(parent[path[-1]]))
        return changed, f"{path}: twice"
    value = VALUES[int(random.integers(len(VALUES)))]
    parent[path[-1]] = value
    return changed, f"{path}: {str(value)[:40]!r}"
