"""Settings belong to the methods that know them: each is declared once, and refused elsewhere by name."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from excite.errors import InputError, UnknownNameError
from excite.identification.estimators.conic import Cls3Settings, LmiSettings, QpSettings
from excite.identification.estimators.hqp import HqpSettings
from excite.identification.estimators.method_settings import (
    estimator_settings,
    methods_with,
    own_settings,
)
from excite.identification.estimators.registry import (
    DEFAULT_METHOD,
    ESTIMATORS,
    find_estimator,
    method_summaries,
)
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.identify import identify
from excite.identification.physical.bounds import KnownBounds
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log

# What each method answered to before settings had owners, beside prior_spread, segment_spread and total_mass.
KNOWN = {
    "adaptive": {"alpha", "inertia_floor", "terms"},
    "ls": {"ls_reference"},
    "wls": {"weight_iterations"},
    "map": {"alpha"},
    "qp": {"alpha", "com_boxes", "inertia_floor", "symmetry", "asymmetric"},
    "hqp": {
        "com_boxes", "sphere_epsilon", "mirror", "asymmetric", "mass_range",
        "segment_mass_range",
    },
    "cls1": {"com_boxes", "inertia_floor", "bound_width", "parameter_bounds", "bounds"},
    "cls2": {"alpha", "com_boxes", "inertia_floor", "bound_width", "parameter_bounds", "bounds"},
    "cls3": {"alpha", "com_boxes", "inertia_floor", "com_ellipsoids", "body_ellipsoids", "bounds"},
    "lmi": {"alpha", "com_boxes", "inertia_floor", "symmetry", "asymmetric", "regulariser"},
    "physical": {"com_boxes", "inertia_floor", "bounds"},
}  # fmt: skip
SHARED = {"prior_spread", "segment_spread", "total_mass"}
DOCUMENT = Path(__file__).parents[2] / "docs" / "methods.md"


def names_of(kind: type[EstimatorSettings]) -> set[str]:
    return {item.name for item in fields(kind)}


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_method_knows_its_settings_and_refuses_all_others_in_one_line(name):
    kind = ESTIMATORS[name].settings_class
    assert names_of(kind) == KNOWN[name] | SHARED
    for other in set.union(*KNOWN.values()) - KNOWN[name]:
        with pytest.raises(InputError) as caught:
            estimator_settings(name, **{other: 1.0})
        assert (caught.value.field, caught.value.what) == (other, f"is not used by method {name!r}")
        able = [method for method, known in KNOWN.items() if other in known]
        assert all(method in caught.value.remedy for method in able) and "\n" not in str(caught.value)
        assert methods_with(other) == tuple(able)


def test_settings_that_no_method_knows_are_unknown():
    with pytest.raises(UnknownNameError, match=r"unknown setting 'aplha'.*alpha"):
        estimator_settings("qp", aplha=1.0)
    with pytest.raises(UnknownNameError, match="method 'best'"):
        estimator_settings("best")


def test_a_method_makes_settings_of_its_own_class():
    found = estimator_settings("hqp", mirror=None, mass_range=0.1)
    assert found == HqpSettings(mirror=None, mass_range=0.1)
    with pytest.raises(InputError, match="mass_range"):
        estimator_settings("hqp", mass_range=-0.1)


class TestSettingsOfAnotherClass:
    def test_what_all_methods_share_fits_every_method(self):
        shared = EstimatorSettings(total_mass=30.0, segment_spread={"a": 0.1})
        for name in ESTIMATORS:
            found = own_settings(find_estimator(name), shared)
            assert type(found) is ESTIMATORS[name].settings_class
            assert (found.total_mass, found.segment_spread) == (30.0, {"a": 0.1})
            assert own_settings(find_estimator(name), None) == ESTIMATORS[name].settings_class()

    def test_what_was_set_is_taken_over_or_refused_never_dropped(self):
        boxes = np.zeros((1, 2, 3))
        given = QpSettings(alpha=2.0, com_boxes=boxes, inertia_floor=0.1)
        found = own_settings(find_estimator("lmi"), given)
        assert isinstance(found, LmiSettings) and found.com_boxes is boxes
        assert (found.alpha, found.inertia_floor) == (2.0, 0.1)
        for odd in (
            HqpSettings(sphere_epsilon=0.02),
            HqpSettings(mirror=None),
            HqpSettings(segment_mass_range={"a": 0.2}),
            Cls3Settings(com_ellipsoids=boxes),
        ):
            with pytest.raises(InputError, match="is not used by method 'lmi'"):
                own_settings(find_estimator("lmi"), odd)

    def test_own_settings_stay_as_they_are(self):
        given = QpSettings(symmetry=0.1)
        assert own_settings(find_estimator("qp"), given) is given


def test_identify_refuses_before_it_works_and_names_the_file_of_bounds():
    robot = load_robot("ur10")
    log = arm_log(robot, 0, trials=1, duration=2.0)
    with pytest.raises(InputError, match="settings: mirror: is not used by method 'adaptive'; choose hqp"):
        identify(robot, log, settings=estimator_settings("hqp", mirror=0.2))
    known = estimator_settings("physical", bounds=KnownBounds(total_mass=(1.0, 2.0), source="known.yaml"))
    with pytest.raises(InputError, match=r"known\.yaml: bounds: .*one of cls1, cls2, cls3, physical"):
        identify(robot, log, "wls", settings=known)


class TestMethodsAreNamed:
    def test_in_the_docstring_of_identify(self):
        assert all(f"``{name}``" in (identify.__doc__ or "") for name in ESTIMATORS)

    def test_in_the_document_with_their_settings(self):
        text = DOCUMENT.read_text(encoding="utf-8")
        rows = [line for line in text.splitlines() if line.startswith("| `")]
        assert rows == [*map(method_row, method_summaries()), *setting_rows()]

    def test_one_is_the_default(self):
        assert [item.name for item in method_summaries() if item.default] == [DEFAULT_METHOD]


def method_row(item: Any) -> str:
    name = f"`{item.name}`" + (" (default)" if item.default else "")
    return f"| {name} | {item.title} | {item.use} | {'yes' if item.consistent else 'no'} |"


def setting_rows() -> list[str]:
    """Every setting once, those that all methods share first."""
    declared = {item.name: item for kind in ESTIMATORS.values() for item in fields(kind.settings_class)}
    rows = []
    for name, item in sorted(declared.items(), key=lambda pair: (pair[0] not in SHARED, pair[0])):
        able = methods_with(name)
        methods = "all" if len(able) == len(ESTIMATORS) else ", ".join(able)
        rows.append(
            f"| `{name}` | {methods} | {default_of(item)} | {allowed(item)} | {item.metadata['what']} |"
        )
    return rows


def default_of(item: Field[Any]) -> str:
    value = None if item.default is MISSING else item.default
    return "–" if value is None or value == () else f"{value:g}" if not isinstance(value, str) else value


def allowed(item: Field[Any]) -> str:
    said = item.metadata
    if "options" in said:
        return ", ".join(said["options"])
    low, high = said["shares"] if "shares" in said else (said.get("low"), said.get("high"))
    unit = said.get("unit", said.get("of", "1"))
    numbers = "" if low is None else f"{low:g} … {high:g}"
    return f"{numbers} {'' if unit == '1' else unit}".strip() or "names"


DECLARED = {item.name: (item, kind) for kind in ESTIMATORS.values() for item in fields(kind.settings_class)}
NUMBERS = [item for item, _ in DECLARED.values() if "low" in item.metadata]


def settings_with(name: str, value: object) -> EstimatorSettings:
    """Settings of a method that knows one of them, with this value."""
    return DECLARED[name][1].settings_class(**{name: value})


@pytest.mark.parametrize("item", NUMBERS, ids=lambda item: item.name)
def test_numbers_keep_to_their_bounds(item):
    low, high, unit = (item.metadata[key] for key in ("low", "high", "unit"))
    assert low < high and item.metadata["what"]
    for value in (low, high):
        assert getattr(settings_with(item.name, value), item.name) == value
    for value in (low - max(1e-9, 1e-6 * abs(low)), high * (1.0 + 1e-9), np.inf, np.nan, "1", True, [1.0]):
        with pytest.raises(InputError) as caught:
            settings_with(item.name, value)
        assert caught.value.field == item.name
        assert caught.value.remedy == f"choose {low:g} … {high:g}" + ("" if unit == "1" else f" {unit}")
    if item.name in ("total_mass", "symmetry", "mirror"):
        assert getattr(settings_with(item.name, None), item.name) is None
    else:
        with pytest.raises(InputError, match=item.name):
            settings_with(item.name, None)


def test_single_segments_have_their_own_spread_and_range(g1):
    links = [segment.link for segment in g1.segments]
    settings = HqpSettings(
        prior_spread=0.2, segment_spread={links[3]: 0.7}, mass_range=0.1, segment_mass_range={links[5]: 0.4}
    )
    expected = np.full(len(links), 0.2)
    expected[3] = 0.7
    assert np.array_equal(settings.spreads(g1), expected)
    expected = np.full(len(links), 0.1)
    expected[5] = 0.4
    assert np.array_equal(settings.mass_ranges(g1), expected)
    assert replace(settings, asymmetric=(links[4], links[2])).free_of_symmetry(g1) == (4, 2)
    for wrong in ({"segment_mass_range": {"nose": 0.1}}, {"asymmetric": ("nose",)}):
        with pytest.raises(UnknownNameError, match="nose"):
            odd = replace(settings, **wrong)
            odd.mass_ranges(g1)
            odd.free_of_symmetry(g1)
