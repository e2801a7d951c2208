"""Trials of a fixed-base arm on a uniform grid, and the filter that both sides of every equation go through.

Equations stand in the coordinates of the motors that were logged. The tree of joints that couplings and loops tie to
them moves by ``v = G v_m`` and asks of them ``Gᵀ τ`` (:mod:`excite.robot.mechanisms.mechanism`): what a drive does
stands in one row, what a link does in the rows of all motors that move it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from excite.arrays import Array, Moved, widen_flags
from excite.diagnosis.equations.arm_trial import ArmTrial, Bands
from excite.diagnosis.equations.repeats import Repeat, find_repeats
from excite.logs.signals.butterworth import both_ways, butterworth_sections
from excite.regressor.kernels import inverse_dynamics, joint_torque_regressor
from excite.robot.robot import Robot
from excite.rows.saturation import reached_samples

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
        joints: names of the motors with torque, each its joint's, in the order of the columns of ``tau``.
        index: indices of their joints into ``v``.
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
    def is_coupled(self) -> bool:
        """Whether a motor turns with more than its own joint."""
        return self.robot.mechanism is not None or not np.array_equal(self.coupling, np.eye(len(self.joints)))

    @property
    def tree_motion(self) -> Moved:
        """Motion of all joints of the tree at full rate, ``(n_samples, nv)`` each; not to be written to."""
        return Moved(*(self.stack_trials(name) for name in ("q", "v", "a")))

    @cached_property
    def motion_maps(self) -> Array:
        """``G``: velocities of the tree per velocity of each motor, ``(n_samples or 1, nv, n_joints)``."""
        return self._maps_at(self.stack_trials("q"))

    def _maps_at(self, q: Array) -> Array:
        mechanism = self.robot.mechanism
        if mechanism is None:
            maps = np.zeros((1, self.robot.model.nv, len(self.joints)))
            maps[0, list(self.index)] = np.linalg.inv(self.coupling)
            return maps
        if mechanism.ratios is not None:
            q = q[:1]
        return mechanism.motion_maps(q)[:, :, np.searchsorted(mechanism.driven, self.index)]

    @cached_property
    def follower_indices(self) -> dict[str, int]:
        """Joints that no motor of the log turns alone, by name their index into ``v``.

        Of a gear that two motors drive what it drives, as ``NAME.link``; else the motor has the name.
        """
        mechanism = self.robot.mechanism
        if mechanism is None:
            shared = np.flatnonzero(np.count_nonzero(self.coupling, axis=1) > 1)
            found = {f"{self.joints[k]}.link": self.index[k] for k in shared}
        else:
            found = {self.robot.joint_names[column]: int(column) for column in mechanism.passive}
        return {name: column for name, column in found.items() if self.motion_maps[:, column].any()}

    def motor_values(self, values: Array) -> Array:
        """The motors' positions, velocities or accelerations, ``(n, n_joints, …)``, of the tree's ``(n, nv, …)``."""
        own = values if self.index == tuple(range(values.shape[1])) else values[:, list(self.index)]
        return own if self.robot.mechanism is not None or not self.is_coupled else own @ self.coupling.T

    def motor_signal(self, name: str) -> Array:
        """:meth:`motor_values` of a channel of all trials, ``q``, ``v`` or ``a``; not to be written to."""
        key = "motors", name
        if key not in self.motion_cache:
            self.motion_cache[key] = self.motor_values(self.stack_trials(name))
        return np.asarray(self.motion_cache[key])

    def on_motors(self, forces: Array, maps: Array | None = None) -> Array:
        """The tree's forces ``(n, nv, …)`` as its motors have to exert them, ``(n, n_joints, …)``.

        Args:
            forces: in the samples' configurations, or in those of ``maps``.
            maps: of other configurations, as :attr:`motion_maps`.
        """
        if not self.is_coupled:
            return self.motor_values(forces)
        maps = self.motion_maps if maps is None else maps
        flat = forces.reshape(*forces.shape[:2], -1)
        return (maps.transpose(0, 2, 1) @ flat).reshape(len(forces), -1, *forces.shape[2:])

    def rigid_torques(
        self,
        phi: Array | None = None,
        motion: Moved | None = None,
        maps: Array | None = None,
        model: pin.Model | None = None,
    ) -> Array:
        """Torques of the rigid bodies, ``(n_samples, n_joints)`` [N·m].

        Args:
            phi: ``(10·n_segments,)`` inertial parameters; the model's own if None.
            motion: of the tree, closed; the samples' own if None.
            maps: in its configurations, as :attr:`motion_maps`; None where these are the samples'.
            model: with another gravity; the robot's own if None.
        """
        return self.on_motors(
            inverse_dynamics(model or self.robot.model, *(motion or self.tree_motion), phi), maps
        )

    @cached_property
    def motor_inertias(self) -> Array:
        """Inertia of the bodies that each motor turns, mean over the motion, ``(n_joints,)`` [kg·m²]."""
        q, v, _ = self.tree_motion
        still = np.zeros_like(v)
        weight = self.rigid_torques(motion=Moved(q, still, still))
        turned = (
            self.rigid_torques(motion=Moved(q, still, np.broadcast_to(self.motion_maps[:, :, j], v.shape)))
            for j in range(len(self.joints))
        )
        return np.array([(torque - weight)[:, j].mean() for j, torque in enumerate(turned)])

    def rigid_regressor(self) -> Array:
        """Torques per unit of the inertial parameters, ``(n_samples, n_joints, 10·n_segments)``."""
        return self.on_motors(joint_torque_regressor(self.robot.model, *self.tree_motion))

    def body_rows(self) -> Array:
        """The same at the rows, ``(n_joints, n_rows, 10·n_segments)``."""
        regressor, n = self.rigid_regressor(), len(self.joints)
        joints = np.repeat(range(n), regressor.shape[2]).tolist()
        rows = self.to_rows(regressor.reshape(len(regressor), -1), joints)
        return rows.reshape(len(rows), n, -1).transpose(1, 0, 2)

    def scaled_motion(self, motor: int, factor: float) -> Moved:
        """Motion of a tree without loops where a motor turns ``factor`` times as far."""
        along = self.motion_maps[:, :, motor]
        parts = zip(self.tree_motion, ("q", "v", "a"), strict=True)
        moved = (x + (factor - 1.0) * along * self.motor_signal(name)[:, [motor]] for x, name in parts)
        return Moved(*moved)

    def perturbed_motion(
        self, motor: int, turn: float = 0.0, speed: float = 0.0, more: float = 0.0
    ) -> tuple[Moved, Array]:
        """Motion of the tree where a motor is further by ``turn``, faster by ``speed`` and accelerates ``more``.

        And the maps there.
        """
        q, v, a = self.tree_motion
        mechanism, along = self.robot.mechanism, self.motion_maps[:, :, motor]
        q, v, a = q + turn * along, v + speed * along, a + more * along
        if mechanism is None or not (turn or speed) or not np.ptp(along, axis=0).any():
            return Moved(q, v, a), self.motion_maps
        key = "moved", motor, turn, speed, more
        if key not in self.motion_cache:
            moved = mechanism.follow_driven(mechanism.close_configurations(q, near=True) if turn else q, v, a)
            self.motion_cache[key] = moved, self._maps_at(moved.q) if turn else self.motion_maps
        return self.motion_cache[key]

    def to_rows(self, signals: Array | Sequence[Array], joints: Sequence[int] | None = None) -> Array:
        """Signals at full rate, all trials below each other or one a trial, through the filter, ``(n_rows, …)``.

        Ends are held, not mirrored: rows near them are left out.

        Args:
            signals: ``(n_samples, …)``.
            joints: of the columns, the joint in whose equation each stands: both sides of it are left out where the
                joint may stick (:attr:`slip_weights`); None for signals as they are.
        """
        values = signals if isinstance(signals, np.ndarray) else np.concatenate(signals)
        weighted = None if joints is None else np.array(joints, dtype=np.int64)
        if self.bands.rows_hz >= 0.5 * self.rate_hz:
            if weighted is not None:
                values = values * self.slip_weights[:, weighted].reshape(values.shape)
            parts = zip(self.by_trial(values), self.trials, strict=True)
            return np.concatenate([part[trial.rows] for part, trial in parts])
        sections = butterworth_sections(_ORDER, self.rate_hz, self.bands.rows_hz)
        signals = values.reshape(len(values), -1)
        weights = None if weighted is None else self._slip_weights_by_joint
        smooth = both_ways(signals, *self._trial_layout, *sections, weights, weighted)
        return smooth.reshape(len(smooth), *values.shape[1:])

    @cached_property
    def _trial_layout(self) -> _Layout:
        """Where trials are in signals below each other."""
        ends, row_ends = np.cumsum(
            [[len(t.time) for t in self.trials], [len(t.rows) for t in self.trials]], 1
        )
        return _Layout(ends, np.concatenate([trial.rows for trial in self.trials]), row_ends)

    @cached_property
    def is_start(self) -> NDArray[np.bool_]:
        """Mask of the full-rate samples that are the first of a trial, ``(n_samples,)``."""
        marked = np.zeros(self._trial_layout.ends[-1], dtype=np.bool_)
        marked[np.concatenate([[0], self._trial_layout.ends[:-1]])] = True
        return marked

    @cached_property
    def repeat_pairs(self) -> tuple[Repeat, ...]:
        """Trials that run one command again."""
        return find_repeats(self.trials, self.rate_hz)

    @cached_property
    def identification_rows(self) -> NDArray[np.bool_]:
        """Mask of the rows of identification trials, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), t.identification) for t in self.trials])

    @cached_property
    def judging_rows(self) -> NDArray[np.bool_]:
        """Mask of the rows that judge, ``(n_rows,)``: of validation trials; all rows where there are none."""
        outside = ~self.identification_rows
        return outside if outside.any() else self.identification_rows

    @cached_property
    def trial_of_row(self) -> NDArray[np.int64]:
        """Index of each row's trial, ``(n_rows,)``."""
        return np.concatenate([np.full(len(t.rows), k) for k, t in enumerate(self.trials)])

    @cached_property
    def known_torque_rows(self) -> NDArray[np.bool_] | None:
        """Which rows hold no torque beyond its range, ``(n_joints, n_rows)``; None where none was."""
        if all(trial.beyond is None for trial in self.trials):
            return None
        parts = []
        for trial in self.trials:
            lost = np.zeros(trial.tau.shape, dtype=np.bool_) if trial.beyond is None else trial.beyond
            parts.append(~reached_samples(lost, self.rate_hz, self.bands.rows_hz)[trial.rows])
        return np.concatenate(parts).T

    def squared_residuals(self, values: Array) -> Array:
        """Squares of residuals ``(n_joints, n_rows)``: their means are those of the rows that hold known torques."""
        squares = values**2
        if self.known_torque_rows is None:
            return squares
        for side in (self.identification_rows, ~self.identification_rows):
            share = self.known_torque_rows[:, side].mean(axis=1, keepdims=True) if side.any() else 1.0
            squares[:, side] *= self.known_torque_rows[:, side] / np.maximum(share, 1e-9)
        return squares

    @cached_property
    def slip_weights(self) -> Array:
        """How far each joint's equation counts, ``(n_samples, n_joints)``: hardly where its motor may stick."""
        return equation_weights(self.slipping_samples(self.sticking))

    def slipping_samples(self, joints: Iterable[int]) -> NDArray[np.bool_]:
        """Where some motors surely turn, ``(n_samples, n_joints)``; True for the others."""
        made = np.ones((len(self.is_start), len(self.joints)), dtype=np.bool_)
        cutoff = self.bands.kinematics_hz
        for k in joints:
            v = self.motor_signal("v")[:, k]
            made[:, k] = surely_slips(v, self.is_start, self.standstill[k], self.rate_hz, cutoff)
        return made

    @cached_property
    def _slip_weights_by_joint(self) -> Array:
        # Joint by joint, as the filter lays signals out.
        return np.ascontiguousarray(self.slip_weights.T)

    def without_slip_weights(self, residual: Array) -> Array:
        """Residuals ``(n_joints, n_rows)`` over the largest of each joint's :attr:`slip_weights`."""
        return residual / self.slip_weights.max(axis=0)[:, None]

    @cached_property
    def motion_cache(self) -> dict[Hashable, Any]:
        """What follows from the motion alone, worked out when it is first asked for; not to be written to."""
        return {}

    def stack_trials(self, name: str) -> Array:
        """A channel of all trials at full rate, concatenated; read-only."""
        if name not in self.motion_cache:
            self.motion_cache[name] = np.concatenate([getattr(trial, name) for trial in self.trials])
        return np.asarray(self.motion_cache[name])

    @cached_property
    def nominal_torques(self) -> Array:
        """Torques of the rigid bodies as the model has them, ``(n_samples, n_joints)`` [N·m]."""
        return self.rigid_torques()

    def by_trial(self, values: Array) -> list[Array]:
        """Split full-rate values of all trials into one array a trial."""
        return np.split(values, self._trial_layout.ends[:-1])


