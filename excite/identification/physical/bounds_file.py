"""Files of bounds of physical parameters, ``excite.physical_bounds/1``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from excite.errors import InputError
from excite.identification.physical.bounds import InertiaRules, PhysicalBounds
from excite.identification.physical.coordinates import NAMES

SCHEMA = "excite.physical_bounds/1"
_AXES = ("x", "y", "z")


def load_physical_bounds(path: str | Path, links: tuple[str, ...]) -> PhysicalBounds:
    """Read bounds from a file ``excite.physical_bounds/1``.

    Args:
        path: the YAML file; ``robots/iiwa14/physical_bounds.yaml`` is an example.
        links: links of the robot's segments, in its order; each needs all ten bounds.

    Raises:
        InputError: the file is malformed, a link is missing or unknown, or a bound is empty.
    """
    path = Path(path)
    document = _document(path)
    parameters = document["parameters"]
    lower, upper = np.zeros((len(links), 10)), np.zeros((len(links), 10))
    wanted = {f"{link}.{name}": (i, j) for i, link in enumerate(links) for j, name in enumerate(NAMES)}
    for name in wanted:
        if name not in parameters:
            raise InputError(
                "has no bounds", source=path, field=name, remedy="bound every parameter of every link"
            )
    drives: dict[str, tuple[float, float]] = {}
    for name, entry in parameters.items():
        low, high = _pair(path, name, entry.get("bounds") if isinstance(entry, dict) else entry)
        if name in wanted:
            lower[wanted[name]], upper[wanted[name]] = low, high
        elif name.split(".")[-1] in NAMES:
            raise InputError(
                "is of no link of the robot", source=path, field=name, remedy="links are " + ", ".join(links)
            )
        else:
            drives[name] = (low, high)
    total = _pair(path, "total_mass", document.get("total_mass", [lower[:, 0].sum(), upper[:, 0].sum()]))
    return PhysicalBounds(
        links,
        lower,
        upper,
        drives,
        total,
        _rules(path, document.get("rules") or {}),
        str(document.get("source", path)),
    )


def load_physical_values(path: str | Path, column: str) -> dict[str, float]:
    """One column of values of a bounds file, by parameter name (published solutions, for example).

    Raises:
        InputError: the file is malformed, or a parameter has no such value.
    """
    values: dict[str, float] = {}
    for name, entry in _document(Path(path))["parameters"].items():
        if not isinstance(entry, dict) or column not in entry:
            raise InputError(f"has no value {column!r}", source=path, field=name)
        values[name] = float(entry[column])
    return values


def _document(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", source=path) from error
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError("is no YAML", source=path, remedy=str(error).splitlines()[0]) from error
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(
            "is not a bounds file", source=path, field="schema", remedy=f"start it with schema: {SCHEMA}"
        )
    if not isinstance(document.get("parameters"), dict):
        raise InputError("is missing", source=path, field="parameters")
    return document


def _pair(path: Path, name: str, value: Any) -> tuple[float, float]:
    numbers = (
        isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, int | float) for v in value)
    )
    if not numbers:
        raise InputError(f"has bounds {value!r}", source=path, field=name, remedy="write [lower, upper]")
    return float(value[0]), float(value[1])


def _rules(path: Path, block: dict[str, Any]) -> InertiaRules:
    known = {"diagonal_ratio", "off_diagonal_share", "slenderness", "slender", "principal_triangle"}
    for key in block:
        if key not in known:
            raise InputError(
                "is unknown", source=path, field=f"rules.{key}", remedy="choose " + ", ".join(sorted(known))
            )
    slender = {}
    for link, axis in (block.get("slender") or {}).items():
        if axis not in _AXES:
            raise InputError(
                f"is {axis!r}", source=path, field=f"rules.slender.{link}", remedy="choose x, y or z"
            )
        slender[link] = _AXES.index(axis)
    return InertiaRules(**{**block, "slender": slender})
