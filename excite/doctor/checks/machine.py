"""Trials to learn from and to judge by that are not of the same machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.doctor.check import Check, Outcome
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import drive_fit, torque_samples
from excite.finding import Finding, listed
from excite.logs.log import Log
from excite.robot.robot import Robot

# What the other trials' fit leaves, beside what their own leaves, as share of the torque's power: masses, gains and
# friction of one robot differ less between its motions.
_WORSE, _MUCH = 4.0, 0.25


class OtherMachine(Check):
    """What is fitted joint by joint to the trials to learn from explains the trials to judge by as well."""

    kinds = ("other_machine",)

    def examine(self, robot: Robot, log: Log) -> Outcome:
        if log.header.base != "fixed" or log.header.torque in {None, "none"} or not log.role("validation"):
            return Outcome(log)
        judge = replace(log, trials=tuple(replace(t, role="identification") for t in log.role("validation")))
        learnt, judged = torque_samples(robot, log), torque_samples(robot, judge)
        if learnt is None or judged is None:
            return Outcome(log)
        reading = Reading.as_stated(log)
        bad = []
        for j, name in enumerate(learnt.channels):
            parts = []
            for samples in (learnt, judged):
                model, v, a = samples.predicted(reading)
                parts.append((samples.measured_torque(reading)[:, j], model[:, j], v[:, j], a[:, j]))
            weights, own = (drive_fit(*part)[0] for part in parts)
            torque = parts[1][0]
            _, model, v, a = parts[1]
            columns = np.column_stack([model, np.ones_like(v), v, np.sign(v), a])
            power = max(float(((torque - torque.mean()) ** 2).sum()), 1e-300)
            left, least = (float(((torque - columns @ w) ** 2).sum()) / power for w in (weights, own))
            if left > _MUCH and left > _WORSE * least:
                bad.append(name)
        if not bad:
            return Outcome(log)
        text = (
            f"what the trials to learn from say of {listed(bad)} does not hold in the trials to judge by: another "
            "machine, another load, or channels put together otherwise"
        )
        finding = Finding(
            "other_machine",
            text,
            {"joints": float(len(bad))},
            tuple(bad),
            severity="spoils",
            sure=0.8,
            remedy="compare robots, loads and settings of the recordings",
            trials=tuple(t.name for t in judge.trials),
        )
        return Outcome(log, (finding,))
