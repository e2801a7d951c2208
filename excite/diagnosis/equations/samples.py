"""Trials of a fixed-base arm on a uniform grid, and the filter that both sides of every equation go through."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.diagnosis.equations.arm_trial import ArmTrial, Bands
from excite.diagnosis.equations.dry_friction.sticking import counted, surely_slips
from excite.diagnosis.equations.repeats import Repeat, repeats_of
from excite.logs.signals.sections import both_ways, butterworth_sections
from excite.regressor.kernels import inverse_dynamics
from excite.robot.robot import Robot
from excite.rows.beyond import reached_samples

_ORDER = 4


class _Layout(NamedTuple):
    """Where trials are in signals below each other.

    Attributes:
        ends: of each trial.
        rows: in their trials, of all trials.
        row_ends: where each trial's rows end in these.
    """

    ends: NDArray[np.int64]
    rows: NDArray[np.int64]
    row_ends: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ArmSamples:
    """All trials of an arm.

    Attributes:
        robot: the robot in the log.
        joints: names of the joints with torque, in the order of the columns of ``tau``.
        index: indices of these joints into ``v``.
        coupling: ``(n_joints, n_joints)`` from velocities of these joints to those of their motors, each seen
            through its own gear; the identity where every motor turns its own joint alone.
        standstill: ``(n_joints,)`` speed up to which a joint may as well stand [rad/s].
        sticking: joints whose equations are left out where they may stick.
        trials: the trials.
        rate_hz: full rate.
        bands: frequencies.
    """

    robot: Robot
    joints: tuple[str, ...]
    index: tuple[int, ...]
    trials: tuple[ArmTrial, ...]
    rate_hz: float
    bands: Bands
    coupling: Array
    standstill: Array
    sticking: frozenset[int] = frozenset()

    @property
    def coupled(self) -> bool:
        """Whether a motor turns with more than its own joint."""
        return not np.array_equal(self.coupling, np.eye(len(self.joints)))

    def motors(self, joint: int) -> tuple[int, ...]:
        """Motors whose torques act on a joint, its own first."""
        others = np.flatnonzero(self.coupling[:, joint])
        return (joint, *(int(m) for m in others if m != joint))

    def of_motor(self, name: str, motor: int) -> Array:
        """Velocity or acceleration of a motor through its own gear, ``(n_samples,)``: ``name`` is ``v`` or ``a``."""
        values, row = self.stacked(name), self.coupling[motor]
        turning = np.flatnonzero(row)
        if len(turning) == 1 and row[turning[0]] == 1.0:
            return values[:, self.index[turning[0]]]
        return values[:, [self.index[k] for k in turning]] @ row[turning]

    def rows(self, signals: Array | Sequence[Array], joints: Sequence[int] | None = None) -> Array:
        """Signals at full rate, all trials below each other or one a trial, through the filter, ``(n_rows, …)``.

        Ends are held, not mirrored: rows near them are left out.

        Args:
            signals: ``(n_samples, …)``.
            joints: of the columns, the joint in whose equation each stands: both sides of it are left out where the
                joint may stick (:attr:`slipping`); None for signals as they are.
        """
        values = signals if isinstance(signals, np.ndarray) else np.concatenate(signals)
        weighted = None if joints is None else np.array(joints, dtype=np.int64)
        if self.bands.rows_hz >= 0.5 * self.rate_hz:
            if weighted is not None:
                values = values * self.slipping[:, weighted].reshape(values.shape)
            parts = zip(self.split(values), self.trials, strict=True)
            return np.concatenate([part[trial.rows] for part, trial in parts])
        sections = butterworth_sections(_ORDER, self.rate_hz, self.bands.rows_hz)
        signals = values.reshape(len(values), -1)
        weights = None if weighted is None else self._weights
        smooth = both_ways(signals, *self._layout, *sections, weights, weighted)
        return smooth.reshape(len(smooth), *values.shape[1:])

    @cached_property
    def _layout(self) -> _Layout:
        """Where trials are in signals below each other."""
        ends, row_ends = np.cumsum(
            [[len(t.time) for t in self.trials], [len(t.rows) for t in self.trials]], 1
        )
        return _Layout(ends, np.concatenate([trial.rows for trial in self.trials]), row_ends)

    @cached_property
    def starts(self) -> NDArray[np.bool_]:
        """Which full-rate samples are the first of a trial, ``(n_samples,)``."""
        marked = np.zeros(self._layout.ends[-1], dtype=np.bool_)
        marked[np.concatenate([[0], self._layout.ends[:-1]])] = True
        return marked

    @cached_property
    def repeats(self) -> tuple[Repeat, ...]:
        """Trials that run one command again."""
        return repeats_of(self.trials, self.rate_hz)

    @cached_property
    def identification(self) -> NDArray[np.bool_]:
        """Which rows belong to identification trials, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), t.identification) for t in self.trials])

    @cached_property
    def judging(self) -> NDArray[np.bool_]:
        """Which rows judge, ``(n_rows,)``: those of validation trials, all where there are none."""
        outside = ~self.identification
        return outside if outside.any() else self.identification

    @cached_property
    def trial_of_row(self) -> NDArray[np.int64]:
        """Index of each row's trial, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), k) for k, t in enumerate(self.trials)])

    @cached_property
    def told(self) -> NDArray[np.bool_] | None:
        """Which rows hold no torque beyond its range, ``(n_joints, n_rows)``; None where none was."""
        if all(trial.beyond is None for trial in self.trials):
            return None
        parts = []
        for trial in self.trials:
            lost = np.zeros(trial.tau.shape, dtype=np.bool_) if trial.beyond is None else trial.beyond
            parts.append(~reached_samples(lost, self.rate_hz, self.bands.rows_hz)[trial.rows])
        return np.concatenate(parts).T

    def squares(self, values: Array) -> Array:
        """Squares of residuals ``(n_joints, n_rows)``: their means are those of the rows that hold known torques."""
        squares = values**2
        if self.told is None:
            return squares
        for side in (self.identification, ~self.identification):
            share = self.told[:, side].mean(axis=1, keepdims=True) if side.any() else 1.0
            squares[:, side] *= self.told[:, side] / np.maximum(share, 1e-9)
        return squares

    @cached_property
    def slipping(self) -> Array:
        """How far each joint's equation counts, ``(n_samples, n_joints)``: hardly where a motor on it may stick."""
        return counted(self.slips(self.sticking))

    def slips(self, joints: Iterable[int]) -> NDArray[np.bool_]:
        """Where all motors on some joints surely turn, ``(n_samples, n_joints)``; True for the others."""
        made, cutoff = np.ones((len(self.starts), len(self.joints)), dtype=np.bool_), self.bands.kinematics_hz
        for joint in joints:
            for k in self.motors(joint):
                v = self.of_motor("v", k)
                made[:, joint] &= surely_slips(v, self.starts, self.standstill[k], self.rate_hz, cutoff)
        return made

    @cached_property
    def _weights(self) -> Array:
        # Joint by joint, as the filter lays signals out.
        return np.ascontiguousarray(self.slipping.T)

    def unweighed(self, residual: Array) -> Array:
        """Residuals ``(n_joints, n_rows)`` without what rows weigh more for those that :attr:`slipping` leaves out."""
        return residual / self.slipping.max(axis=0)[:, None]

    @cached_property
    def kept(self) -> dict[Hashable, Any]:
        """What follows from the motion alone, worked out when it is first asked for; not to be written to."""
        return {}

    def stacked(self, name: str) -> Array:
        """A channel of all trials at full rate below each other; not to be written to."""
        if name not in self.kept:
            self.kept[name] = np.concatenate([getattr(trial, name) for trial in self.trials])
        return np.asarray(self.kept[name])

    @cached_property
    def nominal(self) -> Array:
        """Torques of the rigid bodies as the model has them, ``(n_samples, n_joints)`` [N·m]."""
        motion = (self.stacked(name) for name in ("q", "v", "a"))
        return self.of_joints(inverse_dynamics(self.robot.model, *motion))

    def of_joints(self, values: Array) -> Array:
        """Those of ``values (n, nv, …)`` that belong to the joints with torque, no copy where these are all."""
        return values if self.index == tuple(range(values.shape[1])) else values[:, list(self.index)]

    def split(self, values: Array) -> list[Array]:
        """Full-rate values of all trials, back into trials."""
        return np.split(values, self._layout.ends[:-1])
