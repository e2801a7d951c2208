"""The package as its syntax trees tell it: its modules, and which imports which, where, and why late."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = "excite"


@dataclass(frozen=True)
class Import:
    """One import of one module.

    Attributes:
        module: what is imported, a module of the package by its full name, any other by its first word.
        line: where it stands.
        inside: whether it is run late: it stands in a function, or a string names it.
        typing: whether it stands under ``if TYPE_CHECKING``, so that it is never run.
        by_name: whether a string names it, ``package.module:Name``, as a registry names its members.
        comment: what the line says behind ``#``, or the line above where that is a comment.
    """

    module: str
    line: int
    inside: bool
    typing: bool
    by_name: bool
    comment: str


@dataclass(frozen=True)
class Module:
    """A module: its full name, its file, its docstring, its lines and its imports."""

    name: str
    path: Path
    docstring: str | None
    n_lines: int
    imports: tuple[Import, ...] = field(repr=False)

    @property
    def room(self) -> str:
        """The folder below the package that it lies in; its own name where it lies in none."""
        parts = self.name.split(".")
        return parts[1] if len(parts) > 1 else PACKAGE


@cache
def syntax_tree(path: Path) -> ast.Module:
    """The syntax tree of a file, parsed once for all who look into it."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def modules() -> dict[str, Module]:
    """All modules of the package by their full names."""
    paths = {_name(path): path for path in sorted((ROOT / PACKAGE).rglob("*.py"))}
    return {name: _module(name, path, frozenset(paths)) for name, path in paths.items()}


def loaded_by(name: str) -> frozenset[str]:
    """First words of all libraries that importing a module loads, whatever loads them."""
    seen, open_, libraries = set(), [name], set()
    while open_:
        current = open_.pop()
        if current in seen:
            continue
        seen.add(current)
        if current not in modules():
            libraries.add(current)
            continue
        parts = current.split(".")
        open_ += [".".join(parts[:i]) for i in range(1, len(parts))]
        open_ += [item.module for item in modules()[current].imports if not (item.inside or item.typing)]
    return frozenset(libraries)


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Groups of nodes that can all be reached from one another, by depth first search (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(edges.get(node, ())):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1 or node in edges.get(node, ()):
                found.append(sorted(group))

    for node in sorted(edges):
        if node not in index:
            visit(node)
    return found


def module_edges() -> dict[str, set[str]]:
    """Which module of the package imports which, imports for types and in functions among them."""
    edges: dict[str, set[str]] = defaultdict(set)
    for name, module in modules().items():
        edges[name] |= {item.module for item in module.imports if item.module in modules()}
    return dict(edges)


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _module(name: str, path: Path, known: frozenset[str]) -> Module:
    text, tree = path.read_text(), syntax_tree(path)
    found = _Imports(name, text.splitlines(), known)
    found.visit(tree)
    lines = len(text.splitlines())
    return Module(name, path, ast.get_docstring(tree), lines, tuple(found.imports))


class _Imports(ast.NodeVisitor):
    """Collects the imports of a module, and modules that strings name; whether in functions, or for types only."""

    def __init__(self, own: str, lines: list[str], known: frozenset[str]) -> None:
        self.imports: list[Import] = []
        self._own = own
        self._lines, self._known = lines, known
        self._inside = self._typing = False

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        before, self._inside = self._inside, True
        self.generic_visit(node)
        self._inside = before

    visit_AsyncFunctionDef = visit_FunctionDef  # type: ignore[assignment]

    def visit_If(self, node: ast.If) -> None:
        before = self._typing
        self._typing = before or (isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING")
        self.generic_visit(node)
        self._typing = before

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            self._add(alias.name, node)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        if node.level:
            raise ValueError(f"relative import: {ast.unparse(node)}")
        for alias in node.names:
            whole = f"{node.module}.{alias.name}"
            self._add(whole if whole in self._known else str(node.module), node)

    def visit_Constant(self, node: ast.Constant) -> None:
        named = (
            re.fullmatch(rf"({PACKAGE}(?:\.\w+)+):\w+", node.value) if isinstance(node.value, str) else None
        )
        if named is not None and named[1] != self._own:
            self._add(named[1], node, by_name=True)

    def _add(self, module: str, node: ast.stmt | ast.expr, *, by_name: bool = False) -> None:
        if not module.startswith(f"{PACKAGE}.") and module != PACKAGE:
            module = module.split(".")[0]
        own, above = self._lines[node.lineno - 1], self._lines[node.lineno - 2].strip()
        comment = own.partition("#")[2] or (above[1:] if above.startswith("#") else "")
        inside = self._inside or by_name
        self.imports.append(Import(module, node.lineno, inside, self._typing, by_name, comment.strip()))
