"""robot.yaml with numbers that no robot has: refused, with the likely cause, and never anything but an error."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from excite.errors import ExciteError, RobotError
from excite.robot.catalogue import bundled_robots, data_folder
from excite.robot.description import RobotDescription
from excite.robot.loading import load_robot
from excite.robot.quantities import looks_like_degrees
from tests.corpus.arm import YAML, replaced
from tests.robot.small import ARM, ELBOW_LIMIT

NASTY: list[Any] = [
    None, True, "", "x", "nan", "１", "\n", [], {}, [[]], {"": 1}, 0, -1, 1e300, -1e300, math.inf, -math.inf,
    10**400, "9" * 5000, "../../..", "/dev/zero", "\0", ["a", "a"], {"elbow": 1e9}, {"nobody": 1.0},
]  # fmt: skip


def numeric_leaves(node: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of all numbers in a document."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield from numeric_leaves(value, (*place, key))
    if isinstance(node, int | float) and not isinstance(node, bool):
        yield place


def all_places(node: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of all values in a document."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield (*place, key)
        yield from all_places(value, (*place, key))


def changed(document: Any, place: tuple[Any, ...], value: Any) -> Any:
    """The document with another value at a place."""
    document = copy.deepcopy(document)
    node = document
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = value
    return document


def arm(folder: Path, text: str = YAML, urdf: str = ARM) -> Path:
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", bundled_robots())
def test_every_number_of_every_bundled_robot_is_bounded(name: str) -> None:
    document = yaml.safe_load((data_folder("robots") / name / "robot.yaml").read_text(encoding="utf-8"))
    places = list(numeric_leaves(document))
    assert len(places) > 10
    for place in places:
        for value in (math.nan, math.inf, 1e300, -1e300, True, "１"):
            with pytest.raises(ValidationError):
                RobotDescription.model_validate(changed(document, place, value))


@pytest.mark.parametrize("degrees", [90, -120, 170.0, 180, 355, 360, 114.6, 45, 30, -65.5])
def test_degrees_are_recognised(degrees: float) -> None:
    assert looks_like_degrees(degrees)


@pytest.mark.parametrize(
    "radians", [0.0, -3.14, 6.2832, 12.566, 18.85, 25.0, 62.83, -62.8319, 314.159, 628.32]
)
def test_many_turns_are_no_degrees(radians: float) -> None:
    assert not looks_like_degrees(radians)


def test_a_joint_of_ten_turns_loads(tmp_path: Path) -> None:
    urdf = replaced(ARM, ELBOW_LIMIT, ELBOW_LIMIT.replace("2.0", "62.83"))
    robot = load_robot(arm(tmp_path, urdf=urdf))
    assert robot.limits.position_upper[1] == pytest.approx(62.80)


def test_a_hinge_without_end_asks_for_limits(tmp_path: Path) -> None:
    """Exporters write 1e16 where a hinge turns without end; that is no limit that a motion could keep."""
    urdf = replaced(ARM, ELBOW_LIMIT, ELBOW_LIMIT.replace("2.0", "1e16"))
    with pytest.raises(RobotError, match=r"turns without end; state limits\.position\.joints\.elbow"):
        load_robot(arm(tmp_path, urdf=urdf))
    text = replaced(YAML, "position: {joints: {}", "position: {joints: {elbow: [-3, 3]}")
    assert load_robot(arm(tmp_path, text, urdf)).limits.position_upper[1] == pytest.approx(2.97)


@pytest.mark.parametrize("torque", ["20", "0"])
def test_masses_in_grams_are_refused_where_drives_are_known(torque: str, tmp_path: Path) -> None:
    grams = ARM.replace('value="2.0"', 'value="2000"').replace('value="1.0"', 'value="1000"')
    grams = grams.replace('effort="20"', f'effort="{torque}"')
    text = replaced(YAML, "  jerk:", "  torque: {joints: {elbow: 20.0}, source: test}\n  jerk:")
    with pytest.raises(RobotError, match="looks like grams"):
        load_robot(arm(tmp_path, text, grams))


def test_a_heavy_robot_with_strong_drives_loads(tmp_path: Path) -> None:
    """An excavator's arm: tonnes, but of steel's density and carried by its drives."""
    heavy = ARM.replace('value="2.0"', 'value="2000"').replace('value="1.0"', 'value="1000"')
    for old, new in (("0.03", "300"), ("0.004", "40"), ("0.01", "100"), ("0.002", "20")):
        heavy = heavy.replace(f'="{old}"', f'="{new}"')
    strong = heavy.replace('effort="50"', 'effort="50000"').replace('effort="20"', 'effort="20000"')
    assert load_robot(arm(tmp_path, urdf=strong)).mass == pytest.approx(3000.0)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_changed_description_loads_or_is_refused(tmp_path: Path, data: st.DataObject) -> None:
    document = yaml.safe_load(YAML)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(list(all_places(document))))
        document = changed(document, place, data.draw(st.sampled_from(NASTY)))
    path = arm(tmp_path, yaml.safe_dump(document, allow_unicode=True))
    try:
        robot = load_robot(path)
    except ExciteError as error:
        assert "\n" not in str(error)
        assert str(tmp_path) in str(error) or "/dev/zero" in str(error)
    else:
        assert all(math.isfinite(value) for value in (*robot.rest, *robot.limits.torque, robot.mass))


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_changed_text_loads_or_is_refused(tmp_path: Path, data: st.DataObject) -> None:
    lines = YAML.splitlines()
    index = data.draw(st.integers(0, len(lines) - 1))
    kind = data.draw(st.sampled_from(["drop", "twice", "cut", "noise"]))
    line = lines[index]
    cut = data.draw(st.integers(0, len(line)))
    noise = data.draw(st.text(max_size=5))
    lines[index : index + 1] = {
        "drop": [],
        "twice": [line, line],
        "cut": [line[:cut]],
        "noise": [line[:cut] + noise + line[cut:]],
    }[kind]
    try:
        text = "\n".join(lines)
        text.encode()
    except UnicodeEncodeError:
        return
    try:
        load_robot(arm(tmp_path, text))
    except ExciteError:
        pass
