"""YAML files as mappings, without what a loader would swallow or never get through.

YAML lets a file of a kilobyte stand for gigabytes (aliases of aliases), lets a key stand twice and keeps the last,
and has a number that is none. Each of these is refused before anything is built from the file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from excite.errors import InputError
from excite.reading.file import MAX_DESCRIPTION_BYTES, read_text

# A robot.yaml of a humanoid has 2 500 nodes, 8 deep; a log.yaml of 1000 trials 12 000.
MAX_NODES = 200_000
MAX_DEPTH = 40

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


# One that knows angles tagged so, as files of UR's robots hold them.
_AngleLoader: Any = type("_AngleLoader", (_Loader,), {})
_AngleLoader.add_constructor("!degrees", lambda loader, node: math.radians(float(node.value)))
_AngleLoader.add_constructor("!radians", lambda loader, node: float(node.value))


def read_yaml(
    path: str | Path,
    *,
    error: type[InputError] = InputError,
    remedy: str = "",
    limit: int = MAX_DESCRIPTION_BYTES,
    most_nodes: int = MAX_NODES,
    degrees: bool = False,
    sections: bool = False,
) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Args:
        path: of the file.
        error: class of the errors.
        remedy: what to do where it is no mapping at all.
        limit: largest size [bytes].
        most_nodes: how many values it may stand for.
        degrees: whether angles may be tagged ``!degrees`` (read as radians) or ``!radians``.
        sections: whether a mapping or list at the top may stand in parts, ``columns: {…}`` a line each, which are then
            one.

    Raises:
        InputError: of the class ``error``: the file cannot be read, is no YAML or no mapping, nests or repeats itself
            without end, holds a key twice, or a number that is none.
    """
    path = Path(path)
    text = read_text(path, limit=limit, error=error)
    try:
        root = _compose_nodes(text, path, error, most_nodes)
        if root is not None:
            if sections and isinstance(root, yaml.MappingNode):
                _join_sections(root)
            _check_nodes(root, path, error, most_nodes)
        content = (
            None if root is None else (_AngleLoader if degrees else _Loader)("").construct_document(root)
        )
    except yaml.YAMLError as reason:
        line = " ".join(str(reason).split())
        raise error(f"is not valid YAML ({line[:200]})", source=path, remedy="mend the syntax") from reason
    except (ValueError, TypeError, OverflowError) as reason:
        # Dates such as 2024-13-45 and numbers of thousands of digits.
        line = " ".join(str(reason).split())
        raise error(
            f"holds a value that cannot be read ({line[:120]})", source=path, remedy="mend it"
        ) from reason
    if not isinstance(content, dict):
        raise error("is not a mapping", source=path, remedy=remedy or "write names and values, `name: value`")
    return content


def _compose_nodes(text: str, path: Path, error: type[InputError], most_nodes: int) -> yaml.Node | None:
    """The nodes of the text, after its depth and length were found to be within bounds."""
    depth = nodes = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        nodes += isinstance(event, yaml.NodeEvent)
        if depth > MAX_DEPTH:
            raise error(f"is nested more than {MAX_DEPTH} deep", source=path, remedy="flatten it")
        if nodes > most_nodes:
            raise _too_many(path, error, most_nodes)
    return yaml.compose(text, Loader=_Loader)


def _join_sections(root: yaml.MappingNode) -> None:
    """Make one of the mappings, or of the lists, that stand under the same key at the top."""
    first: dict[str, yaml.Node] = {}
    left = []
    for key, value in root.value:
        name = str(key.value)
        same = first.setdefault(name, value)
        if same is not value and isinstance(value, yaml.CollectionNode) and type(same) is type(value):
            same.value += value.value
        else:
            left.append((key, value))
    root.value = left


def _check_nodes(root: yaml.Node, path: Path, error: type[InputError], most_nodes: int) -> None:
    """Refuse keys that stand twice, values that are no numbers, and aliases that multiply."""
    sizes: dict[int, int] = {}
    _count_expanded(root, (), sizes, frozenset(), path, error)
    if max(sizes.values()) > most_nodes:
        raise _too_many(path, error, most_nodes)


def _count_expanded(
    node: yaml.Node,
    place: tuple[str, ...],
    sizes: dict[int, int],
    above: frozenset[int],
    path: Path,
    error: type[InputError],
) -> int:
    """Number of nodes that a node stands for once aliases are written out."""
    if id(node) in above:
        raise error("contains itself", source=path, field=".".join(place), remedy="remove the alias")
    if id(node) in sizes:
        return sizes[id(node)]
    size, above = 1, above | {id(node)}
    if isinstance(node, yaml.MappingNode):
        _check_keys(node, place, path, error)
        for key, value in node.value:
            size += _count_expanded(value, (*place, str(key.value)), sizes, above, path, error)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            size += _count_expanded(value, (*place, str(index)), sizes, above, path, error)
    elif node.tag == "tag:yaml.org,2002:float" and _is_nan(node.value):
        raise error(f"is {node.value}", source=path, field=".".join(place), remedy="give a number")
    sizes[id(node)] = size
    return size


def _check_keys(node: yaml.MappingNode, place: tuple[str, ...], path: Path, error: type[InputError]) -> None:
    seen: set[str] = set()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise error("has a key that is no name", source=path, field=".".join(place), remedy="name it")
        if key.value in seen and key.value != "<<":
            raise error(
                f"stands twice, again in line {key.start_mark.line + 1}",
                source=path,
                field=".".join((*place, str(key.value))),
                remedy="keep one of them",
            )
        seen.add(key.value)


def _is_nan(text: str) -> bool:
    return text.lower().strip("+-.") == "nan" or (text.isascii() and _nan(text))


def _nan(text: str) -> bool:
    try:
        return math.isnan(float(text))
    except ValueError:
        return False


def _too_many(path: Path, error: type[InputError], most_nodes: int) -> InputError:
    return error(
        f"stands for more than {most_nodes} values", source=path, remedy="remove repetitions and aliases"
    )
