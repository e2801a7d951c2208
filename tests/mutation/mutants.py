"""Mutants of a package: every change that Cosmic Ray's operators make, and a random sample of those that count."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from cosmic_ray.commands.init import _all_work_items
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

# Bit operators in the place of arithmetic raise TypeError on floats: any test would kill them.
_TRIVIAL = re.compile(
    r"ReplaceBinaryOperator_(Add|Sub|Mul|Div|FloorDiv|Mod|Pow)_(RShift|LShift|BitOr|BitAnd|BitXor)$"
)


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        path: of the file, from the project's root.
        line: first line that is changed.
        operator: Cosmic Ray's name of the change.
        occurrence: which of the operator's places in the file it is.
    """

    path: str
    line: int
    operator: str
    occurrence: int

    def code(self, root: Path) -> str:
        """The file's text with the change."""
        source = (root / self.path).read_text(encoding="utf-8")
        return mutate_code(source, get_operator(self.operator)(), self.occurrence)

    def change(self, root: Path) -> str:
        """The changed line, before and after."""
        old = (root / self.path).read_text(encoding="utf-8").splitlines()
        new = self.code(root).splitlines()
        at = next(
            (i for i, lines in enumerate(zip(old, new, strict=False)) if lines[0] != lines[1]), len(new)
        )
        return f"{old[at].strip()}  →  {new[at].strip() if at < len(new) else ''}"


def sample(root: Path, packages: Sequence[str], size: int, seed: int) -> list[Mutant]:
    """A random sample of some packages' mutants that change what runs, in random order."""
    mutants = [mutant for package in packages for mutant in every(root, package)]
    Random(seed).shuffle(mutants)
    chosen: list[Mutant] = []
    for mutant in mutants:
        if len(chosen) == size:
            break
        if changes_what_runs((root / mutant.path).read_text(encoding="utf-8"), mutant.code(root)):
            chosen.append(mutant)
    return chosen


def every(root: Path, package: str) -> Iterator[Mutant]:
    """All mutants of a package but the trivial ones."""
    paths = sorted(path for path in (root / package).rglob("*.py"))
    for item in _all_work_items(paths, {}):
        (change,) = item.mutations
        if not _TRIVIAL.search(change.operator_name):
            path = change.module_path.relative_to(root).as_posix()
            yield Mutant(path, change.start_pos[0], change.operator_name, change.occurrence)


def changes_what_runs(before: str, after: str) -> bool:
    """Whether a changed module is still Python and differs in more than docstrings and annotations."""
    try:
        return _essence(before) != _essence(after)
    except SyntaxError:
        return False


def _essence(source: str) -> str:
    """The syntax tree without docstrings; without annotations too where the module postpones them."""
    tree = ast.parse(source)
    postponed = any(isinstance(node, ast.ImportFrom) and node.module == "__future__" for node in tree.body)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and _is_text(body[0]):
            body[0] = ast.Pass()
        if not postponed:
            continue
        if isinstance(node, ast.AnnAssign | ast.arg):
            node.annotation = ast.Constant(None)
        if isinstance(node, ast.FunctionDef):
            node.returns = None
    return ast.dump(tree)


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
