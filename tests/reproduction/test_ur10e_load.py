"""UR10e: gains of the drives from a known load, and the load weighed by a part of the log not used for them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import pytest

from excite.identification.load import weigh_load
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.reproduction.recordings import UR10E_GAINS
from tests.reproduction.ur10e_load import MASS, PLAIN, SETTINGS, run_of_14_harmonics


class Parts(NamedTuple):
    """The run with 14 harmonics without the load, and both halves of it with the load."""

    bare: Log
    halves: tuple[Log, Log]


@pytest.fixture(scope="module")
def parts(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Parts:
    folder = tmp_path_factory.mktemp("ur10e")

    def part(name: str, span: tuple[float, float], *, load: bool) -> Log:
        return run_of_14_harmonics(data_dir, folder, name, {"identification": span}, load=load)

    first, second = part("first", (0.0, 0.5), load=True), part("second", (0.5, 1.0), load=True)
    return Parts(part("bare", (0.0, 1.0), load=False), (first, second))


def test_the_load_is_weighed_within_three_percent(parts: Parts) -> None:
    """Measured when written: 2.792 and 2.824 kg for the halves, gains 10.8 12.3 10.0 10.3 10.2 10.3 N·m/A."""
    robot = nominal_robot(parts.bare)
    for known, judged in (parts.halves, parts.halves[::-1]):
        gains = weigh_load(robot, parts.bare, known, mass=MASS, settings=PLAIN).gains
        load = weigh_load(robot, parts.bare, judged, gains=gains, settings=PLAIN)
        assert abs(load.mass / MASS - 1.0) < 0.03, load.summary()
    # The published gains make the load a tenth too heavy.
    published = weigh_load(robot, parts.bare, parts.halves[1], gains=UR10E_GAINS, settings=PLAIN)
    assert published.mass > 1.05 * MASS


def test_the_load_is_inside_an_interval_of_a_tenth_of_a_kilogram(parts: Parts) -> None:
    """Gains and both loads in one fit; gains first and the load after them left ± 0.125 and 0.130 kg."""
    robot = nominal_robot(parts.bare)
    for known, judged in (parts.halves, parts.halves[::-1]):
        found = weigh_load(robot, parts.bare, judged, calibration=(known, MASS), settings=SETTINGS)
        assert abs(found.mass - MASS) < found.half_width_95[0] <= 0.1, found.summary()
