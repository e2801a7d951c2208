"""What the package weighs, room by room, from its syntax trees: ``python -m tests.architecture.budget [--lower]``.

The table ``budget.csv`` holds the largest numbers that are allowed. ``--lower`` writes those that have fallen into it,
never one that has risen: a number that has to rise is edited by hand, with the reason in the commit.
"""

from __future__ import annotations

import argparse
import ast
import csv
import io
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.architecture.source_tree import PACKAGE, ROOT, modules, syntax_tree

TABLE = Path(__file__).with_name("budget.csv")
COUNTS = (
    "lines",
    "files",
    "functions",
    "tokens",
    "ifs",
    "constants",
    "deciding_constants",
    "one_word_functions",
    "small_parts",
    "bare_tuples",
    "late_imports",
)
# Rooms whose members are found through a registry: a file each, however small.
PLUG_INS = (
    "generators",
    "checks",
    "repairs",
    "estimators",
    "effects",
    "sources",
    "readers",
    "export",
    "simulators",
    "mistakes",
)
_SMALL, _TUPLE = 300, 3


def measured() -> dict[str, dict[str, int]]:
    """By room, the modules beside the rooms under the package's own name: every count."""
    found: dict[str, dict[str, int]] = {}
    for name, module in modules().items():
        room = module.room if (ROOT / PACKAGE / module.room).is_dir() else PACKAGE
        row = found.setdefault(room, dict.fromkeys(COUNTS, 0))
        for count, value in _weighed(module.path).items():
            row[count] += value
        row["small_parts"] += _is_small_part(name)
        row["late_imports"] += sum(
            item.inside and not item.by_name and item.module in modules() for item in module.imports
        )
    return dict(sorted(found.items()))


def allowed() -> dict[str, dict[str, int]]:
    """The table, likewise."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {row.pop("room"): {count: int(row[count]) for count in COUNTS} for row in csv.DictReader(file)}


def write(table: dict[str, dict[str, int]]) -> None:
    """Write the table."""
    text = io.StringIO()
    writer = csv.DictWriter(text, ["room", *COUNTS], lineterminator="\n")
    writer.writeheader()
    writer.writerows({"room": room, **row} for room, row in table.items())
    TABLE.write_text(text.getvalue(), encoding="utf-8")


@cache
def _weighed(path: Path) -> dict[str, int]:
    text = path.read_text(encoding="utf-8")
    tree = syntax_tree(path)
    nodes = list(ast.walk(tree))
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    named = set(_constants(tree))
    counted = (tokenize.NAME, tokenize.OP, tokenize.NUMBER)
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {
        "lines": len(text.splitlines()),
        "files": 1,
        "functions": len(functions),
        "tokens": sum(token.type in counted for token in tokens),
        "ifs": sum(isinstance(node, ast.If | ast.IfExp) for node in nodes),
        "constants": len(named),
        "deciding_constants": len(named & _compared(nodes)),
        "one_word_functions": sum("_" not in node.name.strip("_") for node in functions),
        "bare_tuples": sum(_returns_bare_tuple(node) for node in functions),
    }


def _constants(tree: ast.Module) -> Iterator[str]:
    """Names on a module's first level that hold one number, or one of several in a row."""
    for node in tree.body:
        targets = (
            node.targets
            if isinstance(node, ast.Assign)
            else [node.target]
            if isinstance(node, ast.AnnAssign)
            else []
        )
        for target in targets:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            values = (
                node.value.elts
                if isinstance(node.value, ast.Tuple) and len(names) > 1
                else [node.value] * len(names)
            )
            for name, value in zip(names, values, strict=False):
                if isinstance(name, ast.Name) and _is_number(value):
                    yield name.id


def _is_number(node: ast.expr | None) -> bool:
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )


def _compared(nodes: list[ast.AST]) -> set[str]:
    """Names that stand in a comparison, where a number decides."""
    comparisons = (node for node in nodes if isinstance(node, ast.Compare))
    return {name.id for node in comparisons for name in ast.walk(node) if isinstance(name, ast.Name)}


def _returns_bare_tuple(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether a function is said to return three things or more without names."""
    said = node.returns
    if not (
        isinstance(said, ast.Subscript) and isinstance(said.value, ast.Name) and said.value.id == "tuple"
    ):
        return False
    parts = said.slice.elts if isinstance(said.slice, ast.Tuple) else [said.slice]
    return len(parts) >= _TUPLE and not any(
        isinstance(p, ast.Constant) and p.value is Ellipsis for p in parts
    )


@cache
def _importers() -> dict[str, set[str]]:
    found: dict[str, set[str]] = {name: set() for name in modules()}
    for name, module in modules().items():
        for item in module.imports:
            if item.module in found:
                found[item.module].add(name)
    return found


def _is_small_part(name: str) -> bool:
    """A small module with one importer, which stands in the same room: a part of that one, cut off."""
    module, users = modules()[name], _importers()[name]
    if module.path.name == "__init__.py" or module.n_lines >= _SMALL or len(users) != 1:
        return False
    if set(name.split(".")) & set(PLUG_INS):
        return False
    (user,) = users
    # A member that a registry names, by a string, is no part of it.
    named = all(item.by_name for item in modules()[user].imports if item.module == name)
    return modules()[user].room == module.room and not named


def main() -> int:
    """Print what has changed against the table; with ``--lower`` write what has fallen."""
    parser = argparse.ArgumentParser(prog="python -m tests.architecture.budget", description=__doc__)
    parser.add_argument("--lower", action="store_true", help="write numbers that have fallen into the table")
    given = parser.parse_args()
    now, before = measured(), allowed() if TABLE.is_file() else {}
    risen = 0
    for room, row in now.items():
        for count, value in row.items():
            most = before.get(room, {}).get(count, value)
            if value != most:
                print(f"{room:16} {count:20} {most:8} -> {value}")
                risen += value > most
    total = {count: sum(row[count] for row in now.values()) for count in COUNTS}
    print(", ".join(f"{value} {count}" for count, value in total.items()))
    if given.lower:
        write(
            {
                room: {c: min(v, before.get(room, {}).get(c, v)) for c, v in row.items()}
                for room, row in now.items()
            }
        )
    return int(risen > 0)


if __name__ == "__main__":
    sys.exit(main())
