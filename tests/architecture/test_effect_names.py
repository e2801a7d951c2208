"""What others need to know of an effect is an attribute or a method of it: nobody compares its name with a word."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.floating.registry import EVERY_FORM
from excite.logs.vocabulary import EFFECTS as WORDS
from excite.rows.drive_terms import DRIVE_TERMS
from excite.simulation.effects.registry import INJECTED_EFFECTS
from tests.architecture.source_tree import syntax_tree

PACKAGE = Path(__file__).parents[2] / "excite"
NAMES = {*WORDS, *EFFECTS, *EVERY_FORM, *(e.name for e in EVERY_FORM.values()), *INJECTED_EFFECTS}
# What injects effects and draws hidden cases is written on its own, and knows of nothing else of an effect.
APART = ("simulation/effects",)
# Functions that look a word up.
_LOOKS_UP = {"get", "pop", "index", "count", "startswith", "endswith", "removeprefix", "removesuffix"}


def names_for(path: Path) -> set[str]:
    """Effects' names in a file; outside the diagnosis, rotor inertia is also a drive's term and a field of a robot."""
    return NAMES if path.is_relative_to(PACKAGE / "diagnosis") else NAMES - set(DRIVE_TERMS)


def compared(tree: ast.Module, names: set[str]) -> list[tuple[int, str]]:
    """Lines and code of comparisons with effects' names, of look-ups by them, and of branches between them."""
    constants = {
        target.id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }
    return [
        (node.lineno, ast.unparse(node))
        for node in ast.walk(tree)
        if any(names & set(_words(part, constants)) for part in _judged(node))
    ]


def _judged(node: ast.AST) -> Iterator[ast.AST]:
    """Parts of a node that words are compared with."""
    if isinstance(node, ast.Compare):
        yield from (node.left, *node.comparators)
    elif isinstance(node, ast.MatchValue):
        yield node.value
    elif isinstance(node, ast.Dict):
        yield from (key for key in node.keys if key is not None)
    elif isinstance(node, ast.Subscript) and not _registry(node.value):
        yield node.slice
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in _LOOKS_UP:
        yield from node.args
        # Of a table by names, whatever is looked up.
        yield node.func.value


def _registry(node: ast.AST) -> bool:
    """Whether it is a registry, whose keys are names as data."""
    return isinstance(node, ast.Name) and node.id.isupper() and not node.id.startswith("_")


def _words(node: ast.AST, constants: dict[str, ast.expr]) -> Iterator[str]:
    """Words that stand in an expression: as such, in a collection, or in a constant of the module."""
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and part.id in constants:
            yield from _words(constants[part.id], {})
        elif isinstance(part, ast.Constant) and isinstance(part.value, str):
            yield part.value


FILES = [
    path
    for path in sorted(PACKAGE.rglob("*.py"))
    if not any(path.is_relative_to(PACKAGE / folder) for folder in APART)
]


def test_no_file_compares_an_effects_name_with_a_word() -> None:
    found = {
        f"{path.relative_to(PACKAGE)}:{line} {code}"
        for path in FILES
        for line, code in compared(syntax_tree(path), names_for(path))
    }
    assert found == set()


@pytest.mark.parametrize(
    "code",
    [
        "x = item.name == 'payload'",
        "x = 'coulomb_friction' in modelled",
        "x = name in {'payload', 'backlash'}",
        "_LAG = 'actuator_lag'\nx = _LAG != name",
        "_ALIKE = {'actuator_lag': 'time_delay'}\nx = _ALIKE.get(name)",
        "_BODIES = frozenset(('payload',))\ndef f(name):\n    return name in _BODIES",
        "match name:\n    case 'payload':\n        pass",
        "x = {'payload': f, 'backlash': g}[name]",
        "x = own.index('armature')",
        "x = found['torque_bias']",
        "x = {**other, **{'stribeck': 1}}",
    ],
)
def test_the_check_sees_what_it_is_to_forbid(code: str) -> None:
    assert compared(ast.parse(code), NAMES)


@pytest.mark.parametrize(
    "code",
    [
        "name = 'payload'",
        "class A:\n    confusable_with = ('payload', 'armature')",
        "x = EFFECTS['payload']",
        "x = item.name == other.name",
        "x = word in EFFECTS",
        "x = f(effects=('time_delay',))",
    ],
)
def test_names_as_data_are_let_through(code: str) -> None:
    assert compared(ast.parse(code), NAMES) == []
