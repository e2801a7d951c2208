"""Torques that hold next to nothing of the nominal bodies: in an unknown unit, or with the model taken off."""

from __future__ import annotations

import numpy as np

from excite.doctor.misreadings import misreadings
from excite.doctor.mistakes.model_parts import ModelParts, parts_in
from excite.doctor.mistakes.torque_scale import TorqueScale
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples
from excite.finding import Finding
from excite.shown import span

# Of 15 logs in N·m, most of real machines and with whatever loads, the torques of most joints vary by 0.6 to 20 times
# what the nominal bodies need, or by a quarter (a double pendulum that swings by itself); those of a KUKA KR 300 before
# its gears by a hundredth where the bodies are heavy.
_TOO_SMALL = 0.1


def of_unknown_unit(samples: TorqueSamples, reading: Reading) -> ModelParts | None:
    """What torques hold of the nominal bodies where that is next to nothing, and no factor tells their unit.

    Friction hides the factor, and whatever else such torques seem to betray is friction's, too. Joints that need most
    of the robot's torque have to tell so, more than one of them: of a joint alone it may be a motion that needs no
    torque, as a pendulum swings.
    """
    parts = parts_in(samples, reading)
    needed = samples.predicted(reading).torque.std(axis=0)
    if parts.told.sum() < 2 or needed[parts.told].sum() <= 0.5 * needed.sum() or parts.largest > _TOO_SMALL:
        return None
    return None if misreadings(samples, reading, (TorqueScale(),))[1] else parts


def said_of_unit(samples: TorqueSamples, parts: ModelParts, reading: Reading) -> Finding:
    """What is said of such torques."""
    gains, _ = samples.gains(reading)
    ratios = np.sort(1.0 / gains[parts.told & (gains > 0.0)])
    gears = ""
    if len(ratios):
        gears = (
            f" of about {span(f'{ratios[0]:.0f}', f'{ratios[-1]:.0f}', ' to ')} to 1 by the nominal masses"
        )
    text = (
        f"torques hold next to nothing of what the nominal masses need ({parts.said()}): they are torques before "
        f"gears{gears}, currents, another unit, or external torques, off which a driver has taken the model"
    )
    factors = ", ".join(f"tau.{joint}: RATIO" for joint in samples.channels[:2])
    return Finding(
        "torque_scale",
        text,
        parts.figures(),
        samples.channels,
        severity="spoils",
        remedy=f"state the joints' gear ratios or torque constants (scale: {{{factors}, …}} in map.yaml), or log "
        "torques as measured; what follows is in the log's unit, and no weight",
    )
