"""Feet of a robot that walks, which stand still against each other while they carry: where one does not, it slips.

What contact points move by, ``Jᵀ [0; ω; q̇]``, is known up to the trunk's linear velocity, which all share. Of three and
more the one that moves against the others slips; of two that carry alone either may.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from excite.arrays import Array, distinct_rows, widen_flags
from excite.diagnosis.answer.candidate import Candidate, Estimate
from excite.diagnosis.walking.kinds import SLIP, SURE
from excite.logs.log import Log, Trial
from excite.regressor.contact_forces import contact_maps
from excite.robot.robot import Robot
from excite.rows.joint_rows import CHANGE_S, closed_on_grid
from excite.rows.kinematics import trial_kinematics
from excite.rows.settings import ProblemSettings

# Of a simulated trot on a floor of friction 0.6 feet that carry move by less for 97 % of the time [m/s]: they roll, and
# touch and leave.
_SLIDES = 0.15
_STRETCHES = 10


def foot_effects(robot: Robot, log: Log, cutoff_hz: float) -> Iterator[Candidate]:
    """Feet that slip for a larger share of the time in which they carry than the others do, or all of them.

    Args:
        robot: the nominal model.
        log: its log.
        cutoff_hz: of the filter of positions.
    """
    names = [foot.name for foot in robot.feet]
    speed = np.concatenate([_speeds(robot, log, trial, cutoff_hz) for trial in log.trials])
    parts = [part for part in np.array_split(speed, _STRETCHES) if (~np.isnan(part)).any(axis=0).all()]
    if len(names) < 2 or len(parts) < _STRETCHES // 2:
        return
    shares = np.array(
        [np.nanmean(np.where(np.isnan(part), np.nan, part > _SLIDES), axis=0) for part in parts]
    )
    share, std = shares.mean(axis=0), shares.std(axis=0) / np.sqrt(len(shares)) + 1e-3
    usual = float(np.median(share))
    if usual > SLIP.least:
        yield SLIP.candidate("feet", usual, float(np.median(std)))
    clear = share - usual > np.maximum(SLIP.least, SURE * std)
    for k in np.flatnonzero(clear):
        alike = tuple(name for i, name in enumerate(names) if clear[i] and abs(share[i] - share[k]) < std[k])
        fast = Estimate(float(np.nanmedian(speed[speed[:, k] > _SLIDES, k])), None, "m/s")
        named = SLIP.candidate(names[k], share[k], std[k], usual=usual)
        yield replace(named, parameters={**named.parameters, "speed": fast}, tied_locations=alike)


def _speeds(robot: Robot, log: Log, trial: Trial, cutoff_hz: float) -> Array:
    """Speeds at which feet that carry move along the ground against the others, ``(n, n_feet)`` [m/s]; else NaN."""
    settings = ProblemSettings(cutoff_hz=cutoff_hz)
    filters = settings.filters(floating=False, lowpass_hz=log.header.lowpass_hz)
    k = trial_kinematics(robot, log.header, trial, settings, filters)
    closed, still = closed_on_grid(robot, trial, k.time), k.v.copy()
    changes = np.zeros(len(closed), dtype=bool)
    changes[1:] = (closed[1:] != closed[:-1]).any(axis=1)
    use = k.valid & ~widen_flags(changes, round(CHANGE_S * k.rate_hz))
    still[:, :3] = 0.0
    out = np.full(closed.shape, np.nan)
    patterns, member = distinct_rows(closed)
    for i, pattern in enumerate(patterns):
        at, feet = np.flatnonzero((member == i) & use), np.flatnonzero(pattern)
        if len(feet) < 2 or not len(at):
            continue
        maps = contact_maps(robot, k.q[at], [robot.feet[f] for f in feet])
        moved = np.einsum("nvk,nv->nk", maps, still[at])
        if moved.shape[1] != 3 * len(feet):
            continue
        moved = moved.reshape(len(at), len(feet), 3)[:, :, :2]
        against = moved[:, ::-1] if len(feet) == 2 else np.median(moved, axis=1, keepdims=True)
        out[at[:, None], feet] = np.linalg.norm(moved - against, axis=2)
    return out
