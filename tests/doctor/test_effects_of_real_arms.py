"""What an arm carries, or what its channels leak, in recordings of real arms: no mistake in how channels are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.planted import machines
from benchmarks.planted.planting import TERM, Bench, Effect
from benchmarks.planted.score import modelled_beside, save_log
from excite.doctor.examine import examine
from excite.logs.files import load_log
from excite.logs.robot import nominal_robot
from tests.conftest import lacking


@pytest.mark.parametrize(
    ("name", "effect"),
    [
        # A tenth of what the elbow carries is several times what the wrist needs.
        ("xmate", Effect("torque_crosstalk", 4, -0.14)),
        ("xmate", Effect("torque_crosstalk", 4, -0.09)),
        # Weight turns a wrist as another zero of it would, which the record tells to no better than the zero itself.
        ("lwr", "payload"),
    ],
)
def test_effects_are_no_misreadings(name: str, effect: Effect | str, tmp_path: Path) -> None:
    machine = next(one for one in machines.MACHINES if one.name == name)
    if not machine.source.is_dir():
        lacking(f"recordings not found in {machine.source}; set EXCITE_DATA to the folder that holds them")
    bench = Bench(machine)
    planted = (
        bench.draw(effect, np.random.default_rng([26, 0, 3720288156])) if isinstance(effect, str) else effect
    )
    runs = bench.plant(bench.without(TERM[planted.name]), planted)
    log = load_log(save_log(tmp_path / "log", machine, runs, modelled_beside(planted.name)))
    found = examine(nominal_robot(log), log).findings
    assert not {one.kind for one in found} & {"torque_scale", "zero_position"}