# Where a joint may stick: dry friction is then whatever holds it, and the joint's equation says nothing.
#
# A joint whose drive is too weak for its friction stands (Karnopp 1985), for tenths of a second where motion
# is slow. Its torque goes from one side of the friction to the other then, on a way that no function of its
# motion tells, and the filter of the rows would mix that into what comes before and after. So both sides of
# its equation are multiplied by next to nothing where it may stand, before the filter: the equation holds
# there too, and weighs nothing.

# Speed up to which a joint may stick, in those up to which it may as well stand, and for how long before and after it
# the filter of the kinematics may hide that, in periods of its cut-off. Of six records of simulated arms that stick
# (MuJoCo's frictionloss made hard, fast and slow motion) rigid bodies, viscous and dry friction leave .16 times as much
# with it as without; any speed from 1 to 4 and any time from .3 to 1 give the same within .01. Where friction creeps
# instead (two records, MuJoCo's frictionloss as it comes) a speed of 1, 2 and 4 leaves .30, .21 and .14 times as much,
# and takes 8, 12 and 17 % of the samples.
_SPEED, _AROUND = 2.0, 0.5
# Of a joint that is slow throughout, no more than what is slower than this share of its usual speed. On two records of
# 8 to 28 mrad/s .1, .25, .5 and 1 leave .30, .12, .15 and .49 times what is left without, no such limit .70.
_SLOW = 0.25
# What an equation weighs where its joint may stick. Nothing would leave .147 on those arms, .01 leaves .149, .05
# leaves .178; with nothing a joint that hardly slips would have no equation.
_STUCK = 0.01


