"""Steps of long work are told to whoever asked for them, and to nobody else."""

from __future__ import annotations

import pytest

import excite
from excite.logs.log import Log
from excite.progress import step, told_to

Told = list[tuple[str, int, int]]


def recorder(said: Told):
    return lambda *told: said.append(told)


def test_steps_are_told_where_they_begin_and_end() -> None:
    said: Told = []

    @step("inner")
    def inner() -> None:
        said.append(("working", 0, 0))

    with told_to(recorder(said)), step("outer"):
        inner()
    inner()
    inside = [("inner", 0, 1), ("working", 0, 0), ("inner", 1, 1)]
    assert said == [("outer", 0, 1), *inside, ("outer", 1, 1), ("working", 0, 0)]


@pytest.fixture(scope="module")
def log() -> Log:
    robot = excite.load_robot("so101")
    motions = excite.load_motions("so101")[:2]
    roles = {motions[1].name: "validation"}
    return excite.simulate(robot, motions, roles=roles, nominal=True, seed=1).log


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_verbs_without_anything_to_count_tell_their_steps(verb: str, log: Log) -> None:
    said: Told = []
    robot = excite.load_robot("so101")
    if verb == "identify":
        excite.identify(robot, log, "ls", progress=recorder(said))
    else:
        excite.diagnose(log, robot, progress=recorder(said))
    steps = [name for name, done, _ in said if done == 0]
    assert steps[0] == "look the log through" and len(set(steps)) > 2
    assert sorted(name for name, done, _ in said if done == 1) == sorted(steps)
