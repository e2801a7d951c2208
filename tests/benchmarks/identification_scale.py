"""Memory and time of the whole identification on 120 000 rows and 310 columns."""

from __future__ import annotations

import json
import subprocess
import sys

from tests.benchmarks.table import Row

_PROGRAM = """
import json, resource, sys, time
import numpy as np
from excite.identification.estimators.registry import find_estimator
from excite.identification.identify import identify_problem
from excite.robot.loading import load_robot
from tests.benchmarks.identification_scale import big_problem

robot = load_robot("g1")
problem = big_problem(robot)
built, used = time.perf_counter(), time.process_time()
found = identify_problem(problem, None, find_estimator(sys.argv[1]))
print(json.dumps({
    "rows": problem.n_rows, "columns": problem.n_params,
    "wall": time.perf_counter() - built, "processor": time.process_time() - used,
    "gigabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
}))
"""
N_ROWS, N_COLUMNS = 120_000, 310


def rows() -> list[Row]:
    """Peak memory of a fresh process, and how long it identified."""
    table = []
    for method in ("wls", "qp"):
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM, method], capture_output=True, text=True, check=False
        )
        if done.returncode:
            what = f"identification of {N_ROWS} rows by {method}"
            table.append(Row.holds(what, "runs", done.stderr.strip()[-200:], False))
            continue
        found = json.loads(done.stdout.splitlines()[-1])
        what = f"whole identification by {method}, {found['rows']} rows × {found['columns']} columns"
        table.append(Row.at_most(f"{what}: memory", found["gigabytes"], 2.0, "GB"))
        spent = f"{found['processor']:.1f} s (wall {found['wall']:.1f} s)"
        table.append(Row(f"{what}: processor's time", "", spent, None))
    return table


def big_problem(robot):
    """Base rows of a floating base: one motion of 200 s at 100 Hz, and ten columns more than the bodies'."""
    import numpy as np

    from excite.identification.problem import IdentificationProblem
    from excite.regressor.kernels import base_link_regressor
    from excite.rows.settings import Filters
    from tests.identification.synthetic import NAMES, smooth

    rng = np.random.default_rng(0)
    n = N_ROWS // 6
    time = np.arange(n) / 100.0
    limits = robot.limits
    middle, size = (
        0.5 * (limits.position_lower + limits.position_upper),
        0.45 * (limits.position_upper - limits.position_lower),
    )
    x, v, a = smooth(rng, time, size)
    _, twist, change = smooth(rng, time, np.array([0.05, 0.05, 0.05, 0.15, 0.15, 0.15]))
    lean, _, _ = smooth(rng, time, np.full(3, 0.15))
    quaternion = np.column_stack([lean / 2, np.ones(n)])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    q = np.column_stack([np.zeros((n, 3)), quaternion, middle + x])
    inertial = robot.nominal_parameters
    extra = N_COLUMNS - len(inertial)
    matrix = np.empty((N_ROWS, N_COLUMNS))
    for start in range(0, n, 1000):
        part = slice(start, start + 1000)
        block = base_link_regressor(
            robot.model, q[part], np.hstack([twist, v])[part], np.hstack([change, a])[part]
        )
        matrix[6 * start : 6 * (start + len(block)), : len(inertial)] = block.reshape(-1, len(inertial))
    channel = np.tile(np.arange(6), n)
    for k in range(extra):
        matrix[:, len(inertial) + k] = np.where(channel == k % 6, np.repeat(v[:, k], 6), 0.0)
    sigma = np.array([1.0] * 3 + [0.1] * 3)[channel]
    true = np.concatenate([1.05 * inertial, np.full(extra, 0.1)])
    return IdentificationProblem(
        robot=robot,
        Y=matrix,
        y=matrix @ true + sigma * rng.standard_normal(N_ROWS),
        weights=1.0 / sigma,
        channel=channel,
        channel_names=("fx", "fy", "fz", "tx", "ty", "tz"),
        channel_units=("N",) * 3 + ("N·m",) * 3,
        time=np.repeat(time, 6),
        trial=np.zeros(N_ROWS, dtype=np.int64),
        trial_names=("only",),
        parameter_names=(
            *(f"{s.link}.{name}" for s in robot.segments for name in NAMES),
            *(f"viscous.{robot.joint_names[k]}" for k in range(extra)),
        ),
        prior=np.concatenate([inertial, np.zeros(extra)]),
        n_inertial=len(inertial),
        filters=Filters(50.0, 50.0, 4, 100.0),
        sampling_hz=100.0,
    )
