"""Members of one's own: refused where their name is taken, one line where their package is broken."""

from __future__ import annotations

import pytest

import excite
from excite.errors import ExciteError, InputError, UnknownNameError
from excite.export.plain_tables import CsvExporter
from excite.registry import Registry, load_member
from excite.safety.check import CHECKS


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
