"""Which joints stick: those of which no function of the motion explains where they are slow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import fit_baseline
from excite.diagnosis.equations.own_columns import coulomb_level
from excite.diagnosis.equations.samples import ArmSamples

# How many times as much as elsewhere is left of a joint that sticks where it is slow, and at least what share of its
# dry friction. Of simulated arms of four makers (MuJoCo's frictionloss, made hard or as it comes, fast and slow) 60
# joints that stick have 4.1 to 49 times and 5 to 31 %, nine that turn through 1.2 to 2.4 times; a carriage on bristles
# that bend over 0.3 to 3 mm has 1.5 to 5 times and 1 to 2 %. Of ten records with six effects each (gap/many) 3, 4 and
# 6 times find the same 53, and name 4, 4 and 3 that are not there.
_WORSE, _SHARE = 4.0, 0.04
# Widths of the functions of the velocity, in speeds up to which the joint may as well stand: those of Stribeck's law,
# and what is the same in both directions.
_WIDTHS, _EVEN = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0), (0.5, 2.0, 8.0)
# Share of slow motion that the filter mixes into a row from which it is a row of that, and up to which it is not.
_SLOW, _FAST = 0.5, 0.1


def fit_where_slipping(samples: ArmSamples, modelled: tuple[str, ...], floor: Array) -> Baseline:
    """The baseline, in which joints that stick are left out where they may.

    A first fit, to all of the motion, tells which joints stick; where none does it is the baseline.

    Args:
        samples: the samples.
        modelled: words of ``modelled`` in ``log.yaml``.
        floor: ``(n_joints,)`` noise in the rows' band [N·m].
    """
    first = fit_baseline(samples, modelled, floor)
    sticking = samples.sticking | sticking_joints(first)
    if sticking == samples.sticking:
        return first
    return fit_baseline(replace(samples, sticking=sticking), modelled, floor)


def sticking_joints(baseline: Baseline) -> frozenset[int]:
    """Joints whose dry friction is whatever holds them where they are slow.

    Friction that follows from the motion, bristles and Stribeck's law among it, leaves of a joint's equation where the
    joint is slow what it leaves elsewhere. Friction of a joint that sticks leaves several times as much, and no
    function of the velocity takes that away. Torques that come late leave something everywhere: that goes first.

    Args:
        baseline: fitted, friction with it.
    """
    samples, use = baseline.samples, baseline.samples.identification
    residual = samples.unweighed(baseline.plain(baseline.fit.residual))
    later = samples.rows([np.gradient(t.tau, t.time, axis=0) for t in samples.trials]).T
    slips, joints = samples.slips(range(len(residual))), set[int]()
    for j, mixed in enumerate(samples.rows(np.where(slips, 0.0, 1.0)).T):
        near, inside, outside = use & (mixed >= _FAST), mixed > _SLOW, use & (mixed < _FAST)
        if not (near & inside).any() or not outside.any():
            continue
        left = _less(residual[j], later[j], outside)
        friction = coulomb_level(baseline.modelled, baseline.fit.own[j])
        least = max(_WORSE * _rms(left[outside]), _SHARE * abs(friction))
        if _rms(left[near & inside]) < least:
            continue
        beside = left[near] - _of_velocity(samples, j, left, near)
        if _rms(beside[inside[near]]) >= least:
            joints.add(j)
    return frozenset(joints)


def _less(left: Array, column: Array, rows: NDArray[np.bool_]) -> Array:
    """What is left without as much of a column as some rows ask for, ``(n_rows,)``."""
    size = float(column[rows] @ left[rows]) / max(float(column[rows] @ column[rows]), 1e-300)
    return left - size * column


def _of_velocity(samples: ArmSamples, joint: int, left: Array, rows: NDArray[np.bool_]) -> Array:
    """What functions of the velocities of a joint's motors explain of what is left in some rows of its equation."""
    columns = []
    for motor in samples.motors(joint):
        v, still = samples.of_motor("v", motor), samples.standstill[motor]
        columns += [np.sign(v) * np.exp(-np.abs(v) / (width * still)) for width in _WIDTHS]
        columns += [np.exp(-np.abs(v) / (width * still)) for width in _EVEN]
    design = samples.rows(np.column_stack(columns))[rows]
    return np.asarray(design @ np.linalg.lstsq(design, left[rows])[0])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
