"""How much later than it was asked for a servo's torque acts: its cycle, and the filter of its encoders."""

from __future__ import annotations

import numpy as np

from excite.diagnosis.baseline import fit_baseline
from excite.diagnosis.effects.actuator_lag import ActuatorLag
from excite.diagnosis.effects.effect import Context, Shape
from excite.diagnosis.hypotheses import at_rows
from excite.diagnosis.noise_floor import spectral_floor
from excite.diagnosis.samples import ArmSamples
from excite.robot.robot import Array

# Samples from a position's reading to the torque that answers it: computed in one cycle, held for the next.
LONGEST_SAMPLES = 2.0


def cycle_time(samples: ArmSamples, modelled: tuple[str, ...]) -> float:
    """Lag between the torque that commands and positions speak for and the one that acts [s].

    A digital servo reads its encoders, computes for a cycle and holds its torque for another one (Franklin,
    Powell, Workman 1998, chapter 4), and a filter of the logged positions adds its own delay: without a torque
    channel none of this can be told from a lag of the drive. Each joint's lag is fitted beside the baseline; the
    median over the joints hardly heeds one joint that has something else.

    Args:
        samples: trials with the torques that were asked for.
        modelled: what the baseline has.

    Returns:
        The lag, 0 where it is none or longer than ``LONGEST_SAMPLES``: that is more than a cycle.
    """
    baseline = fit_baseline(samples, modelled, spectral_floor(samples), leads=False)
    context = Context(baseline)
    common = ActuatorLag().shape(context, "torque", ()).columns
    n = len(samples.joints)
    apart = Shape({j: column * np.eye(n)[j] for j, column in common.items()})
    lags = baseline.solver.fit(at_rows(context, apart).extra).extra
    lag = float(np.median(lags))
    return lag if 0.0 < lag <= LONGEST_SAMPLES / samples.rate_hz else 0.0


def later(time: Array, torque: Array, lag: float) -> Array:
    """Torques ``(n, n_joints)`` as they act, later by a lag [s]."""
    return np.column_stack([np.interp(time - lag, time, column) for column in torque.T])
