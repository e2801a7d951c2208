"""What each hidden effect truly takes of every joint's gap, from simulations without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from excite.arrays import Array
from excite.blind.arm import N_TRIALS, N_VALIDATION
from excite.blind.detectability import Band, band_rows
from excite.robot.robot import Robot
from excite.simulation.recording import Recording

Recordings = Sequence[Recording]


@dataclass(frozen=True, eq=False)
class TrueShares:
    """Where the gap of each joint truly goes.

    Attributes:
        gap: ``(n_joints,)`` mean square of what the modelled terms leave of the validation trials, less what they
            leave of the same robot without any hidden effect [N²·m²].
        share: ``(n_effects, n_joints)`` of the gap; zero where a joint has none.
        together: ``(n_joints,)`` what only several effects at once take: one less the sum of the shares.
    """

    gap: Array
    share: Array
    together: Array


def true_shares(
    power: Array, without: Sequence[Array], alone: Sequence[Array], none: Array, least: Array
) -> TrueShares:
    """Shares from what is left of robots with and without effects.

    An effect's share is the mean of what the gap loses when it is taken out of everything, and what it makes where
    nothing else is. For effects whose torques add up both differ by their overlaps with others, and the mean is its
    Shapley value (Shapley 1953): shares then add up to one. What they lack is kept as ``together``.

    Args:
        power: ``(n_joints,)`` what the modelled terms leave with all effects [N²·m²].
        without: the same without each effect.
        alone: the same with each effect alone.
        none: the same without any.
        least: ``(n_joints,)`` a gap below this is none [N²·m²].

    Returns:
        The shares.
    """
    gap = np.where(power - none > least, power - none, 0.0)
    parts = [0.5 * ((power - out) + (only - none)) for out, only in zip(without, alone, strict=True)]
    there = gap > 0.0
    shares = np.array([np.where(there, part / np.where(there, gap, 1.0), 0.0) for part in parts])
    return TrueShares(gap, shares, np.where(there, 1.0 - shares.sum(axis=0), 0.0))


def left_over(robot: Robot, runs: Recordings, modelled: Sequence[str], band: Band) -> Array:
    """Mean square that the modelled terms leave of the validation trials, ``(n_joints,)`` [N²·m²].

    They are fitted to the identification trials by least squares, each joint weighted by its noise; rows at which a
    joint stands count for neither.

    Args:
        robot: the nominal model.
        runs: identification trials, then those for validation; more are not looked at.
        modelled: words of ``modelled`` of the log.
        band: what is looked at, and the noise in it.
    """
    parts = [band_rows(robot, run, modelled, band.sos) for run in runs[: N_TRIALS + N_VALIDATION]]
    learn, judge = (
        [np.concatenate([part[k] for part in chosen]) for k in range(3)]
        for chosen in (parts[:N_TRIALS], parts[N_TRIALS:])
    )
    torque, columns, moving = learn
    weight = moving / band.noise
    rows = (columns * weight[:, :, None]).reshape(-1, columns.shape[2])
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-12)
    fitted = np.linalg.lstsq(rows / scale, (torque * weight).ravel(), rcond=1e-9)[0] / scale
    torque, columns, moving = judge
    rest = (torque - columns @ fitted) * moving
    return np.asarray((rest**2).sum(axis=0) / np.maximum(moving.sum(axis=0), 1.0))
