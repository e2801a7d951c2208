"""The page of findings has every code that the program can give, and no other."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import get_args, get_type_hints

from excite.conversion import episodes
from excite.data_tables import read_rows
from excite.doctor.examine import FOUND
from excite.robot.urdf.inertia import moments_fault
from excite.safety.check import CHECKS as SAFETY_CHECKS
from excite.simulation.rehearsal import AT_LIMIT, FELL, SLIPPED, TOUCHED

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "reference" / "findings.md").read_text(encoding="utf-8")
# What makes something that has a code, and which of its arguments the code is.
MAKERS = {
    "Finding": 0,
    "Violation": 0,
    "first_violation": 0,
    "first_violations": 0,
    "build_finding": 0,
    "add_finding": 0,
    "_say_finding": 0,
    "magnitude_result": 0,
    "rejected": 0,
    "Rejection": 1,
}
# Where codes stand in tables that loops go through, or are made by a rule of their own.
TABLES = (
    "safety/checks/ground.py",
    "safety/checks/joints.py",
    "export/makers.py",
    "safety/repairs/time_scaling.py",
    "safety/repairs/rows.py",
)
# Where rows of a code and what it is said of are yielded, or stand in a list of cases.
ROWS = (
    "human/plates.py",
    "safety/check.py",
    "safety/checks/ground.py",
    "safety/checks/motion.py",
    "identification/result.py",
    "robot/inspection/links.py",
    "robot/inspection/rules.py",
)
CODE = re.compile(r"[a-z]+(_[a-z]+)*")


def on_the_page() -> list[str]:
    blocks = re.findall(r"```\{glossary\}\n(.*?)```", PAGE, flags=re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line and not line.startswith(" ")]


def made_in(path: Path) -> Iterator[str]:
    """Codes in a module's calls, and in the tables of those modules that have some."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if name in MAKERS:
                named = [item.value for item in node.keywords if item.arg == "kind"]
                for code in (named or node.args[MAKERS[name] :])[:1]:
                    if isinstance(code, ast.Constant) and isinstance(code.value, str):
                        yield code.value
        elif isinstance(node, ast.For) and path.as_posix().endswith(TABLES):
            yield from _loop_codes(node, tree)
        elif isinstance(node, ast.Tuple) and path.as_posix().endswith(ROWS):
            yield from _row_code(node)
    if path.as_posix().endswith("safety/repairs/rows.py"):
        yield from re.findall(r'\("(\w+)", "feet"\)', path.read_text(encoding="utf-8"))
    if path.as_posix().endswith("safety/repairs/time_scaling.py"):
        yield from re.findall(r'Scaling\([^"\n]*"(\w+)", "path"', path.read_text(encoding="utf-8"))


def _row_code(row: ast.Tuple) -> Iterator[str]:
    whole = len(row.elts) > 2 or any(isinstance(cell, ast.Dict) for cell in row.elts)
    first = row.elts[0] if whole else None
    said = any(not isinstance(cell, ast.Constant) for cell in row.elts)
    if (
        said
        and isinstance(first, ast.Constant)
        and isinstance(first.value, str)
        and CODE.fullmatch(first.value)
    ):
        yield first.value


def _loop_codes(loop: ast.For, tree: ast.Module) -> Iterator[str]:
    """Words in the table that a loop with a variable ``kind`` or ``reason`` goes through."""
    names = [item.id for item in ast.walk(loop.target) if isinstance(item, ast.Name)]
    if not {"kind", "reason"} & set(names):
        return
    table: ast.AST = loop.iter
    if isinstance(table, ast.Name):
        wanted = table.id
        table = next(
            item.value
            for item in ast.walk(tree)
            if isinstance(item, ast.Assign) and getattr(item.targets[0], "id", "") == wanted
        )
    for row in ast.walk(table):
        if isinstance(row, ast.Tuple):
            for cell in row.elts:
                if isinstance(cell, ast.Constant) and isinstance(cell.value, str):
                    yield cell.value


@cache
def in_the_program() -> set[str]:
    codes = {code for path in (ROOT / "excite").rglob("*.py") for code in made_in(path)}
    of_moments = set(get_args(get_type_hints(moments_fault)["return"])) - {""}
    of_episodes = {row["kind"] for row in read_rows(episodes.__file__, "episodes.csv")}
    return codes | of_moments | of_episodes | FOUND | {AT_LIMIT, FELL, SLIPPED, TOUCHED}


def test_every_code_of_the_program_is_on_the_page_and_no_other() -> None:
    assert set(on_the_page()) == in_the_program()


def test_the_codes_were_found_where_they_are_made() -> None:
    """The search itself: one code of every kind of place."""
    found = in_the_program()
    for code in ("rank", "jitter", "torque_sign", "foot_slip", "franka_jerk", "starts_moving", "friction"):
        assert code in found
    assert all(CODE.fullmatch(code) for code in found)
    assert len(SAFETY_CHECKS) < len(found)


def test_no_code_is_there_twice_or_without_a_sentence() -> None:
    codes = on_the_page()
    assert len(codes) == len(set(codes))
    for code in codes:
        assert re.search(rf"^{code}\n  [A-Z`][^\n]{{15,}}", PAGE, flags=re.MULTILINE), code
