"""The answer does not depend on the number of BLAS threads."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import hashlib, json
from excite.identification.estimators.registry import find_estimator
from excite.identification.identify import identify_problem
from tests.identification.coverage import Case, Experiment

problem = Experiment("panda", Case(5.0, every=2), duration=8.0).problem(0)
for method in ("wls", "qp"):
    found = identify_problem(problem, None, find_estimator(method))
    print(hashlib.sha256(json.dumps(found.to_json()).encode()).hexdigest())
"""


def _answer(threads: int) -> str:
    variables = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    environment = os.environ | dict.fromkeys(variables, str(threads))
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_one_thread_or_two_give_the_same_bytes() -> None:
    assert _answer(1) == _answer(2) != ""
