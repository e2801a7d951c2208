"""An arm that is its model, as the virtual robot of this toolkit records it, has no gap."""

from __future__ import annotations

import pytest

import excite

ROBOTS = ("so101", "ur10", "panda", "iiwa14", "jaco2")
SAMPLE = ROBOTS[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [SAMPLE, *(pytest.param(name, marks=pytest.mark.battery) for name in ROBOTS if name != SAMPLE)]
)
def test_its_own_simulation_has_no_gap(name: str) -> None:
    robot = excite.load_robot(name)
    motions = excite.plan(robot, n_candidates=8, seed=3).motions
    roles = {motion.name: "identification" for motion in motions} | {motions[-1].name: "validation"}
    log = excite.simulate(robot, motions, nominal=True, roles=roles, seed=1).log
    found = excite.diagnose(log, robot)
    assert (found.verdict, found.effects) == ("none", ()), found.sentence()
