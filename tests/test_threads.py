"""The answer does not depend on the number of BLAS threads."""

from __future__ import annotations

import hashlib
import json
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from excite.arrays import Array
from excite.identification.estimators.registry import ESTIMATORS, find_estimator
from excite.identification.identify import identify_problem
from excite.robot.loading import load_robot
from tests.identification.coverage import Case, Experiment
from tests.identification.estimated import estimated
from tests.identification.synthetic import arm_problem


class Answer(NamedTuple):
    """Digests of documents of the verb, and parameters of bare estimators."""

    documents: list[str]
    parameters: Array


def _answer(threads: int) -> Answer:
    robot = load_robot("panda")
    with threadpool_limits(threads, user_api="blas"):
        assert {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"} == {threads}
        problem = Experiment("panda", Case(5.0, every=2), duration=8.0).problem(0)
        found = (identify_problem(problem, None, find_estimator(method)) for method in ("wls", "qp"))
        digests = [hashlib.sha256(json.dumps(one.to_json()).encode()).hexdigest() for one in found]
        bare = arm_problem(robot, seed=0, duration=2.0)
        names = [name for name in ESTIMATORS if name != "physical"]
        estimates = [estimated(ESTIMATORS[name](), bare, sphere_epsilon=1e-3).parameters for name in names]
    return Answer(digests, np.array(estimates))


def test_one_thread_or_two_give_the_same_bytes_and_every_method_the_same_torques() -> None:
    """Bytes are those of the verb, which keeps to one thread; of bare estimators it is what they predict."""
    one, two = _answer(1), _answer(2)
    assert one.documents == two.documents
    rows = arm_problem(load_robot("panda"), seed=0).Y
    np.testing.assert_allclose(one.parameters @ rows.T, two.parameters @ rows.T, atol=1e-7)
