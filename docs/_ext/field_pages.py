"""The page of all fields of results, from the schemas that check them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from excite.campaign.schemas import DOCUMENTS


def fields_page() -> str:
    """Every document of a command: its fields, what they hold, and what they mean."""
    lines = [
        "# Fields of results",
        "",
        "Every command writes JSON; `excite schema NAME` prints the schema of a document. A field in *italics* may be "
        "left out. Units are SI, angles radians; a number that is not known or not finite is null.",
    ]
    shown: list[dict[str, Any]] = []
    for schema, kind in DOCUMENTS.items():
        content = kind.model_json_schema(by_alias=True)
        lines += ["", f"## {schema}", "", *_block(content)]
        for name, block in content.get("$defs", {}).items():
            # Parts that several documents have stand with the first of them.
            if block not in shown:
                shown.append(block)
                lines += [
                    "",
                    f"### {name} in {schema.removeprefix('excite.').partition('/')[0]}",
                    "",
                    *_block(block),
                ]
    return "\n".join(lines) + "\n"


def _block(block: dict[str, Any]) -> Iterator[str]:
    required = block.get("required", [])
    yield block["description"].partition("\n\n")[0]
    yield ""
    yield "| field | holds | meaning |"
    yield "| --- | --- | --- |"
    for name, entry in block.get("properties", {}).items():
        shown = f"`{name}`" if name in required else f"*`{name}`*"
        yield f"| {shown} | {_kind(entry)} | {_cell(entry.get('description', ''))} |"


def _kind(entry: dict[str, Any]) -> str:
    """What a field holds, in words."""
    if "$ref" in entry:
        return entry["$ref"].rpartition("/")[2]
    if "const" in entry or "enum" in entry:
        return _cell(", ".join(f"`{word}`" for word in entry.get("enum", [entry.get("const")])))
    if "anyOf" in entry:
        return " or ".join(dict.fromkeys(_kind(one) for one in entry["anyOf"]))
    if entry.get("type") == "array":
        return f"list of {_kind(entry.get('items', {}))}"
    if entry.get("type") == "object":
        patterns = list(entry.get("patternProperties", {}).values())
        more = patterns[0] if patterns else entry.get("additionalProperties")
        return f"by name, {_kind(more)}" if isinstance(more, dict) else "object"
    words = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false"}
    return words.get(entry.get("type", ""), entry.get("type", "anything"))


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
