"""Members of one's own: refused where their name is taken, one line where their package is broken."""

from __future__ import annotations

import pytest

import excite
from excite.errors import ExciteError, InputError, UnknownNameError
from excite.export.plain_tables import CsvExporter
from excite.registry import Registry, load_member
from excite.safety.check import CHECKS
from excite.safety.checks.base import Check


def test_a_class_of_another_kind_and_one_that_lacks_a_method_are_one_line() -> None:
    with pytest.raises(InputError, match="lacks the class Effect; derive it from Effect"):
        excite.catalogue.register("effects", CsvExporter)
    unfinished = type("Unfinished", (Check,), {"name": "unfinished"})
    with pytest.raises(InputError, match="lacks judge"):
        excite.catalogue.register("checks", unfinished)


@pytest.mark.parametrize(("axis", "member"), [("exporters", CsvExporter), ("checks", CHECKS["joint_torque"])])
def test_a_name_of_the_package_cannot_be_taken(axis: str, member: type) -> None:
    with pytest.raises(InputError, match="is taken"):
        excite.catalogue.register(axis, member)


def test_an_axis_that_is_none_is_refused_with_those_that_are() -> None:
    with pytest.raises(UnknownNameError, match="checks, effects, exporters, readers"):
        excite.catalogue.register("robots", CsvExporter)


@pytest.mark.parametrize("place", ["nowhere.at.all:Member", "json:Member"])
def test_a_package_that_cannot_be_loaded_is_named(place: str) -> None:
    with pytest.raises(ExciteError, match=f"{place}, which an installed package adds, cannot be loaded"):
        load_member(place)
    with pytest.raises(ExciteError, match="cannot be loaded"):
        Registry("format", {"mine": place}).find("mine")


def test_what_is_added_is_asked_first() -> None:
    registry: Registry[CsvExporter] = Registry("format", {"old": "json:JSONDecoder"})
    registry["mine"] = CsvExporter
    assert list(registry) == ["mine", "old"] and registry.find("mine") is CsvExporter
