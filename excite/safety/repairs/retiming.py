"""A time law for a path: as fast as the limits allow (toppra), then smoothed; and transfers (ruckig)."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.safety.repairs.draft import Draft, Rejection, Repair
from excite.safety.repairs.path import TimeLaw
from excite.safety.repairs.rows import PathLimits, Rows

# Shortest time that the path parameter takes for one unit [s], where nothing else limits it.
_FASTEST = 0.12
# Largest change of its rate in time [1/s²]: what changes more slowly than the kernel, the kernel leaves alone.
_SLOPE = 12.0
# Width of the kernel that smooths the time law, and the step of its samples [s].
_KERNEL = 0.14
_STEP = 0.0025
SHARE_USED = "of what it may use"


class Retiming(Repair):
    """Runs the path as fast as velocity, acceleration, torque, ZMP and friction allow, with bounded jerk.

    toppra (Pham and Pham 2018) gives the fastest speed profile, whose acceleration jumps; the convolution of
    ``s(t)`` with a smooth positive kernel of 0.14 s takes the jumps away. What the smoothing may violate the
    next repair takes back. Curves with a speed of their own keep it: they start and end at rest anyway.
    """

    name: ClassVar[str] = "retiming"

    def repair(self, draft: Draft) -> Draft | Rejection:
        """A draft with a time law, or the rejection ``no_time_law``."""
        if draft.path is None:
            return draft.rejected("no_path", "path")
        candidate = draft.candidate
        limits = PathLimits(candidate, draft.path, self.shares)
        if candidate.speed is not None:
            s = np.linspace(0.0, candidate.length, 5)
            law = TimeLaw(s / candidate.speed, s, (candidate.speed, candidate.speed))
            return replace(draft, limits=limits, law=law)
        rows = limits.rows(draft.path.knots)
        rate = fastest_rate(draft.path.s, rows, limits.speed_bound())
        if rate is None:
            return _standing_still(draft, rows)
        return replace(draft, limits=limits, law=smoothed_law(draft.path.s, rate))


def _standing_still(draft: Draft, rows: Rows) -> Rejection:
    """Why a path has no speed at all: what is beyond its limit by most while the robot stands on it."""
    worst = np.unravel_index(int(np.argmax(rows.static)), rows.static.shape)
    excess = float(rows.static[worst])
    if excess <= 0.0:
        return draft.rejected("no_time_law", "path")
    reason, where = rows.labels[int(worst[1])]
    if reason.endswith("joint_torque"):
        return draft.rejected(reason, where, None, 1.0 + excess, 1.0, SHARE_USED)
    if reason.endswith("zmp"):
        # Rows are relative to the weight, which the ground carries here: what is left is a distance.
        return draft.rejected(reason, where, None, -excess, 0.0, "m inside the edge")
    return draft.rejected(reason, where, None, excess, 0.0, "of its weight")


def fastest_rate(s: Array, rows: Rows, bound: Array) -> Array | None:
    """The largest ``ṡ`` at each of the knots ``(n,)`` under rows and a bound, or None if there is none."""
    with _without_warnings(), _without_pyplot():
        import toppra
        from toppra.algorithm import TOPPRA
        from toppra.constraint import LinearConstraint

    class RowConstraint(LinearConstraint):
        """The rows as toppra takes them: a u + b x + c = w, F w ≤ g."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True

        def compute_constraint_params(
            self, path: object, gridpoints: object, *args: Any, **kwargs: Any
        ) -> tuple[Array | None, ...]:
            top = np.minimum(bound, 1.0 / _FASTEST) ** 2
            xbound = np.column_stack([np.zeros(len(s)), top])
            m = rows.static.shape[1]
            ubound = np.tile([-_SLOPE, _SLOPE], (len(s), 1))
            return rows.driven, rows.curved, rows.static, np.eye(m), np.zeros(m), ubound, xbound

    path = toppra.SplineInterpolator([0.0, float(s[-1])], [[0.0], [1.0]])
    problem = TOPPRA([RowConstraint()], path, gridpoints=s, solver_wrapper="seidel")
    _, rate, _ = problem.compute_parameterization(0.0, 0.0)
    if rate is None or not np.isfinite(rate).all():
        return None
    return np.asarray(rate)


class _Pyplot(ModuleType):
    """Stands for matplotlib's pyplot where that is imported in case something is drawn."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(import_module("matplotlib.pyplot"), name)


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Import toppra without what Python 3.12 and later say of its docstrings where it was not compiled before."""
    if "toppra" in sys.modules:
        yield
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)
        yield


@contextmanager
def _without_pyplot() -> Iterator[None]:
    """Import what draws when it is asked to, without what it would draw with: that takes a third of a second."""
    if "matplotlib" in sys.modules:
        yield
        return
    package, plots = ModuleType("matplotlib"), _Pyplot("matplotlib.pyplot")
    package.pyplot = plots  # type: ignore[attr-defined]
    sys.modules |= {"matplotlib": package, "matplotlib.pyplot": plots}
    try:
        yield
    finally:
        del sys.modules["matplotlib"], sys.modules["matplotlib.pyplot"]


def smoothed_law(s: Array, rate: Array) -> TimeLaw:
    """The time law of a speed profile, convolved with a smooth kernel.

    Args:
        s: knots, ``(n,)``.
        rate: ``ṡ`` at the knots, ``(n,)``, not twice zero in a row; ``ṡ²`` is linear in between.
    """
    step = 2.0 * np.diff(s) / (rate[:-1] + rate[1:])
    knots = np.r_[0.0, np.cumsum(step)]
    half = round(0.5 * _KERNEL / _STEP)
    n = int(np.ceil(knots[-1] / _STEP)) + 1
    time = np.arange(n) * _STEP
    i = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(s) - 2)
    tau = np.minimum(time - knots[i], step[i])
    slope = (rate[i + 1] - rate[i]) / step[i]
    values = np.minimum(s[i] + rate[i] * tau + 0.5 * slope * tau**2, s[-1])
    values = np.concatenate([np.full(2 * half, s[0]), values, np.full(2 * half, s[-1])])
    kernel = np.sin(np.linspace(0.0, np.pi, 2 * half + 1)) ** 2
    smooth = np.convolve(values, kernel / kernel.sum(), mode="valid")
    smooth[0], smooth[-1] = s[0], s[-1]
    smooth = np.minimum(np.maximum.accumulate(smooth), s[-1])
    return TimeLaw(np.arange(len(smooth), dtype=np.float64) * _STEP, np.asarray(smooth, dtype=np.float64))
