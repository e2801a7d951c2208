"""Mechanisms: a tree that loops and couplings close, and the equations of the motors that are left.

With ``K(q)`` the Jacobian of the closures, velocities are ``v = G v_m`` of those of the motors, and forces in the
cuts do no work, ``Gᵀ Kᵀ = 0``: the motors' torques are ``Gᵀ`` times the tree's generalised forces, ``τ_m = Gᵀ Y φ``
(Nakamura and Ghodoussi 1989; for identification Khalil and Dombre 2002, section 10.6).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from excite.arrays import Array, Indices, Moved
from excite.errors import MotionError
from excite.robot.mechanisms.closures import SINGULAR, Closure, Coupling, Loop, Rod

# Closing a tree of joints: positions of those that no motor drives, by Newton's method on loops and
# couplings.


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A tree that is closed, and how velocities, accelerations and forces go through it to its motors.

    Attributes:
        model: the tree; every joint of a closure has one coordinate.
        closures: its loops and couplings.
        passive: ``(n_passive,)`` indices into ``v`` of joints without a motor.
        rest: ``(nq,)`` closed configuration from which others are reached.
    """

    model: pin.Model
    closures: tuple[Closure, ...]
    passive: Indices
    rest: Array

    @property
    def driven(self) -> Indices:
        """Indices into ``v`` of all others: motors, and a free base."""
        return np.setdiff1d(np.arange(self.model.nv), self.passive)

    @cached_property
    def ratios(self) -> ConstantRatios | None:
        """All closures as constant ratios, which need no search; None where one is more than that."""
        return ConstantRatios.from_closures(self.model, self.closures, self.passive, self.driven)

    @property
    def meeting(self) -> set[frozenset[int]]:
        """Pairs of model joints whose links meet where a loop closes."""
        loops = [closure for closure in self.closures if isinstance(closure, Loop)]
        return {frozenset(loop.joints) for loop in loops if not isinstance(loop, Rod)}

    @property
    def looped(self) -> set[int]:
        """Model joints within loops: those that carry one of the links that meet and not the other."""
        ends = [loop.joints for loop in self.closures if isinstance(loop, Loop)]
        carry = [[set(self.model.supports[joint]) for joint in pair] for pair in ends]
        return {joint for one, other in carry for joint in one ^ other}

    def close_configurations(self, q: Array, *, near: bool = False) -> Array:
        """Configurations whose closures hold, the passive joints moved alone.

        Args:
            q: ``(n, nq)``; passive joints are found from the sample before, those of the first from rest.
            near: whether they are found from where ``q`` has them, which is nearly closed.

        Returns:
            ``(n, nq)``.

        Raises:
            MotionError: a loop cannot be closed.
        """
        if self.ratios is not None:
            return self.ratios.close_configurations(q)
        data, out, before = self.model.createData(), np.array(q, dtype=float), self.rest
        for i in range(len(out)):
            before = out[i] = (
                self._close_configuration(data, out[i], i)
                if near
                else self._reach_configuration(data, before, out[i], i)
            )
        return out

    def closure_gaps(self, q: Array) -> Array:
        """How far the worst closure is open, ``(n,)`` [m or rad]."""
        if self.ratios is not None:
            return self.ratios.closure_gaps(q)
        data, out = self.model.createData(), np.zeros(len(q))
        for i in range(len(q)):
            pin.forwardKinematics(self.model, data, q[i])
            out[i] = np.abs(self._closure_gap(q[i], data)).max(initial=0.0)
        return out

    def widest_closure(self, q: Array) -> str:
        """Name of the closure that is widest open at ``q`` ``(nq,)``."""
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        return self._widest_step(q, data).name

    def _widest_step(self, q: Array, data: pin.Data) -> Closure:
        return max(self.closures, key=lambda closure: float(np.abs(closure.gap(q, data)).max()))

    def _reach_configuration(self, data: pin.Data, start: Array, q: Array, sample: int) -> Array:
        """``q`` closed, on the way of the driven joints from the closed configuration ``start``."""
        columns = self.model.nq - self.model.nv + self.passive
        way = pin.difference(self.model, start, q)
        way[self.passive] = 0.0
        far = np.abs(way[6:] if self._free else way).max(initial=0.0)
        # Configurations further apart than this [rad or m] are joined by others in between, for the same reason.
        count, before = max(1, int(np.ceil(far / 0.2))), start
        for k in range(1, count + 1):
            here = pin.integrate(self.model, start, way * (k / count)) if k < count else q.copy()
            here[columns] = before[columns]
            before = self._close_configuration(data, here, sample)
        return before

    @property
    def _free(self) -> bool:
        return bool(self.model.nq != self.model.nv)

    def _close_configuration(self, data: pin.Data, q: Array, sample: int) -> Array:
        step = np.zeros(self.model.nv)
        # Newton's method takes 3 to 6 steps where a mechanism is within reach, and never ends where it is not.
        for _ in range(15):
            pin.computeJointJacobians(self.model, data, q)
            gap = self._closure_gap(q, data)
            # Gaps are closed to this [m or rad]: far below what geometry is known to, far above rounding.
            if np.abs(gap).max(initial=0.0) < 1e-10:
                return q
            move = -np.linalg.pinv(self._closure_jacobian(q, data)[:, self.passive], rcond=SINGULAR) @ gap
            # A step of Newton's method turns no joint further than this [rad], so that it stays on the branch it is on.
            step[self.passive] = move * min(1.0, 0.3 / max(float(np.abs(move).max()), 1e-300))
            q = pin.integrate(self.model, q, step)
        worst = self._widest_step(q, data)
        raise MotionError(
            f"cannot be closed at sample {sample}: {1e3 * float(np.abs(worst.gap(q, data)).max()):.3g} mm or mrad"
            " stay open",
            field=f"{worst.field}.{worst.name}",
            remedy="check it in robot.yaml, and that positions are within reach",
        )

    def _closure_gap(self, q: Array, data: pin.Data) -> Array:
        return np.concatenate([closure.gap(q, data) for closure in self.closures])

    def _closure_jacobian(self, q: Array, data: pin.Data) -> Array:
        return np.vstack([closure.jacobian(self.model, q, data) for closure in self.closures])

    def complete_motion(self, q: Array, v: Array, a: Array) -> Moved:
        """Configurations, velocities and accelerations of which the passive ones follow from the others.

        Args:
            q: ``(n, nq)``.
            v: ``(n, nv)``.
            a: ``(n, nv)``.

        Raises:
            MotionError: a loop cannot be closed, or its joints do not follow from the motors.
        """
        return self.follow_driven(self.close_configurations(q), v, a)

    def follow_driven(self, q: Array, v: Array, a: Array) -> Moved:
        """The same at configurations ``(n, nq)`` that are closed."""
        v, a = np.array(v, dtype=float), np.array(a, dtype=float)
        passive, driven, still = self.passive, self.driven, np.zeros(self.model.nv)
        if self.ratios is not None:
            for rates in (v, a):
                rates[:, passive] = rates[:, driven] @ self.ratios.velocities.T
            return Moved(q, v, a)
        for i, (data, inverse, own) in enumerate(self._solve_configurations(q)):
            v[i, passive] = own @ v[i, driven]
            pin.forwardKinematics(self.model, data, q[i], v[i], still)
            drifts = [closure.drift(self.model, q[i], v[i], data) for closure in self.closures]
            a[i, passive] = own @ a[i, driven] - inverse @ np.concatenate(drifts)
        return Moved(q, v, a)

    def motion_maps(self, q: Array) -> Array:
        """``G``: velocities per velocity of what is driven, ``(n, nv, n_driven)``.

        Args:
            q: ``(n, nq)`` configurations.

        Raises:
            MotionError: the passive joints do not follow from the others: too few loops, or a singular position.
        """
        driven = self.driven
        maps = np.zeros((len(q), self.model.nv, len(driven)))
        maps[:, driven, np.arange(len(driven))] = 1.0
        if self.ratios is not None:
            maps[:, self.passive] = self.ratios.velocities
        else:
            for i, (_, _, own) in enumerate(self._solve_configurations(q)):
                maps[i, self.passive] = own
        return maps

    def _solve_configurations(self, q: Array) -> Iterator[tuple[pin.Data, Array, Array]]:
        """By configuration: data with Jacobians of the joints, the inverse of the passive ones' part of the closures'.

        It is ``(n_passive, n_equations)``; with it come these joints' velocities per velocity of what is driven.
        """
        data, driven = self.model.createData(), self.driven
        for i in range(len(q)):
            pin.computeJointJacobians(self.model, data, q[i])
            jacobian = self._closure_jacobian(q[i], data)
            # Pseudo-inverse of the passive joints' part, (n_passive, n_equations), once it determines them all.
            sample = i
            own = jacobian[:, self.passive]
            u, s, vt = np.linalg.svd(own, full_matrices=False)
            rank = int((s > SINGULAR * max(float(s.max(initial=0.0)), 1e-300)).sum())
            if rank < len(self.passive):
                loose = int(np.argmax(np.abs(np.linalg.svd(own)[2][-1])))
                where = list(self.model.idx_vs).index(int(self.passive[loose]), 1)
                raise MotionError(
                    f"does not follow from the motors at sample {sample}: {len(self.passive)} passive joints, and the"
                    f" loops determine {rank}",
                    field=f"joint {self.model.names[where]!r}",
                    remedy="state the loop that is missing, or keep away from its singular position",
                )
            inverse = np.asarray((vt.T / s) @ u.T)
            yield data, inverse, -inverse @ jacobian[:, driven]

    def on_motors(self, q: Array, forces: Array) -> Array:
        """The tree's generalised forces as the motors (and a free base) have to exert them.

        Args:
            q: ``(n, nq)`` closed configurations.
            forces: ``(n, nv)`` or ``(n, nv, k)``, such as a regressor.

        Returns:
            The same shape; zero for passive joints.

        Raises:
            MotionError: as :meth:`motion_maps`.
        """
        out = np.zeros_like(forces)
        out[:, self.driven] = np.einsum("nij,ni...->nj...", self.motion_maps(q), forces)
        return out

    def draw_configurations(self, rng: np.random.Generator, lower: Array, upper: Array, n: int) -> Array:
        """Closed configurations ``(n, nq)`` whose driven joints are drawn between bounds ``(n_joints,)``.

        A draw out of reach is pulled towards rest until it is within. A free base stays at rest.
        """
        data = self.model.createData()
        first = self.model.nq - len(lower)
        out = np.empty((n, self.model.nq))
        for i in range(n):
            way, share = np.zeros(self.model.nq), 1.0
            way[first:] = rng.uniform(lower, upper) - self.rest[first:]
            while True:
                try:
                    out[i] = self._reach_configuration(data, self.rest, self.rest + share * way, i)
                    self.motion_maps(out[i : i + 1])
                    break
                except MotionError:
                    # A random configuration out of reach is tried again at this share of its way from rest.
                    share *= 0.6
        return out

    def following_from(self, given: Indices) -> Mechanism:
        """The same with other joints moved to close it: none of ``given`` (indices into ``v``) if that can be.

        Passive joints among ``given`` are exchanged for driven ones that the same closures move.
        """
        wanted = np.intersect1d(self.passive, given)
        if not len(wanted):
            return self
        data = self.model.createData()
        pin.computeJointJacobians(self.model, data, self.rest)
        jacobian = self._closure_jacobian(self.rest, data)
        moved = np.flatnonzero(np.abs(jacobian).max(axis=0) > SINGULAR * np.abs(jacobian).max())
        base = np.arange(6 if self._free else 0)
        passive = np.setdiff1d(self.passive, given)
        for column in np.setdiff1d(moved, np.concatenate([given, base, passive])):
            if len(passive) == len(self.passive):
                break
            more = np.sort(np.append(passive, column))
            if np.linalg.matrix_rank(jacobian[:, more], tol=SINGULAR * np.abs(jacobian).max()) == len(more):
                passive = more
        return replace(self, passive=passive) if len(passive) == len(self.passive) else self


