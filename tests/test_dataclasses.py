"""Results cannot be changed after they were handed out, and those that hold arrays are compared by identity."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import pytest

import excite.identification.estimators
import excite.safety

# What a hierarchy has reached so far moves from level to level.
CHANGES = {"HierarchyState"}


def _dataclasses() -> list[type]:
    found: dict[str, type] = {}
    for package in (excite.safety, excite.identification.estimators):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            for value in vars(importlib.import_module(module.name)).values():
                if dataclasses.is_dataclass(value) and value.__module__ == module.name:
                    found[f"{module.name}.{value.__qualname__}"] = value
    return list(found.values())


@pytest.mark.parametrize("kind", _dataclasses(), ids=lambda kind: kind.__qualname__)
def test_results_are_frozen(kind: type) -> None:
    assert kind.__dataclass_params__.frozen is (kind.__qualname__ not in CHANGES)
    if any(item.type == "Array" for item in dataclasses.fields(kind)):
        assert kind.__eq__ is object.__eq__, "arrays have no single truth: == would raise"
        assert kind.__hash__ is object.__hash__
