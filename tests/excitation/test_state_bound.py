"""The bound over states: no measure and no motion tells more, and a design that is known tells as much."""

from __future__ import annotations

import numpy as np
import pytest

from excite.excitation.design_rows import ArmRows
from excite.excitation.gradient_design import design_motions, first_information
from excite.excitation.selection import LogDeterminant
from excite.excitation.state_bound import bound_log_det, d_efficiency
from excite.motion.collection import load_motions
from excite.robot.robot import Robot


def test_no_states_and_no_motions_tell_more_than_the_bound(ur10: Robot) -> None:
    rows, limits = ArmRows(ur10), ur10.limits
    bound = bound_log_det(rows)
    rng = np.random.default_rng(5)
    # The best of measures that put states at the limits, without a look at torques: not even these get there.
    n = (4000, ur10.n_joints)
    q = rng.uniform(limits.position_lower, limits.position_upper, n)
    v, a = (rng.choice([-1.0, 1.0], n) * limit for limit in (limits.velocity, limits.acceleration))
    reached = np.linalg.slogdet(rows.information(q, v * rng.uniform(size=n), a) / n[0])[1]
    assert bound - 1.5 * len(rows.independent) < reached < bound
    assert bound_log_det(rows, seed=1) == pytest.approx(bound, abs=0.05 * len(rows.independent))
    source = load_motions("ur10")[0]
    designs = design_motions(rows, [source], first_information(rows, [source]), LogDeterminant())
    plain, designed = (d_efficiency(rows, [m], bound) for m in (source, designs[0].motion))
    assert 0.0 < 2.0 * plain < designed < 0.5
