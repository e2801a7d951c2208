"""All numbers that decide in the model of the gap: value, meaning, and the experiment that set each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """What an effect has to show.

    Attributes:
        price: nats that a named effect costs, beside its parameters and the number of candidates.
        steadiness: mean over blocks of the nats, in units of their deviation: t/√blocks.
        alike: share of the nats within which a simpler effect is preferred, and another one is a rival.
        rival: nats within which another effect is a rival whatever the share.
        load: share of a joint's torque below which its load is too small for a gain, or friction that grows with it.
        probable: probability from which an effect is accepted.
        clear: share of the gap at its own joint from which an effect stands clear there.
        most: share of the structured gap that the accepted effects explain where the verdict is ``effect``.
        trifle: share of the whole gap below which an effect does not stand for it, wherever it stands clear.
        unnamed: share of what is left that a generic function has to close in blocks left out.
        unison: independent directions of a motion per joint, below which no place is told.
        differs: deviations by which sizes of the trials that judge differ from those learnt.
        block_s: shortest block [s].
    """

    price: float = 4.0
    steadiness: float = 0.7
    alike: float = 0.07
    rival: float = 5.0
    load: float = 0.1
    probable: float = 0.9
    clear: float = 0.5
    most: float = 0.5
    trifle: float = 0.1
    unnamed: float = 0.02
    unison: float = 0.3
    differs: float = 5.0
    block_s: float = 5.0


THRESHOLDS = Thresholds()
