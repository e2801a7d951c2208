"""An entry by mujoco.sysid: all its parameters fitted at once, the largest change named."""

from __future__ import annotations

from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from excite.blind.entry.log import arm_log
from excite.blind.entry.sysid_fit import TrialFit
from excite.errors import InputError

# Evaluations of scipy's trust region with sysid's Jacobian. Tried on one UR10 before the torques were those that the
# integrator applies: twelve on 5 s took the cost from 49472 to 119, eight of its own Levenberg-Marquardt on 10 s from
# 94070 to 7134. Eight is what a case can cost, 15 s; whether more would change a name was not tried.
_ITERATIONS = 8


def fitted_by_sysid(folder: Path) -> dict[str, Any]:
    """Answer (``excite.blind_answer/1``) to one case.

    The nominal MuJoCo model under the log's servo follows the log's commands; joints' damping, dry friction, rotor
    inertia and springs, masses and centres of mass of the links, bias of every torque, one delay of them all and,
    where bodies are given, every torque's gain are fitted by ``mujoco.sysid.optimize`` to positions and torques of the
    first trial. The largest change is that of the parameters that are farthest from nominal in units of what their
    covariance (``mujoco.sysid.calculate_intervals``) lets one expect; terms that the log calls modelled, and bodies
    where they are free, are the baseline's and not named. Its share of a joint is what the torque's mean square there
    loses when it is put back to nominal, of the sum of what those that could be named lose so one by one.

    Args:
        folder: of the log.

    Returns:
        The answer; nothing is named where no change leaves its 95 % interval.

    Raises:
        InputError: a library that mujoco.sysid needs is not installed.
        LogError: no log of an arm with torques and commands under a position servo whose gains are stated.
    """
    try:
        # mypy would take the types of this part for those of all of mujoco.
        sysid: Any = import_module("mujoco.sysid")
        optimize = sysid.optimize
    except (ImportError, AttributeError) as error:
        remedy = "pip install 'excite[sysid]'"
        raise InputError("mujoco.sysid lacks libraries", remedy=remedy) from error
    log = arm_log(folder)
    trial = next(trial for trial in log.log.trials if trial.role == "identification")
    fit = TrialFit(log, trial, sysid)
    start = fit.parameters()
    nominal = start.as_nominal_vector()
    # It prints a line an iteration, whatever it is told.
    with redirect_stdout(StringIO()):
        fitted, solution = optimize(
            initial_params=start,
            residual_fn=fit.residual,
            optimizer="scipy_parallel_fd",
            verbose=False,
            max_iters=_ITERATIONS,
            x_scale="jac",
        )
    best = fitted.as_vector()
    full = fit.squares(best, fitted)
    residuals = fit.residual(best, fitted)[0]
    covariance, _ = sysid.calculate_intervals([r.ravel() for r in residuals], solution.jac)
    groups = [group for group in fit.groups if fit.nameable(group)]
    changes, lost = [], []
    for group in groups:
        at = fit.where[group.name]
        change = best[at] - nominal[at]
        changes.append(float(change @ np.linalg.pinv(covariance[at, at]) @ change) / len(change))
        without = best.copy()
        without[at] = nominal[at]
        lost.append(np.maximum((fit.squares(without, fitted) - full)[log.robot.n_joints :], 0.0))
    effects = []
    # What is within its 95 % interval has not changed.
    if groups and max(changes) > 1.96**2:
        k = int(np.argmax(changes))
        taken = np.sum(lost, axis=0)
        for joint, own, total in zip(log.robot.joint_names, lost[k], taken, strict=True):
            effects.append(
                {
                    "effect": groups[k].effect,
                    "location": groups[k].location,
                    "channel": joint,
                    "share": float(own / total) if total > 0.0 else 0.0,
                }
            )
    return {"schema": "excite.blind_answer/1", "program": "mujoco.sysid, largest change", "effects": effects}
