"""The page of names: everything that is chosen or reported by a word, from the registries."""

from __future__ import annotations

import inspect
from collections.abc import Iterable

import excite
from excite.conversion.sources.registry import SOURCES
from excite.errors import ExciteError
from excite.export.registry import EXPORTERS, MODEL_FORMATS
from excite.motion.generators.registry import GENERATORS
from excite.safety.check import CHECKS
from excite.safety.filter import REPAIRS


def names_page() -> str:
    """Markdown with a table for every registry."""
    return "\n".join(
        (
            "# Names\n",
            "Everything that is chosen or reported by a word, as the program has it.\n",
            _table("Generators of motions", ("generator", "what it does", "where"), _generators()),
            _table("Safety checks", ("check", "what it looks at"), _first_lines(CHECKS.items())),
            _table("Repairs", ("repair", "what it does"), _first_lines(REPAIRS.items())),
            _table("Formats written", ("format", "what it is", "settings"), _formats()),
            _table(
                "Models for simulators",
                ("format", "what it is"),
                ((n, MODEL_FORMATS[n].summary) for n in MODEL_FORMATS),
            ),
            _table("Formats read", ("format", "what it is"), ((n, SOURCES[n].summary) for n in SOURCES)),
            _table("Methods of identification", ("method", "what it is", "take it for"), _methods()),
            _table("Effects in arms", ("effect", "law", "looks like", "told apart by"), _effects("fixed")),
            _table("Effects in standing robots and people", ("effect", "law", "looks like"), _standing()),
            _table("Errors", ("class", "when", "exit code"), _errors(ExciteError)),
        )
    )


def _table(title: str, head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [f"## {title}\n", _row(head), _row(("---",) * len(head))]
    return "\n".join([*lines, *(_row((f"`{first}`", *rest)) for first, *rest in rows), ""])


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def _first_lines(members: Iterable[tuple[str, type]]) -> Iterable[tuple[str, str]]:
    return ((name, (inspect.getdoc(kind) or "").split("\n\n")[0]) for name, kind in members)


def _generators() -> Iterable[tuple[str, str, str]]:
    return ((name, GENERATORS[name].summary, GENERATORS[name].needs or "any robot") for name in GENERATORS)


def _formats() -> Iterable[tuple[str, str, str]]:
    for name in EXPORTERS:
        settings = "; ".join(f"`{one.name}` {one.summary}" for one in EXPORTERS[name].settings)
        yield name, EXPORTERS[name].summary, settings


def _methods() -> Iterable[tuple[str, str, str]]:
    return ((one.name, one.title, one.use) for one in excite.catalogue.method_summaries())


def _effects(base: str) -> Iterable[tuple[str, str, str, str]]:
    for one in excite.catalogue.effect_summaries():
        if one.base == base:
            yield one.form, one.law, one.looks_like, one.told_apart_by


def _standing() -> Iterable[tuple[str, str, str]]:
    return (row[:3] for row in _effects("floating"))


def _errors(kind: type[ExciteError]) -> Iterable[tuple[str, str, str]]:
    yield kind.__name__, (inspect.getdoc(kind) or "").split("\n\n")[0], str(kind.exit_code)
    for child in kind.__subclasses__():
        yield from _errors(child)
