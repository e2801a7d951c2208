"""How a servo follows its commands: what hangs under weight, what dry friction holds back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.own_columns import coulomb_level
from excite.diagnosis.servo.servo import Servo, Signals

# Less than this is not worth a sentence [rad]: a step of a 12-bit encoder.
_LEAST = 1.5e-3


@dataclass(frozen=True, eq=False)
class Tracking:
    """Each joint's steady errors, in the order of the samples.

    Attributes:
        joints: names.
        hangs: ``(n_joints,)`` mean of measured less commanded position [rad].
        weighs: ``(n_joints,)`` what weight over kp, less feedforward and integral, makes one expect of it [rad].
        dead_band: ``(n_joints,)`` how far a command has to lead before dry friction lets go [rad].
    """

    joints: tuple[str, ...]
    hangs: Array
    weighs: Array
    dead_band: Array

    def sentences(self) -> tuple[str, ...]:
        """What is worth saying."""
        said = []
        low = [
            f"{name} {1e3 * h:+.0f} mrad (weight over kp: {1e3 * w:+.0f})"
            for name, h, w in zip(self.joints, self.hangs, self.weighs, strict=True)
            if min(abs(h), abs(w)) > _LEAST and h * w > 0.0
        ]
        if low:
            said.append("the arm hangs away from its commands under its weight: " + ", ".join(low))
        held = [
            f"{name} ±{1e3 * d:.1f} mrad"
            for name, d in zip(self.joints, self.dead_band, strict=True)
            if d > _LEAST
        ]
        if held:
            said.append("dry friction leaves a dead band about the commands: " + ", ".join(held))
        return tuple(said)


def tracking(baseline: Baseline, servo: Servo, signals: dict[str, Signals], order: Sequence[int]) -> Tracking:
    """Steady errors on the identification trials.

    Args:
        baseline: with all accepted effects.
        servo: the servo.
        signals: by trial.
        order: of the samples' joints in the log.

    Returns:
        The errors.
    """
    samples, columns = baseline.samples, list(order)
    kp = servo.kp[columns]
    late, weight = [], []
    for trial, rigid in zip(samples.trials, samples.split(baseline.rigid), strict=True):
        if not trial.identification:
            continue
        s = signals[trial.name]
        late.append((s.measured.value - s.commanded.value)[:, columns])
        given = s.feedforward(servo.feedforward) + s.integral
        weight.append(given[: len(rigid), columns] - rigid[: len(s.time)])
    dry = np.array([max(coulomb_level(baseline.modelled, own), 0.0) for own in baseline.fit.own])
    hangs, weighs = (np.concatenate(x).mean(axis=0) for x in (late, weight))
    return Tracking(samples.joints, hangs, weighs / kp, dry / kp)
