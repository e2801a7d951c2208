"""Angles in another unit are no lengths in another unit, and dry friction tells no unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import excite
from excite.doctor.channel_mapping import Reading
from excite.doctor.examine import examine
from excite.doctor.torque_samples import torque_samples
from tests.conversion.test_guesses import named, table
from tests.conversion.test_slides import LIFT, lift_motion, lifted


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    """The robot on a lift, and a log of it whose lift is moved by dry friction and weight alone."""
    folder = tmp_path_factory.mktemp("lift")
    arm, data = lifted(folder), lift_motion()
    data["time"], data["v"] = 4.0 * data["time"], 0.25 * data["v"]
    data["tau"][:, 0] = 60.0 + 20.0 * np.sign(data["v"][:, 0])
    columns = named(data, q="q{n}", v="v{n}", tau="tau{n}")
    file = table(folder / "run.csv", {"t": data["time"]} | columns)
    return excite.load_robot(arm), excite.convert([file], arm, folder / "log").log


def test_a_lift_is_not_in_degrees_where_the_arm_on_it_is(lift):
    robot, log = lift
    turned = np.array([1.0, *np.degrees([1.0, 1.0])])
    trials = tuple(replace(t, q=t.q * turned, v=t.v * turned, q_cmd=None) for t in log.trials)
    chart = examine(robot, replace(log, trials=trials))
    (finding,) = [f for f in chart.findings if f.kind == "degrees"]
    assert LIFT not in finding.places
    for read, trial in zip(chart.log.trials, log.trials, strict=True):
        np.testing.assert_allclose(read.q, trial.q, atol=1e-9)


def test_slow_dry_friction_is_no_better_explained_by_turns(lift):
    """Its change of sign is sharper in another unit, which says nothing of the unit."""
    robot, log = lift
    samples = torque_samples(robot, log)
    stated = Reading.as_stated(log)
    turning = [False] * len(log.header.joints)
    left, turns = (
        samples.judged(r).left for r in (stated, replace(stated, unit=np.where(turning, 1.0, 2.0 * np.pi)))
    )
    assert left[0] - turns[0] < 0.05
