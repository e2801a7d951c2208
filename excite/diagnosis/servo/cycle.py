"""How much later than it was asked for a servo's torque acts: its cycle, and the filter of its encoders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.hypotheses import at_rows
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.effect import Shape
from excite.diagnosis.effects.readings.actuator_lag import ActuatorLag
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.noise_floor import spectral_floor
from excite.diagnosis.equations.own_columns import ARMATURE, own_terms
from excite.diagnosis.equations.samples import ArmSamples
from excite.diagnosis.servo.servo import Servo, Signals

# Samples from a position's reading to the torque that answers it: computed in one cycle, held for the next.
LONGEST_SAMPLES = 2.0
# A cycle of a slow servo [s].
_NEWEST_S = 2e-3
_JOINTS = 3


@dataclass(frozen=True)
class Cycle:
    """When a servo's torque acts.

    Attributes:
        lag: between the torque that commands and positions speak for and the one that acts [s].
        newer: how much newer than the log's the velocity is that its damping acts on [s]; negative where it is older.
        longest: what two of the servo's cycles are, where the lag is surely longer [s].
    """

    lag: float
    newer: float = 0.0
    longest: float = np.inf

    def sentences(self) -> tuple[str, ...]:
        """What cannot be seen beside it."""
        said = []
        if self.lag > 0.0:
            said.append(
                f"torques act {1e3 * self.lag:.1f} ms after commands and positions ask for them, taken for the "
                "servo's cycle: a lag of the drive that is as short cannot be seen"
            )
        if self.lag > self.longest:
            said.append(
                f"of these, no more than {1e3 * self.longest:.1f} ms are cycles of the servo at its rate: the rest is "
                "a filter of the positions or a lag of the drives; what tells them apart: log positions unfiltered"
            )
        if self.newer != 0.0:
            said.append(
                f"the servo's damping acts on a velocity {1e3 * abs(self.newer):.1f} ms "
                f"{'newer' if self.newer > 0.0 else 'older'} than the log's: rotors that all are that much of kd "
                "cannot be seen"
            )
        return tuple(said)


def servo_cycle(
    samples: ArmSamples, modelled: tuple[str, ...], kd: Array, rate_hz: float | None = None
) -> Cycle:
    """When the servo's torques act.

    A digital servo reads its encoders, computes for a cycle and holds its torque for another one (Franklin,
    Powell, Workman 1998, chapter 4), and a filter of the logged positions adds its own delay: without a torque
    channel none of this can be told from a lag of the drive. Each joint's lag is fitted beside the baseline; the
    median over the joints hardly heeds one joint that has something else.

    Damping by a velocity that is newer or older than the log's by T is ``kd T`` of inertia more or less. Where no
    rotors are modelled, which would take it up, the same median of what rotors would have over kd tells T.

    Args:
        samples: trials with the torques that were asked for.
        modelled: what the baseline has.
        kd: ``(n_joints,)`` damping by joint of the samples [N·m·s/rad].
        rate_hz: the servo's rate where it is known [Hz].

    Returns:
        The cycle; a lag is 0 where it is none or longer than ``LONGEST_SAMPLES``, T where it is longer than
        ``_NEWEST_S``: that is more than a cycle.
    """
    rotors_too = (*modelled, *ARMATURE.words)
    own = own_terms(rotors_too)
    baseline = fit_baseline(samples, rotors_too, spectral_floor(samples), late=False)
    context = Context(baseline)
    common = ActuatorLag().shape(context, "torque", ()).columns
    n = len(samples.joints)
    apart = Shape({j: column * np.eye(n)[j] for j, column in common.items()})
    lags = baseline.solver.fit(at_rows(context, apart).extra).extra
    lag, newer = float(np.median(lags)), 0.0
    # Of a median, from the median of what is off it (Huber 1981, section 1.2).
    unsure = 1.25 * 1.48 * float(np.median(np.abs(lags - lag))) / np.sqrt(n)
    own_s = LONGEST_SAMPLES / rate_hz if rate_hz else np.inf
    # The median over fewer joints would be a rotor of one of them.
    if not ARMATURE.asked(modelled) and (kd > 0.0).all() and n >= _JOINTS:
        rotors = np.array([values[own.index(ARMATURE)] for values in baseline.fit.own])
        newer = float(np.median(rotors / kd))
    return Cycle(
        lag if 0.0 < lag <= LONGEST_SAMPLES / samples.rate_hz else 0.0,
        newer if abs(newer) <= _NEWEST_S else 0.0,
        own_s if lag - 2.0 * unsure > own_s else np.inf,
    )


def later(time: Array, torque: Array, lag: float) -> Array:
    """Torques ``(n, n_joints)`` as they act, later by a lag [s]."""
    return np.column_stack([np.interp(time - lag, time, column) for column in torque.T])


def acting(signals: Signals, servo: Servo, cycle: Cycle) -> Array:
    """Torques of one trial as they act, ``(n, n_joints)`` in the log's order [N·m]."""
    asked = signals.torque(servo) - cycle.newer * servo.kd * signals.measured.second
    return later(signals.time, asked, cycle.lag)
