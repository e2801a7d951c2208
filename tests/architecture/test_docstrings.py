"""Whatever is public says what it is for."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator

from tests.architecture.source_tree import modules


def public_of(module: object) -> Iterator[tuple[str, object]]:
    """Functions and classes that a module defines, and public methods and properties of these."""
    for name, member in vars(module).items():
        if name.startswith("_") or getattr(member, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(member):
            yield name, member
            yield from ((f"{name}.{a}", getattr(member, a)) for a in methods_of(member))
        elif inspect.isfunction(member):
            yield name, member


def methods_of(member: type) -> Iterator[str]:
    # A list: a document builds its validators when it is looked at.
    for name, value in list(vars(member).items()):
        value = getattr(value, "func", getattr(value, "fget", getattr(value, "__func__", value)))
        if not name.startswith("_") and inspect.isfunction(value) and value.__module__ == member.__module__:
            yield name


def test_every_public_function_class_and_method_has_a_docstring_or_inherits_one():
    found = []
    n = 0
    for name in modules():
        if name.endswith("__main__"):
            continue
        module = importlib.import_module(name)
        for public, member in public_of(module):
            n += 1
            if not inspect.getdoc(member):
                found.append(f"{name}: {public}")
    assert n > 3000
    assert found == []
