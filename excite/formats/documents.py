"""Structured text files read strictly: JSON, YAML and XML, within bounds of size, depth and count."""

from __future__ import annotations

import json
import math
import re
import reprlib
from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Any, TypeVar
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, canonicalize, tostring
from xml.parsers.expat import errors as expat_errors

import yaml
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser
from pydantic import BaseModel, ValidationError

from excite.errors import InputError, in_one_line
from excite.finding import list_names
from excite.formats.file import MAX_DESCRIPTION_BYTES, MAX_TEXT_BYTES, read_bytes, read_text

# JSON files as objects, strictly: what a document says twice, or says in numbers that are none, is refused.


# Errors whose input says nothing: the object around a field, or one that the sentence names.
_SAID_ALREADY = frozenset({"value_error", "too_long"})
_KINDS = {
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "an object"),
    "list_type": "a list",
    "float_type": "a number",
    "finite_number": "a finite number",
    **dict.fromkeys(("int_type", "int_from_float"), "a whole number"),
    "bool_type": "true or false",
    "string_type": "text",
    "string_unicode": "text that UTF-8 can hold",
    "string_pattern_mismatch": "text that can be shown",
}

_Model = TypeVar("_Model", bound=BaseModel)


class _Refused(ValueError):
    """Something that JSON allows and that no document here holds."""


def read_json(
    path: str | Path,
    *,
    schema: str | None = None,
    remedy: str = "write it again",
) -> dict[str, Any]:
    """The object that a JSON file holds.

    Args:
        schema: what its field ``schema`` has to be; None where it has none.
        remedy: what to do where the file is wrong.

    Raises:
        InputError: the file cannot be read, is no JSON or no object, holds a key twice or NaN,
            or its schema is another.
    """
    path = Path(path)
    text = read_text(path, limit=MAX_TEXT_BYTES)
    try:
        content = parse_json(text)
    except RecursionError as reason:
        raise InputError("is nested too deep", source=path, remedy=remedy) from reason
    except ValueError as reason:
        raise InputError(f"is no JSON ({in_one_line(reason)[:160]})", source=path, remedy=remedy) from reason
    if not isinstance(content, dict):
        raise InputError("is no JSON object", source=path, remedy=remedy)
    if schema is not None and content.get("schema") != schema:
        found = repr(content.get("schema"))[:60]
        raise InputError(f"schema is {found}, not {schema!r}", source=path, field="schema", remedy=remedy)
    return content


def parse_json(text: str) -> Any:
    """What a JSON text says; raises ValueError, also for a key that stands twice and for NaN, or RecursionError."""
    return json.loads(text, object_pairs_hook=_build_object, parse_constant=_refuse_constant)


def check_content(
    model: type[_Model],
    content: object,
    path: Path,
    *,
    remedy: str = "write it again",
) -> _Model:
    """Content of a document as a model of its fields; raises InputError for what is missing or the first fault."""
    try:
        return model.model_validate(content)
    except ValidationError as reason:
        faults = reason.errors(include_url=False)
        first = faults[0]
        field = _fault_place(first)
        others = [_fault_place(fault) for fault in faults[1:] if fault["type"] == "missing"]
        # Missing fields that are named in one line.
        more = f", and so are {list_names(others, 12)}" if others and first["type"] == "missing" else ""
        raise InputError(_in_words(first) + more, source=path, field=field or None, remedy=remedy) from reason


def _fault_place(fault: Mapping[str, Any]) -> str:
    return ".".join(str(part)[:60] for part in fault["loc"])


def _in_words(fault: Mapping[str, Any]) -> str:
    """What is wrong with a field, of what pydantic says about it."""
    kind = fault["type"]
    if kind == "missing":
        return "is missing"
    # Not all of it: a value may be megabytes long, or nested as deep as a reader goes.
    found = "null" if fault["input"] is None else " ".join(reprlib.repr(fault["input"]).split())[:60]
    if kind in _KINDS:
        return f"is {found}, not {_KINDS[kind]}"
    said = fault["msg"].removeprefix("Value error, ")
    said = said.removeprefix("Input ")
    said = said[:1].lower() + said[1:]
    return said if kind in _SAID_ALREADY else f"{said}, got {found}"


def _build_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _Refused(f"{twice[:60]!r} stands twice")
    return content


def _refuse_constant(name: str) -> Any:
    raise _Refused(f"{name} is no number")


# XML files as elements, within bounds of size, depth and count, and without entities.

