"""Where what is left after all effects is more than noise."""

from __future__ import annotations

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.attribution import Attribution
from excite.diagnosis.attribution.evidence import effective_counts

# Power over the floor's, and nats, from which a rest is structured.
STRUCTURED, _STRUCTURED_NATS = 2.0, 20.0
# Share of a torque's deviation, or power in multiples of the floor's, from which a structured rest is a gap.
_MATTERS, _FAR = 0.02, 8.0
# Filters and differences are no more exact than this share of a torque's deviation: exact inverse dynamics of a
# seven-joint arm, written at 50 Hz with six decimals, are met to 1.4e-4; torque sensors of arms are known to 1e-2.
_EXACT = 1e-3
# The same against the white floor alone, for gaps that do not repeat.
_WILD, _WILD_SHARE = 10.0, 0.1
# A joint whose own repeats differ by so many times its noise, and of what the middle one's of all joints do, has
# something that does not repeat; where that is this share of the torque's deviation, fewer times will do.
_UNREPEATED, _UNREPEATED_LARGE, _LARGE = 3.0, 1.5, 0.05


def structured_joints(attribution: Attribution, spectral: Array) -> tuple[str, ...]:
    """Joints whose residual after all accepted effects is significantly more than noise."""
    samples = attribution.final.samples
    residual, use = attribution.final.judged(attribution.after.residual), samples.identification
    counts = effective_counts(residual, use, samples.trial_of_row).sum(axis=1)
    power = (residual**2).mean(axis=1)
    floor = np.maximum(attribution.floor, spectral) ** 2
    ratio = power / floor
    nats = 0.5 * counts * (ratio - 1.0 - np.log(np.maximum(ratio, 1.0)))
    # How friction sets in is nobody's model to the last percent: a small rest of that size is no gap.
    excess = np.sqrt(np.maximum(power - floor, 0.0)) / attribution.scale
    matters = (excess > _MATTERS) | ((ratio > _FAR) & (excess > _EXACT))
    likely = (ratio > STRUCTURED) & (nats > _STRUCTURED_NATS)
    # What is different in every trial raises the floor of repeated ones; the white floor does not know it.
    wild = (power > _WILD * spectral**2) & (np.sqrt(power) > _WILD_SHARE * attribution.scale)
    # Nor does its repeat, where only this joint has it.
    differs = attribution.floor / spectral / max(float(np.median(attribution.floor / spectral)), 1.0)
    alone = (differs > _UNREPEATED) & (power > _WILD * spectral**2)
    alone &= np.sqrt(power) > _MATTERS * attribution.scale
    much = np.sqrt(np.maximum(attribution.floor**2 - spectral**2, 0.0)) > _LARGE * attribution.scale
    alone |= (differs > _UNREPEATED_LARGE) & much
    found = np.flatnonzero((likely & matters) | wild | alone)
    # A small rest of a quiet joint may stand furthest above its noise: what is much of the torque comes first.
    stands = power / np.minimum(floor, spectral**2) * np.sqrt(power) / attribution.scale
    return tuple(samples.joints[j] for j in sorted(found, key=lambda j: -stands[j]))