# Couplings of constant ratios, such as a hand's fingers have: all samples at once, without Newton's method.


@dataclass(frozen=True, eq=False)
class ConstantRatios:
    """Closures that are all sums of joints times constants, as many as joints that follow from them.

    Attributes:
        sums: ``(n_passive, nq)`` factors of all positions in each closure.
        offset: ``(n_passive,)`` what each adds up to [rad or m].
        columns: indices into ``q`` of the joints that follow.
        velocities: ``(n_passive, n_driven)`` velocities of these per velocity of what is driven.
    """

    sums: Array
    offset: Array
    columns: list[int]
    velocities: Array

    @classmethod
    def from_closures(
        cls,
        model: pin.Model,
        closures: Sequence[Closure],
        passive: Indices,
        driven: Indices,
    ) -> ConstantRatios | None:
        """The ratios of a tree's closures; None where one is no such sum, or they leave a joint loose or contradict."""
        sums = [closure for closure in closures if isinstance(closure, Coupling) and closure.constant]
        if len(sums) != len(closures) or len(sums) != len(passive):
            return None
        of_q, of_v = np.zeros((len(sums), model.nq)), np.zeros((len(sums), model.nv))
        for row, coupling in enumerate(sums):
            for (position, column), factors in zip(coupling.columns, coupling.factors, strict=True):
                of_q[row, position] += factors[0]
                of_v[row, column] += factors[0]
        own = of_v[:, passive]
        sizes = np.linalg.svd(own, compute_uv=False)
        if not len(sizes) or sizes[-1] <= SINGULAR * sizes[0]:
            return None
        place = {
            int(model.idx_vs[joint]): int(model.idx_qs[joint])
            for joint in range(1, model.njoints)
            if model.nvs[joint] == model.nqs[joint] == 1
        }
        return cls(
            of_q,
            np.array([coupling.offset for coupling in sums]),
            [place[int(column)] for column in passive],
            -np.linalg.solve(own, of_v[:, driven]),
        )

    def close_configurations(self, q: Array) -> Array:
        """Configurations ``(n, nq)`` in which these joints stand as the others want it."""
        out = np.array(q, dtype=float)
        out[:, self.columns] = 0.0
        out[:, self.columns] = np.linalg.solve(
            self.sums[:, self.columns], (self.offset - out @ self.sums.T).T
        ).T
        return out

    def closure_gaps(self, q: Array) -> Array:
        """How far the worst closure is open, ``(n,)`` [rad or m]."""
        return np.asarray(np.abs(q @ self.sums.T - self.offset).max(axis=1))