MAX_XML_BYTES = 64 * 1024 * 1024
# The largest model known here, a humanoid with hands in MJCF, has 6 000 elements, 26 deep, of up to 17 attributes.
MAX_ELEMENTS = 200_000
XML_DOCUMENT_MAX_DEPTH = 200
_UNBOUND_PREFIX = expat_errors.codes[expat_errors.XML_ERROR_UNBOUND_PREFIX]
# Comments and instructions, which hold no element, or the beginning of the outermost one.
_BEGINNINGS = re.compile(rb"<!--.*?-->|<[?!].*?>|<([A-Za-z_][\w.:-]*)", re.DOTALL)
_PREFIXED = re.compile(rb"[<\s/]([A-Za-z_][\w.-]*):[A-Za-z_]")


class _OutOfBounds(Exception):
    """What is too much, and the element at which it became so."""

    def __init__(self, what: str, tag: str):
        self.what, self.tag = what, tag
        super().__init__(what)


class _BoundedBuilder(TreeBuilder):
    """Builds elements as long as there are not too many, too deep, or with too many attributes."""

    def __init__(self, max_depth: int) -> None:
        super().__init__()
        self._max_depth, self._depth, self._count = max_depth, 0, 0

    def start(self, tag: Any, attrs: dict[Any, Any], /) -> Element:
        self._depth += 1
        self._count += 1
        if self._depth > self._max_depth:
            raise _OutOfBounds(f"elements are nested more than {self._max_depth} deep", tag)
        if self._count > MAX_ELEMENTS:
            raise _OutOfBounds(f"has more than {MAX_ELEMENTS} elements", tag)
        if len(attrs) > 200:
            raise _OutOfBounds(f"has {len(attrs)} attributes", tag)
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        self._depth -= 1
        return super().end(tag)


def read_xml(path: str | Path, *, max_depth: int = XML_DOCUMENT_MAX_DEPTH) -> Element:
    """The outermost element of an XML file.

    Args:
        max_depth: how deep elements may be nested.

    Raises:
        InputError: the file cannot be read, is no XML, declares entities, or has more or deeper
            elements than any model.
    """
    path = Path(path)
    return parse_xml(read_bytes(path, limit=MAX_XML_BYTES), path, max_depth)


def parse_xml(content: bytes, path: Path, max_depth: int = XML_DOCUMENT_MAX_DEPTH) -> Element:
    """The outermost element of XML that was read from ``path``; errors as for :func:`read_xml`."""
    # Some editors and programs of embedded makers end a text with the zero byte of its string.
    content = content.rstrip(b"\0")
    try:
        try:
            return _parse_xml(content, max_depth)
        except ParseError as reason:
            if reason.code != _UNBOUND_PREFIX:
                raise
            return _parse_xml(_with_prefixes(content), max_depth)
    except DefusedXmlException as reason:
        raise InputError(
            f"declares XML entities ({type(reason).__name__})",
            source=path,
            field="DOCTYPE",
            remedy="remove the document type declaration",
        ) from reason
    except _OutOfBounds as reason:
        raise InputError(
            reason.what, source=path, field=reason.tag[:60], remedy="reduce the model"
        ) from reason
    except (ParseError, ValueError, LookupError) as reason:
        raise InputError(
            f"is not valid XML ({in_one_line(reason)[:160]})", source=path, remedy="mend the syntax there"
        ) from reason


def elements_of(text: bytes | str) -> Element:
    """The outermost element of a text that was read or written here before; prefixes need no declaration."""
    return parse_xml(text.encode() if isinstance(text, str) else text, Path("text"))


def _parse_xml(content: bytes, max_depth: int) -> Element:
    parser = DefusedXMLParser(target=_BoundedBuilder(max_depth))
    parser.feed(content)
    root: Element = parser.close()
    return root


def _with_prefixes(content: bytes) -> bytes:
    """The text with every prefix that stands in it declared: ROS' and Drake's readers of models ask for no declaration.

    Drake's own models have ``drake:acceleration`` and ``drake:collision_filter_group`` without one.
    """
    first = next((match for match in _BEGINNINGS.finditer(content) if match[1]), None)
    if first is None:
        return content
    declared = set(re.findall(rb"xmlns:([\w.-]+)\s*=", content))
    prefixes = sorted(set(_PREFIXED.findall(content)) - declared - {b"xmlns", b"xml"})
    said = b"".join(b' xmlns:%s="undeclared:%s"' % (prefix, prefix) for prefix in prefixes)
    return content[: first.end(1)] + said + content[first.end(1) :]


def all_alike(elements: Sequence[Element]) -> bool:
    """Whether elements say the same, their children and attributes included: whichever a reader takes, none is lost."""
    return len(elements) < 2 or len({_canonical_text(one) for one in elements}) == 1


def _canonical_text(element: Element) -> str:
    alone = copy(element)
    alone.tail = None
    return canonicalize(tostring(alone, encoding="unicode"), strip_text=True)


