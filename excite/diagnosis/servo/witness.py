"""Whether the change that effects make to closed-loop roll-outs goes the way that the record asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from excite.arrays import Array

# A change of less than this share of the roll-outs' amplitude of error is lost in it; one so much larger than what it
# is to explain is a simulation that gets nowhere.
_HEARD, _WILD = 0.1, 10.0
# Standard errors by which a change has to go the right way.
_SURE = 2.0
# Fewer roll-outs do not tell by how much they disagree.
_ROLLOUTS = 4
# A change of which so little goes the right way makes things worse, however surely.
_LEAST = 0.1


@dataclass(frozen=True)
class Witness:
    """What roll-outs say of effects.

    Attributes:
        slope: share of the effects' change that the error without them asks for: 1 where they are all that is missing,
            0 where they have nothing to do with it; NaN where roll-outs with them diverge.
        error: standard error of the slope.
        heard: amplitude of the change over that of the error, at the joint where it is most.
    """

    slope: float
    error: float
    heard: float

    @property
    def speaks_against(self) -> bool:
        """Whether the change is surely less than foretold, and not surely any of it the right way.

        A simulation that gets nowhere says nothing, nor does a change within the error.
        """
        if not (np.isfinite(self.slope) and _HEARD <= self.heard <= _WILD):
            return False
        return self.slope < 1.0 - _SURE * self.error and self.slope < max(_SURE * self.error, _LEAST)


def witness(before: Array, after: Array, band: float = 1.0) -> Witness:
    """Regress what the record asks for on what effects do.

    Under feedback the positions hardly show an effect that the torques show well: how much of the error goes
    tells little where friction, noise and the start have most of it. Whether what goes is what was foretold does.
    Every frequency weighs by the error that there is without the effects, in octaves: slow errors of friction are
    the largest, and would drown what a soft gear does (generalised least squares, Aitken 1936).

    Args:
        before: simulated less recorded positions without the effects ``(n_windows, n, n_joints)`` [rad].
        after: with them.
        band: share of the frequencies up to half the sampling rate that effects were fitted in: beyond, a filtered
            record has next to nothing, and the start of a simulation has something.

    Returns:
        What they say, all joints weighed by their errors without the effects.
    """
    if not np.isfinite(after).all():
        return Witness(np.nan, np.nan, 0.0)
    size = np.sqrt((before**2).mean(axis=(0, 1))) + 1e-12
    heard = float((np.sqrt(((after - before) ** 2).mean(axis=(0, 1))) / size).max())
    count = max(round(band * before.shape[1]), 1)
    old, new = (_spectrum(x / size)[:, :count] for x in (before, after))
    weight = 1.0 / _levels(old)
    error, change = old * weight, (new - old) * weight
    asked, made = (x.sum(axis=(1, 2)) for x in (-error * change, change**2))
    total = float(made.sum())
    if total <= 0.0:
        return Witness(np.nan, np.nan, 0.0)
    slope = float(asked.sum()) / total
    if len(made) < _ROLLOUTS:
        return Witness(slope, np.inf, heard)
    # Of a ratio of sums over the joints and frequencies of each roll-out (Cochran 1977, section 6.3).
    spread = float(np.sqrt(len(made) / max(len(made) - 1, 1) * ((asked - slope * made) ** 2).sum()))
    return Witness(slope, spread / total, heard)


def _spectrum(errors: Array) -> Array:
    """Cosine transform over time: what begins and ends apart leaks next to nothing into it."""
    from scipy.fft import dct

    return np.asarray(dct(errors, axis=1, norm="ortho"))


def _levels(spectrum: Array) -> Array:
    """RMS over the windows and the octave of each frequency, ``(n, n_joints)``."""
    octave = np.frexp(np.arange(spectrum.shape[1]))[1]
    levels = np.empty(spectrum.shape[1:])
    for k in range(int(octave.max()) + 1):
        inside = octave == k
        levels[inside] = np.sqrt((spectrum[:, inside] ** 2).mean(axis=(0, 1)))
    return levels + 1e-9