def build_mechanism(
    model: pin.Model,
    closures: Sequence[Closure],
    passive: Sequence[str],
    rest: Array | None = None,
    carrying: Sequence[int] = (),
) -> Mechanism:
    """A mechanism by the names of its passive joints, each of one coordinate, at rest near ``rest`` ``(nq,)``.

    Joints below the model joints ``carrying`` stay as ``rest`` has them where others can close it.

    Raises:
        MotionError: it cannot be closed there, or passive joints do not follow from the motors.
    """
    columns = sorted(int(model.idx_vs[model.getJointId(name)]) for name in passive)
    near = pin.neutral(model) if rest is None else rest
    open_ = Mechanism(model, tuple(closures), np.array(columns, dtype=np.int64), near)
    by = open_.following_from(limb_columns(model, carrying)) if carrying else open_
    closed = replace(open_, rest=by.close_configurations(near[None])[0])
    closed.motion_maps(closed.rest[None])
    return closed


def limb_columns(model: pin.Model, joints: Sequence[int]) -> Indices:
    """Indices into ``v`` of the joints of one coordinate between the base and any of ``joints``."""
    chain = sorted({int(j) for joint in joints for j in model.supports[joint]})
    return np.array([int(model.idx_vs[j]) for j in chain if model.nvs[j] == 1], dtype=np.int64)