# YAML files as mappings, without what a loader would swallow or never get through.
#
# YAML lets a file of a kilobyte stand for gigabytes (aliases of aliases), lets a key stand twice and keeps
# the last, and has a number that is none. Each of these is refused before anything is built from the file.

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
    remedy: str = "",
    limit: int = MAX_DESCRIPTION_BYTES,
    most_nodes: int = MAX_NODES,
    degrees: bool = False,
    sections: bool = False,
) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Args:
        remedy: what to do where it is no mapping at all.
        limit: largest size [bytes].
        most_nodes: how many values it may stand for.
        degrees: whether angles may be tagged ``!degrees`` (read as radians) or ``!radians``.
        sections: whether a mapping or list at the top may stand in parts, ``columns: {…}`` a line each, which are then
            one.

    Raises:
        InputError: the file cannot be read, is no YAML or no mapping, nests or repeats itself
            without end, holds a key twice, or a number that is none.
    """
    path = Path(path)
    text = read_text(path, limit=limit)
    try:
        root = _compose_nodes(text, path, most_nodes)
        if root is not None:
            if sections and isinstance(root, yaml.MappingNode):
                # Make one of the mappings, or of the lists, that stand under the same key at the top.
                first: dict[str, yaml.Node] = {}
                left = []
                for key, value in root.value:
                    name = str(key.value)
                    same = first.setdefault(name, value)
                    if (
                        same is not value
                        and isinstance(value, yaml.CollectionNode)
                        and type(same) is type(value)
                    ):
                        same.value += value.value
                    else:
                        left.append((key, value))
                root.value = left
            _check_nodes(root, path, most_nodes)
        content = (
            None if root is None else (_AngleLoader if degrees else _Loader)("").construct_document(root)
        )
    except yaml.YAMLError as reason:
        raise InputError(
            f"is not valid YAML ({in_one_line(reason)[:200]})", source=path, remedy="mend the syntax"
        ) from reason
    except (ValueError, TypeError, OverflowError) as reason:
        # Dates such as 2024-13-45 and numbers of thousands of digits.
        raise InputError(
            f"holds a value that cannot be read ({in_one_line(reason)[:120]})", source=path, remedy="mend it"
        ) from reason
    if not isinstance(content, dict):
        raise InputError(
            "is not a mapping", source=path, remedy=remedy or "write names and values, `name: value`"
        )
    return content


def _compose_nodes(text: str, path: Path, most_nodes: int) -> yaml.Node | None:
    """The nodes of the text, after its depth and length were found to be within bounds."""
    depth = nodes = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        nodes += isinstance(event, yaml.NodeEvent)
        if depth > MAX_DEPTH:
            raise InputError(f"is nested more than {MAX_DEPTH} deep", source=path, remedy="flatten it")
        if nodes > most_nodes:
            raise _too_many(path, most_nodes)
    return yaml.compose(text, Loader=_Loader)


def _check_nodes(root: yaml.Node, path: Path, most_nodes: int) -> None:
    """Refuse keys that stand twice, values that are no numbers, and aliases that multiply."""
    sizes: dict[int, int] = {}
    _count_expanded(root, (), sizes, frozenset(), path)
    if max(sizes.values()) > most_nodes:
        raise _too_many(path, most_nodes)


def _count_expanded(
    node: yaml.Node,
    place: tuple[str, ...],
    sizes: dict[int, int],
    above: frozenset[int],
    path: Path,
) -> int:
    """Number of nodes that a node stands for once aliases are written out."""
    if id(node) in above:
        raise InputError("contains itself", source=path, field=".".join(place), remedy="remove the alias")
    if id(node) in sizes:
        return sizes[id(node)]
    size, above = 1, above | {id(node)}
    if isinstance(node, yaml.MappingNode):
        _check_keys(node, place, path)
        for key, value in node.value:
            size += _count_expanded(value, (*place, str(key.value)), sizes, above, path)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            size += _count_expanded(value, (*place, str(index)), sizes, above, path)
    elif node.tag == "tag:yaml.org,2002:float" and _is_nan(node.value):
        raise InputError(f"is {node.value}", source=path, field=".".join(place), remedy="give a number")
    sizes[id(node)] = size
    return size


def _check_keys(node: yaml.MappingNode, place: tuple[str, ...], path: Path) -> None:
    seen: set[str] = set()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise InputError(
                "has a key that is no name", source=path, field=".".join(place), remedy="name it"
            )
        if key.value in seen and key.value != "<<":
            raise InputError(
                f"stands twice, again in line {key.start_mark.line + 1}",
                source=path,
                field=".".join((*place, str(key.value))),
                remedy="keep one of them",
            )
        seen.add(key.value)


def _is_nan(text: str) -> bool:
    try:
        return text.lower().strip("+-.") == "nan" or (text.isascii() and math.isnan(float(text)))
    except ValueError:
        return False


def _too_many(path: Path, most_nodes: int) -> InputError:
    return InputError(
        f"stands for more than {most_nodes} values", source=path, remedy="remove repetitions and aliases"
    )
