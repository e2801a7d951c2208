"""UR10e: gains of the drives from a known load, and the load weighed by a part of the log not used for them."""

from __future__ import annotations

from pathlib import Path

from excite.identification.load import weigh_load
from excite.logs.log import Log
from excite.logs.robot import nominal_robot
from tests.reproduction.recordings import UR10E_GAINS
from tests.reproduction.ur10e_load import MASS, PLAIN, SETTINGS, run_of_14_harmonics


def part_of_log(data_dir: Path, folder: Path, name: str, part: tuple[float, float], load: str = "") -> Log:
    """A part of the run with 14 harmonics, without or with the load."""
    return run_of_14_harmonics(data_dir, folder, name, {"identification": part}, load=bool(load))


def test_the_load_is_weighed_within_three_percent(data_dir: Path, tmp_path: Path) -> None:
    """Measured when written: 2.792 and 2.824 kg for the halves, gains 10.8 12.3 10.0 10.3 10.2 10.3 N·m/A."""
    bare = part_of_log(data_dir, tmp_path, "bare", (0.0, 1.0))
    first = part_of_log(data_dir, tmp_path, "first", (0.0, 0.5), "Load")
    second = part_of_log(data_dir, tmp_path, "second", (0.5, 1.0), "Load")
    robot = nominal_robot(bare)
    for known, judged in ((first, second), (second, first)):
        gains = weigh_load(robot, bare, known, mass=MASS, settings=PLAIN).gains
        load = weigh_load(robot, bare, judged, gains=gains, settings=PLAIN)
        assert abs(load.mass / MASS - 1.0) < 0.03, load.summary()
    # The published gains make the load a tenth too heavy.
    published = weigh_load(robot, bare, second, gains=UR10E_GAINS, settings=PLAIN)
    assert published.mass > 1.05 * MASS


def test_the_load_is_inside_an_interval_of_a_tenth_of_a_kilogram(data_dir: Path, tmp_path: Path) -> None:
    """Gains and both loads in one fit; gains first and the load after them left ± 0.125 and 0.130 kg."""
    bare = part_of_log(data_dir, tmp_path, "bare", (0.0, 1.0))
    first = part_of_log(data_dir, tmp_path, "first", (0.0, 0.5), "Load")
    second = part_of_log(data_dir, tmp_path, "second", (0.5, 1.0), "Load")
    for known, judged in ((first, second), (second, first)):
        found = weigh_load(nominal_robot(bare), bare, judged, calibration=(known, MASS), settings=SETTINGS)
        assert abs(found.mass - MASS) < found.half_width_95[0] <= 0.1, found.summary()
