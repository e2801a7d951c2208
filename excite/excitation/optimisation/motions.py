"""Families of motions that are linear in their coefficients, over which the optimisation searches."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.motion.generators.curves import Curve, FourierCurve
from excite.motion.generators.joint_motions import start_conditions

# Families of motions that are linear in their coefficients: what the program searches in.


class MotionFamily(ABC):
    """Motions ``q_j(t) = offset_j + Σ_k basis_k(t) c_jk``, from rest at the offset to rest, all joints alike."""

    @property
    @abstractmethod
    def n_coefficients(self) -> int:
        """Coefficients of one joint."""

    @property
    @abstractmethod
    def length(self) -> float:
        """Duration [s]."""

    @property
    @abstractmethod
    def fastest_hz(self) -> float:
        """Frequency of the fastest part of the basis [Hz]: what a grid in time has to resolve."""

    @abstractmethod
    def basis(self, time: Array, order: int) -> Array:
        """Values or derivatives of the basis, ``(n, n_coefficients)``."""

    @abstractmethod
    def curve(self, offset: Array, coefficients: Array) -> Curve:
        """The motion of offsets ``(n_joints,)`` and coefficients ``(n_joints, n_coefficients)``."""

    def grid(self, per_cycle: float) -> Array:
        """Times ``(n,)`` with that many samples in a cycle of the fastest part; the end, like the start, is rest."""
        n = max(16, int(np.ceil(self.length * self.fastest_hz * per_cycle)))
        return np.arange(n) * self.length / n


class FourierFamily(MotionFamily):
    """One period of a finite Fourier series (Ni et al. 2024, eq. 8) that starts and ends at rest.

    The conditions on the coefficients are solved once and for all: what is left to choose are coordinates in
    their null space.
    """

    def __init__(self, period: float, harmonics: int) -> None:
        if not (np.isfinite(period) and period > 0.0):
            raise InputError(f"period of {period} s", field="period", remedy="give a positive one")
        if harmonics < 3:
            raise InputError(
                f"{harmonics} harmonics", field="harmonics", remedy="a start at rest needs at least 3"
            )
        self._omega = 2.0 * np.pi / period
        self._harmonics = harmonics
        self._sine, self._cosine = (_null_space(rows) for rows in start_conditions(self._omega, harmonics))

    @property
    def n_coefficients(self) -> int:
        """Sines first."""
        return int(self._sine.shape[1] + self._cosine.shape[1])

    @property
    def length(self) -> float:
        """One period [s]."""
        return 2.0 * np.pi / self._omega

    @property
    def fastest_hz(self) -> float:
        """Of the highest harmonic."""
        return self._harmonics / self.length

    def basis(self, time: Array, order: int) -> Array:
        """Values or derivatives, by evaluating the curves of the unit vectors."""
        return self.curve(np.zeros(self.n_coefficients), np.eye(self.n_coefficients)).evaluate(time, order)

    def curve(self, offset: Array, coefficients: Array) -> FourierCurve:
        """The series."""
        n = self._sine.shape[1]
        a, b = coefficients[:, :n] @ self._sine.T, coefficients[:, n:] @ self._cosine.T
        return FourierCurve(np.asarray(offset, dtype=float), a, b, self._omega)


def _null_space(rows: Array) -> Array:
    return np.linalg.svd(rows)[2][len(rows) :].T
