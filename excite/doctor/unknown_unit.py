"""Torques in a unit that nothing tells: too small for bodies anywhere near the nominal ones."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.doctor.misreadings import misreadings
from excite.doctor.mistakes.torque_scale import TorqueScale
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import Finding, listed

# Logged torques hold what bodies need, and friction. In 15 logs in N·m, most of real machines and with whatever loads,
# those of most joints vary by 0.6 to 20 times what the nominal bodies need, or by a quarter (a double pendulum that
# swings by itself); those of a KUKA KR 300 before its gears by a hundredth.
_TOO_SMALL = 0.1
_THE_REST = "what follows is in the log's unit"


def shortfall(samples: TorqueSamples, reading: Reading) -> Array:
    """How much torques vary per variation of what the nominal bodies need, ``(n_torques,)``."""
    needed = samples.predicted(reading).torque.std(axis=0)
    return np.asarray(samples.measured_torque(reading).std(axis=0) / np.maximum(needed, 1e-300))


def of_unknown_unit(samples: TorqueSamples, reading: Reading) -> bool:
    """Whether most joints' torques are too small for the nominal bodies, and no factor tells their unit.

    Friction hides the factor, and whatever else such torques seem to betray is friction's, too. Of a joint alone it may
    be a motion that needs no torque, as a pendulum swings.
    """
    small = shortfall(samples, reading) < _TOO_SMALL
    if len(small) < 2 or 2 * small.sum() <= len(small):
        return False
    return not misreadings(samples, reading, (TorqueScale(),))[1]


def said_of_unit(samples: TorqueSamples, reading: Reading) -> Finding:
    """What is said of such torques."""
    short = shortfall(samples, reading)
    pairs = dict(zip(samples.channels, short, strict=True))
    text = (
        f"torques vary by {float(np.median(short)):.2g} times what the nominal masses need "
        f"({listed([f'{joint} {share:.2g}' for joint, share in pairs.items()], 3)}), friction included: torques before "
        "the gear, currents, or another unit; so will be every identified parameter"
    )
    factors = ", ".join(f"tau.{joint}: FACTOR" for joint in samples.channels[:2])
    return Finding(
        "torque_scale",
        text,
        {f"factor.{joint}": float(share) for joint, share in pairs.items()},
        samples.channels,
        severity="spoils",
        remedy=f"state the joints' gear ratios or torque constants (scale: {{{factors}, …}} in map.yaml); {_THE_REST}",
    )
