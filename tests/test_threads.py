"""The answer does not depend on the number of BLAS threads."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from excite.robot.loading import load_robot
from tests.identification.synthetic import arm_problem

PROGRAM = """
import hashlib, json, sys
import numpy as np
from excite.identification.estimators.registry import (ESTIMATORS, find_estimator)
from excite.identification.identify import identify_problem
from excite.robot.loading import load_robot
from tests.identification.coverage import Case, Experiment
from tests.identification.estimated import estimated
from tests.identification.synthetic import arm_problem

problem = Experiment("panda", Case(5.0, every=2), duration=8.0).problem(0)
for method in ("wls", "qp"):
    found = identify_problem(problem, None, find_estimator(method))
    print(hashlib.sha256(json.dumps(found.to_json()).encode()).hexdigest())
problem = arm_problem(load_robot("panda"), seed=0, duration=2.0)
names = [name for name in ESTIMATORS if name != "physical"]
np.save(sys.argv[1], [estimated(ESTIMATORS[name](), problem, sphere_epsilon=1e-3).parameters for name in names])
"""


def _answer(threads: int, parameters: Path) -> str:
    variables = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    environment = os.environ | dict.fromkeys(variables, str(threads))
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(parameters)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_one_thread_or_two_give_the_same_bytes_and_every_method_the_same_torques(tmp_path: Path) -> None:
    """Bytes are those of the verb, which keeps to one thread; of bare estimators it is what they predict."""
    files = [tmp_path / f"{threads}.npy" for threads in (1, 2)]
    assert _answer(1, files[0]) == _answer(2, files[1]) != ""
    rows = arm_problem(load_robot("panda"), seed=0).Y
    one, two = (np.load(file) @ rows.T for file in files)
    np.testing.assert_allclose(one, two, atol=1e-7)
