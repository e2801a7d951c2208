"""All numbers that decide in the model of the gap: value, meaning, and the experiment that set each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """What an effect has to show, and when a verdict may rest on it.

    Attributes:
        price: nats by which an effect has to predict better, beside its parameters and the number of candidates, where
            sizes are said that a record would show. In a prototype twice of it changed no name on EMPS, UR10e and
            TIAGo, half of it none on EMPS; not varied here.
        alike: share of the nats of what is there within which another is a rival, where an experiment is to part them.
            On EMPS a spring leads the offset that is there by 9.8 nats to 9.0.
        rival: the same in nats where that is more; odds of 20 to 1 lie within it.
        odds: by which, times the number of effects and places that were tried, blocks left out of the fit have to be
            likelier with a named effect: 7.6 nats of 98. Of 47 effects planted in records of five machines whose own
            names come and go by 6 to 10 nats, 36 are named with 15 others where none is asked; 36 with 5 where 8 are,
            35 with 4 where 10 are, 34 with 3 where 15 are.
        load: share of a joint's torque below which its load is too small for a gain, or friction that grows with it: on
            a wrist that hardly carries anything, friction explains itself as a gain of 0.83.
        probable: probability from which an effect is accepted, by the contract of the document.
        most: share of a gap, at a place or of all that has structure, that counts as most of it, by the contract.
        trifle: share of the whole gap below which an effect does not stand for it, wherever it stands clear; and of
            what is left of a joint that an effect has to be missed by there: a gain of 17 nats that shared what a
            tilted base takes of a drawn arm is missed by 0.03, the ball screw's offset beside its friction by 3.
        sure: share of the gap of its own joint that a named effect surely takes, the lower end of its 90 % interval, or
            what stays unexplained there if that is less. Of 226 effects planted in records of ten machines 129 are
            named with 34 others that come and go where it is 0, 122 with 18 where it is this.
        unnamed: share of a channel from which anything is worth a word: the frozen prototype's false names lay below.
        unison: independent directions of a motion, below which it is one path that tells no place: 1.0 for AirBot's
            chirps; with the 1.5 of LWR's runs, five of seven visible effects that were planted there are placed.
        differs: deviations by which sizes of the trials that judge differ from those learnt. Set by one
            synthetic pair of joints with the same constant and with another; no record of a robot has tried it yet.
        block_s: shortest block [s]; in a prototype 2.5 and 10 changed nothing on EMPS, nor 10 on TIAGo.
    """

    price: float = 4.0
    alike: float = 0.07
    rival: float = 5.0
    odds: float = 20.0
    load: float = 0.1
    probable: float = 0.9
    most: float = 0.5
    trifle: float = 0.1
    sure: float = 0.05
    unnamed: float = 0.02
    unison: float = 1.25
    differs: float = 5.0
    block_s: float = 5.0


THRESHOLDS = Thresholds()