def surely_slips(
    v: Array, starts: NDArray[np.bool_], still: float, rate_hz: float, cutoff_hz: float
) -> NDArray[np.bool_]:
    """Where a motor turns, as far as the filter of the kinematics tells, ``(n,)``; always if it never moves.

    Args:
        v: its velocity in all trials, ``(n,)`` [rad/s or m/s].
        starts: which samples are the first of a trial, ``(n,)``.
        still: speed up to which it may as well stand, same unit.
        rate_hz: of the samples.
        cutoff_hz: of the filter of the kinematics.
    """
    speed = np.abs(v)
    moving = speed[speed > still]
    if not len(moving):
        return np.ones(len(v), dtype=np.bool_)
    stuck = speed <= min(_SPEED * still, _SLOW * float(np.median(moving)))
    turned = (v[1:] * v[:-1] < 0.0) & ~starts[1:]
    stuck[1:] |= turned
    stuck[:-1] |= turned
    around = round(_AROUND * rate_hz / cutoff_hz)
    return np.concatenate(
        [~widen_flags(part, around) for part in np.split(stuck, np.flatnonzero(starts)[1:])]
    )


def equation_weights(slips: NDArray[np.bool_]) -> Array:
    """What each joint's equation is multiplied by, ``(n, n_joints)``; its mean square is 1.

    One number where all motors on the joint surely slip, another, next to nothing, where one of them may stick; 1
    throughout for a joint that never surely slips.

    Args:
        slips: where they all do, likewise.
    """
    made = np.where(slips | ~slips.any(axis=0), 1.0, _STUCK)
    return np.asarray(made / np.sqrt((made**2).mean(axis=0)))
