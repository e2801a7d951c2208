"""Closed-loop roll-outs of validation trials: the record's commands through the servo, with and without effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.atomic import write_text
from excite.diagnosis.answer.candidate import Estimate
from excite.diagnosis.answer.result import Rollout
from excite.diagnosis.attribution.attribution import Attribution
from excite.diagnosis.attribution.structured import structured_joints
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.servo.cycle import Cycle
from excite.diagnosis.servo.late_command import delay_for_lag
from excite.diagnosis.servo.position_floor import position_floor
from excite.diagnosis.servo.servo import Servo, Signals
from excite.diagnosis.servo.servo_drive import servo_drive
from excite.diagnosis.servo.strength import effect_strength, without_faint
from excite.diagnosis.servo.tracking import Tracking, tracking
from excite.diagnosis.servo.transport import clearly_lags
from excite.diagnosis.servo.witness import Witness, witness
from excite.diagnosis.simulator.model_text import MODEL
from excite.diagnosis.simulator.rollout_compare import compared
from excite.diagnosis.simulator.rollout_drives import Drive
from excite.diagnosis.simulator.rollout_windows import Plan, spans
from excite.errors import InputError
from excite.logs.log import Trial
from excite.progress import step

_HORIZON_S = 2.0
# What each further effect has to take of some joint's squared error.
_GAIN = 0.1


@dataclass(eq=False)
class ClosedLoop:
    """Closed-loop roll-outs, and what the result needs of them afterwards.

    Attributes:
        servo: the servo.
        signals: by trial.
        cycle: when the servo's torques act.
        logged: its trials as they were logged, by name.
        out: folder for the augmented model.
        rollout: the comparison once it is made.
        deviation: ``(n_joints,)`` standard deviation of the positions in identification trials [rad].
        floor: ``(n_joints,)`` what encoders and what does not repeat leave in filtered positions [rad].
        order: joints in the log's order.
        tracking: steady errors of the servo.
        kept: how many of the accepted effects bring the roll-outs nearer.
        strength: RMS of the first effect's torque over all torque's deviation, at the joint where it is most.
        structured: joints with a gap that effects strong enough leave.
        lags: whether the first effect is a lag and clearly no delay.
        delay: the delay that stands in its place; None where it is no lag.
        spans: pieces of trials that were simulated.
        witness: what roll-outs say of the accepted effects; None where there are none.
    """

    servo: Servo
    signals: dict[str, Signals]
    cycle: Cycle
    logged: Mapping[str, Trial]
    out: Path | None
    rollout: Rollout | None = None
    deviation: Array | None = None
    floor: Array | None = None

    @step("roll out in the simulator")
    def __call__(self, attribution: Attribution, baseline: Baseline) -> Rollout:
        """Make the roll-outs, with no effect that rebuilt torques are not exact enough for."""
        samples = baseline.samples
        order = [self.order.index(joint) for joint in samples.joints]
        self.tracking = tracking(attribution.final, self.servo, self.signals, order)
        q = samples.stacked("q")[:, list(samples.index)]
        inside = np.concatenate([np.full(len(t.time), t.identification) for t in samples.trials])
        self.deviation = np.maximum(q[inside].std(axis=0), 1e-9)
        self.floor = position_floor(samples, self.logged, self.order)
        self.strength = max((effect_strength(item) for item in attribution.accepted[:1]), default=np.inf)
        attribution = without_faint(attribution, baseline)
        self.structured = structured_joints(attribution, baseline.solver.equations.floor)
        self.lags = clearly_lags(attribution)
        self.delay = delay_for_lag(attribution, self.servo, self.signals, self.cycle, order)
        drives: dict[str, Drive] = {
            t.name: servo_drive(self.signals[t.name], self.servo, self.cycle, order) for t in samples.trials
        }
        shortest = min(float(t.time[-1]) for t in samples.trials)
        horizon = min(_HORIZON_S, 0.4 * shortest)
        plan = Plan(horizon, drives, "q_cmd", least_gain=_GAIN, all_effects=True, noise=self.floor)
        try:
            comparison = compared(attribution, baseline, plan)
        except InputError as error:
            self.rollout = Rollout({}, {}, _HORIZON_S, None, "q_cmd", (f"no roll-outs: {error}",))
            return self.rollout
        rollout, self.kept = comparison.rollout, comparison.kept
        self.spans = spans(samples, plan)
        if comparison.errors is not None:
            band = min(2.0 * samples.bands.rows_hz / samples.rate_hz, 1.0)
            self.witness = witness(*comparison.errors, band)
        if self.out is not None:
            self.out.mkdir(parents=True, exist_ok=True)
            write_text(self.out / MODEL, comparison.xml)
            rollout = replace(rollout, model=MODEL)
        self.rollout = rollout
        return rollout

    order: tuple[str, ...] = ()
    tracking: Tracking | None = None
    kept: int = 0
    strength: float = np.inf
    witness: Witness | None = None
    lags: bool = False
    delay: Estimate | None = None
    structured: tuple[str, ...] = ()
    spans: tuple[tuple[str, float, float], ...] = ()
