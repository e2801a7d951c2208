"""Members of one's own: refused where their name is taken, one line where their package is broken."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import excite
from excite.conversion.recording import Column, Recording, Stream
from excite.conversion.sources.registry import SOURCES
from excite.conversion.sources.source import Source
from excite.diagnosis.effects.effect import Effect, Parameter, Shape
from excite.diagnosis.effects.registry import EFFECTS
from excite.errors import ExciteError, InputError, PlugInError, UnknownNameError
from excite.export.exporter import Exporter
from excite.export.plain_tables import CsvExporter
from excite.export.registry import EXPORTERS
from excite.registry import Registry, load_member
from excite.safety.check import CHECKS
from excite.safety.checks.base import Check, CheckResult


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


class Nonsense(Exception):
    """What a member of one's own raises."""


@pytest.fixture
def own_members(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Members that a test adds are gone after it."""
    for registry in (SOURCES, EXPORTERS):
        monkeypatch.setattr(registry, "_members", dict(registry._members))
    yield
    for table in (CHECKS, EFFECTS):
        table.pop("own", None)


def added(axis: str, kind: type, **members: Any) -> None:
    """Add a class with some methods, each of which returns a value, or raises it."""

    def method(value: Any) -> Any:
        def answer(self: Any, *given: Any) -> Any:
            if isinstance(value, Exception):
                raise value
            return value(*given) if callable(value) else value

        return answer

    own = {
        word: value if word in ("suffix", "summary", "linear") else method(value)
        for word, value in members.items()
    }
    excite.catalogue.register(axis, type("Own", (kind,), {"name": "own", "__module__": "lab", **own}))


@pytest.fixture(scope="module")
def wet_log(tmp_path_factory: pytest.TempPathFactory) -> Any:
    motions = excite.load_motions("ur10")[:2]
    roles = {motions[1].name: "validation"}
    return excite.simulate("ur10", motions, nominal=True, seed=3, roles=roles).log


def columns_of(*sizes: int) -> tuple[Recording, ...]:
    columns = tuple(Column(f"q.{n}", np.zeros(n)) for n in sizes)
    return (Recording("run.own", "run", (Stream("all", columns, np.arange(5.0)),)),)


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (True, "judge: what it returns is True where CheckResult is expected"),
        (CheckResult(margin=np.nan), "has the margin nan where a finite one is expected"),
        (CheckResult(margin="wide"), "holds 'wide' where float | None is expected"),  # type: ignore[arg-type]
        (CheckResult(violations=("bad",)), "holds 'bad' where Violation is expected"),  # type: ignore[arg-type]
        (Nonsense("no cable"), r"judge: fails \(Nonsense: no cable\)"),
    ],
)
def test_a_check_that_is_wrong_is_named_with_what_was_expected(
    result: Any, said: str, own_members: None
) -> None:
    added("checks", Check, judge=result)
    with pytest.raises(PlugInError, match=f"^lab:Own: .*{said}.*; mend"):
        excite.check("ur10", excite.load_motions("ur10")[:1])


@pytest.mark.parametrize(
    ("result", "said"),
    [
        ("abc", r"read: what it returns is 'abc' where tuple\[Recording, ...\] is expected"),
        (({},), "holds {} where Recording is expected"),
        (columns_of(5, 4), r"holds columns of q.5 \(5,\), q.4 \(4,\), time \(5,\) where all are \(n,\)"),
        (Nonsense("no idea"), r"read: fails \(Nonsense: no idea\)"),
    ],
)
def test_a_reader_that_is_wrong_is_named_with_what_was_expected(
    result: Any, said: str, own_members: None, tmp_path: Path
) -> None:
    (tmp_path / "run.own").write_text("rows")
    added("readers", Source, summary="own", recognises=lambda path: path.suffix == ".own", read=result)
    with pytest.raises(PlugInError, match=f"^lab:Own: .*{said}.*; mend"):
        excite.convert([tmp_path / "run.own"], "ur10", tmp_path / "log")


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (3, "what it returns is 3 where NoneType is expected"),
        (None, "leaves no file .*m.txt"),
        (Nonsense("no disk"), r"fails \(Nonsense: no disk\)"),
    ],
)
def test_an_exporter_that_is_wrong_is_named_with_what_was_expected(
    result: Any, said: str, own_members: None, tmp_path: Path
) -> None:
    added("exporters", Exporter, suffix=".txt", summary="own", write=result)
    with pytest.raises(PlugInError, match=f"^lab:Own: write: .*{said}.*; mend"):
        excite.export_motion(
            excite.load_motions("ur10")[0], excite.load_robot("ur10"), "own", tmp_path / "m.txt"
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "result", "said"),
    [
        ("shape", np.zeros(3), r"is an array \(3,\) of float64 where Shape is expected"),
        ("shape", Shape({0: np.zeros((3, 1))}), r"has the shape \(3, 1\) where \(\d+, 1\) is expected"),
        (
            "unit_torques",
            lambda context, *_: np.full((len(context.v), 1), np.nan),
            "is not finite everywhere",
        ),
        ("unit_torques", "abc", "is 'abc' where ndarray"),
        ("unit_torques", Nonsense("no law"), r"fails \(Nonsense: no law\)"),
        ("locations", None, r"is None where tuple\[str, ...\] is expected"),
    ],
)
def test_an_effect_that_is_wrong_is_named_with_what_was_expected(
    method: str, result: Any, said: str, own_members: None, wet_log: Any
) -> None:
    added("effects", Effect, linear=(Parameter("size", "N·m", 0.0),), **{method: result})
    with pytest.raises(PlugInError, match=f"^lab:Own: {method}: .*{said}.*; mend"):
        excite.diagnose(wet_log, "ur10")


def test_attributes_of_another_type_are_refused_as_they_are_added(own_members: None) -> None:
    with pytest.raises(InputError, match=r"linear: is 'size' where tuple\[Parameter, ...\] is expected"):
        added("effects", Effect, linear="size")
