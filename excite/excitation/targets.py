"""What is asked of minutes at the robot: parameters by joint or link, and how far motions reach them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from excite.arrays import Array, Flags
from excite.errors import InputError, UnknownNameError
from excite.excitation.precision import nominal_values
from excite.regressor.base_parameters import BaseParameters
from excite.robot.robot import Robot

# A base parameter smaller than this counts as negligible (Xu et al. 2020) [SI]: its RSD is not to decide.
NEGLIGIBLE = 0.01

# Names of columns by what people call them, as in ``coulomb(joint)`` and ``Ixx(link)``.
KINDS = {
    "friction": ("viscous", "coulomb", "offset"),
    "mass": ("m",),
    "com": ("mx", "my", "mz"),
    "inertia": ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
}


def asked_parameters(targets: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Names of base parameters that targets such as ``elbow_joint:friction`` or ``forearm_link:com`` mean.

    Args:
        targets: joint or link, a colon, and one of ``KINDS``, or a name itself; all parameters, if empty.
        names: of the base parameters' own columns.

    Raises:
        InputError: no colon, or no base parameter of that joint or link and kind.
        UnknownNameError: an unknown kind.
    """
    if not targets:
        return tuple(names)
    found: list[str] = []
    for target in targets:
        if target in names:
            found.append(target)
            continue
        owner, colon, kind = target.rpartition(":")
        if not colon:
            raise InputError(
                f"{target!r} has no colon", field="targets", remedy="write joint:friction or link:com"
            )
        if kind not in KINDS:
            raise UnknownNameError("kind of target", kind, list(KINDS))
        own = [name for name in names if name in {f"{term}({owner})" for term in KINDS[kind]}]
        if not own:
            there = [
                f"{owner}:{one}"
                for one, terms in KINDS.items()
                if any(f"{t}({owner})" in names for t in terms)
            ]
            owners = sorted({name.partition("(")[2][:-1] for name in names})
            raise InputError(
                f"no motion tells {target!r} by itself",
                field="targets",
                remedy=f"ask for {' or '.join(there)}" if there else f"the robot shows {', '.join(owners)}",
            )
        found += own
    return tuple(dict.fromkeys(found))


def wanted_parameters(robot: Robot, base: BaseParameters, targets: Sequence[str]) -> Flags:
    """Which base parameters targets ask for, ``(n_base,)``: without targets those whose value in the model counts."""
    names = asked_parameters(targets, base.labels)
    wanted = np.array([name in names for name in base.labels])
    return wanted if targets else wanted & (np.abs(nominal_values(robot, base)) > NEGLIGIBLE)


@dataclass(frozen=True, eq=False)
class ReachedTargets:
    """Minus how far standard deviations are above their goals: ``−Σ weight log(1 + (σ/goal)²)/2``.

    A parameter far from its goal counts as in the log-determinant, one that has met it hardly at all.

    Attributes:
        back: ``(n, k)`` from the coordinates of the information to the parameters that are asked for.
        goal: ``(n,)`` standard deviations to reach [SI].
        weight: ``(n,)``, or of all alike.
    """

    back: Array
    goal: Array
    weight: Array | float = 1.0

    @classmethod
    def of(
        cls,
        robot: Robot,
        base: BaseParameters,
        targets: Sequence[str],
        *,
        target_rsd: float,
        rows: float,
        back: Array | None = None,
    ) -> ReachedTargets:
        """The criterion of targets.

        Args:
            robot: the robot.
            base: its base parameters.
            targets: as of :func:`wanted_parameters`.
            target_rsd: relative standard deviation to reach [percent].
            rows: rows of the information for each independent one.
            back: ``(n_base, k)`` to the base parameters; the identity, if None.
        """
        wanted = wanted_parameters(robot, base, targets)
        values = np.maximum(np.abs(nominal_values(robot, base)), NEGLIGIBLE)
        back = np.eye(len(values)) if back is None else back
        return cls(back[wanted], 0.01 * target_rsd * values[wanted] / np.sqrt(rows))

    def within(self, most: Array) -> ReachedTargets:
        """Each target weighted by how near the most information there can be, ``(k, k)``, brings it: 1/(1 + (σ/goal)²).

        What all candidates together do not tell no choice of them does: seconds for it are lost to the others.
        """
        return replace(self, weight=1.0 / (1.0 + self._excess(most)[0]))

    def value(self, information: Array) -> float:
        """Of an information matrix ``(k, k)``."""
        return -float(0.5 * (self.weight * np.log1p(self._excess(information)[0])).sum())

    def gradient(self, information: Array) -> Array:
        """``½ M⁻¹ Tᵀ diag(weight/(goal² + σ²)) T M⁻¹``."""
        excess, solved = self._excess(information)
        return np.asarray((solved * (0.5 * self.weight / (self.goal**2 * (1.0 + excess)))) @ solved.T)

    def _excess(self, information: Array) -> tuple[Array, Array]:
        """``(σ/goal)²``, ``(n,)``, and ``M⁻¹ Tᵀ``."""
        solved = cho_solve(cho_factor(information), self.back.T)
        return np.einsum("bk,kb->b", self.back, solved) / self.goal**2, solved
