"""An entry by mujoco.sysid: all its parameters fitted at once, the largest change named."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from excite.blind.entry.log import arm_log
from excite.blind.entry.sysid_fit import TrialFit
from excite.errors import InputError

# Evaluations of scipy's trust region with sysid's Jacobian. On a UR10 whose elbow alone has viscous friction twelve of
# them take the cost from 49472 to 119; eight of sysid's own Levenberg-Marquardt leave 7134 of 94070.
_ITERATIONS = 8


def fitted_by_sysid(folder: Path) -> dict[str, Any]:
    """Answer (``excite.blind_answer/1``) to one case.

    The nominal MuJoCo model under the log's servo follows the log's commands; joints' damping, dry friction, rotor
    inertia and springs, masses and centres of mass of the links, bias of every torque, one delay of them all and,
    where bodies are given, every torque's gain are fitted by ``mujoco.sysid.optimize`` to positions and torques of the
    first trial. The change that is largest is the one without which the fit's sum of squares grows most; terms that
    the log calls modelled, and bodies where they are free, are the baseline's and not named. Its share of a joint is
    what the torque's mean square there loses when it is put back to nominal, of what all of those that could be named
    take.

    Args:
        folder: of the log.

    Returns:
        The answer; nothing is named where no change is worth its price in BIC.

    Raises:
        InputError: a library that mujoco.sysid needs is not installed.
        LogError: no log of an arm with torques and commands under a position servo whose gains are stated.
    """
    try:
        from mujoco import sysid

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
        fitted, _ = optimize(
            initial_params=start,
            residual_fn=fit.residual,
            optimizer="scipy_parallel_fd",
            verbose=False,
            max_iters=_ITERATIONS,
            x_scale="jac",
        )
    best = fitted.as_vector()
    groups = [group for group in fit.groups if fit.nameable(group)]
    full = fit.squares(best, fitted)
    count = fit.count
    gains = []
    for group in groups:
        x = best.copy()
        for name in group.names:
            at = fit.where[name]
            x[at] = nominal[at]
        left = fit.squares(x, fitted)
        price = len(group.names) * np.log(count) * full.sum() / count
        gains.append((float((left - full).sum() - price), left - full))
    effects = []
    if gains and max(gain for gain, _ in gains) > 0.0:
        k = int(np.argmax([gain for gain, _ in gains]))
        n = log.robot.n_joints
        taken = np.sum([np.maximum(lost[n:], 0.0) for _, lost in gains], axis=0)
        for joint, lost, total in zip(log.robot.joint_names, gains[k][1][n:], taken, strict=True):
            share = float(lost / total) if total > 0.0 else 0.0
            effects.append(
                {
                    "effect": groups[k].effect,
                    "location": groups[k].location,
                    "channel": joint,
                    "share": min(max(share, 0.0), 1.0),
                }
            )
    return {"schema": "excite.blind_answer/1", "program": "mujoco.sysid, largest change", "effects": effects}
