"""Python text of a configuration: written with all digits, and run again without the library that it is for."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.errors import InputError

PHYSICS_DT = 0.005
"""Step of the physics that delays are counted in [s], which both libraries' own tasks take; the text says to change
it with the simulation's."""


_DELAY = """# How late the motors were found to follow [s], counted in your simulation's steps.
DELAY = {late!r}
PHYSICS_DT = {step!r}
DELAY_STEPS = round(DELAY / PHYSICS_DT)


"""


def delay_text(late: float | None) -> str:
    """Lines that say how late motors follow; none where that is not known."""
    return "" if late is None else _DELAY.format(late=late, step=PHYSICS_DT)


def delay_note(late: float | None) -> tuple[str, ...]:
    """What of a delay a whole number of steps leaves."""
    if late is None:
        return ()
    return (
        f"commands reach the servo {round(late / PHYSICS_DT)} steps of {PHYSICS_DT:g} s late for the {late:.3g} s that"
        " were found; what the servo measures is not late",
    )


@dataclass(frozen=True, eq=False)
class Recorded:
    """Anything of the library that a configuration is for: what it was called with, and nothing else.

    Attributes:
        name: as the configuration has it, dots included.
        arguments: keywords of the call.
    """

    name: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __getattr__(self, name: str) -> Recorded:
        if name.startswith("__"):
            raise AttributeError(name)
        return Recorded(f"{self.name}.{name}")

    def __call__(self, *others: Any, **arguments: Any) -> Recorded:
        return Recorded(self.name, arguments)


def record_configuration(text: bytes, name: str, library: str) -> Recorded:
    """What a configuration's text calls ``name``, run with stand-ins for all that it imports of a library.

    Args:
        text: a configuration that was written here.
        name: the variable that is asked for.
        library: package whose imports get stand-ins; all others are left as they are.

    Raises:
        InputError: it is no Python, or has no such variable.
    """
    tree = ast.parse(text)
    names: dict[str, Any] = {"__file__": "robot.py", "__name__": "configuration"}
    kept: list[ast.stmt] = []
    for statement in tree.body:
        if isinstance(statement, ast.Import | ast.ImportFrom) and _is_of(statement, library):
            names |= {item.asname or item.name: Recorded(item.name) for item in statement.names}
        else:
            kept.append(statement)
    exec(compile(ast.Module(kept, []), "configuration", "exec"), names)
    found = names.get(name)
    if not isinstance(found, Recorded):
        raise InputError(f"has no {name}", source="written model")
    return found


def _is_of(statement: ast.Import | ast.ImportFrom, library: str) -> bool:
    module = statement.names[0].name if isinstance(statement, ast.Import) else statement.module or ""
    return module.split(".")[0] == library


def joint_table(values: Mapping[str, float], *, indent: str = "    ") -> str:
    """A dictionary by joint, a line each; names are patterns, which both libraries take them for."""
    rows = [f"{indent}{re.escape(name)!r}: {float(value)!r}," for name, value in values.items()]
    return "\n".join(["{", *rows, "}"])


def by_joint(found: Any, joints: tuple[str, ...]) -> Array:
    """Values of joints out of a table by pattern, or of a number for all, ``(n_joints,)``; NaN where there is none."""
    if not isinstance(found, Mapping):
        return np.full(len(joints), np.nan if found is None else float(found))
    rows = []
    for joint in joints:
        rows.append(next((float(value) for key, value in found.items() if re.fullmatch(key, joint)), np.nan))
    return np.array(rows)


def common_value(values: Array) -> float | None:
    """The one value that all joints have; None where it is not known."""
    return float(values[0]) if len(values) and np.isfinite(values).all() else None


def module_name(stem: str, suffix: str) -> str:
    """A name that Python can import, made of a robot's."""
    plain = re.sub(r"\W", "_", stem)
    return f"robot_{plain}_{suffix}" if plain[:1].isdigit() else f"{plain}_{suffix}"


def variable_name(stem: str) -> str:
    """A name for a module's constant, made of a robot's."""
    return module_name(stem, "CFG").upper()


def path_beside(name: str) -> str:
    """Python that says where a file beside the configuration lies."""
    return f"Path(__file__).resolve().parent / {Path(name).name!r}"
