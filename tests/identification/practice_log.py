"""A log of an arm with known faults: torques of a model that is off from the nominal one, drives, noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.logs.log import Log, LogHeader, Trial
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.robot import Robot
from excite.rows.drive_terms import smooth_sign
from tests.identification.synthetic import smooth

RATE = 100.0


def arm_log(
    robot: Robot,
    seed: int = 0,
    *,
    torque: str = "motor_side",
    trials: int = 3,
    duration: float = 8.0,
    true: np.ndarray | None = None,
    sessions: tuple[str, ...] = (),
    change: float = 0.0,
) -> Log:
    """Smooth motions; masses and moments off by up to 10 %, or ``true``.

    ``change`` is the relative spread of the parameters between ``sessions``.
    """
    rng = np.random.default_rng(seed)
    n, nominal = robot.n_joints, robot.nominal_parameters
    true = nominal * np.repeat(rng.uniform(0.9, 1.1, len(nominal) // 10), 10) if true is None else true
    limits = robot.limits
    middle = 0.5 * (limits.position_lower + limits.position_upper)
    size = np.minimum(0.45 * (limits.position_upper - limits.position_lower), 1.5)
    own = np.array([np.mean(np.abs(joint_torque_regressor(robot.model, middle[None], v, v) @ nominal))
                    for v in np.zeros((n, 1, n))])  # fmt: skip
    scale = np.maximum(own.max() * np.geomspace(1.0, 0.05, n), 0.05)
    factors = {name: 1.0 + change * rng.standard_normal(len(nominal) // 10) for name in sessions}
    made = []
    for k in range(trials):
        time = np.arange(0.0, duration, 1.0 / RATE)
        x, v, a = smooth(rng, time, size, top_hz=0.6)
        session = sessions[k % len(sessions)] if sessions else None
        parameters = true * (np.repeat(factors[session], 10) if session else 1.0)
        tau = joint_torque_regressor(robot.model, middle + x, v, a) @ parameters
        if torque == "motor_side":
            tau = tau + 0.05 * scale * v + 0.06 * scale * smooth_sign(v, 0.01) + 0.08 * a
        tau = tau + 0.01 * scale * rng.standard_normal(tau.shape)
        made.append(
            Trial(
                name=f"trial_{k:02d}",
                role="validation" if k == trials - 1 and not sessions else "identification",
                time=time,
                q=middle + x,
                tau=tau,
                q_cmd=middle + x + 1e-3 * rng.standard_normal(x.shape),
                session=session,
            )
        )
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "robot.urdf",
            "base": "fixed",
            "rate_hz": RATE,
            "joints": list(robot.joint_names),
            "torque": torque,
            "trials": [{"file": f"{t.name}.csv", "role": t.role, "session": t.session} for t in made],
        }
    )
    return Log(header, tuple(made))


def changed(log: Log, change, **header) -> Log:
    """The log with every trial changed by a function, and header fields replaced."""
    return replace(
        log,
        trials=tuple(change(trial) for trial in log.trials),
        header=log.header.model_copy(update=header),
    )
