"""Logs of several days, gains or speeds: what they agree on and what changes between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.display import Shown, span
from excite.errors import LogError
from excite.identification.changed_segments import (
    ParameterRange,
    parameter_ranges,
    possible_ends,
    ranges_document,
    write_document,
)
from excite.identification.estimators.settings import EstimatorSettings
from excite.identification.problem import build_problem
from excite.identification.regression import RANK_TOLERANCE, Regression, condense_problem, iterate_weights
from excite.identification.sessions.pooling import Pooled, pool_estimates
from excite.identification.statistics import base_statistics, parameter_labels
from excite.logs.log import Log
from excite.regressor.base_parameters import BaseParameters, base_parameters
from excite.results import (
    ADDED,
    FEW,
    HIDDEN,
    Name,
    Positive,
    Stated,
    Unbounded,
    UnboundedPositive,
    added_as,
    stated,
)
from excite.robot.robot import Robot
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread


@dataclass(frozen=True)
class SessionValue(Stated):
    """A base parameter in one session.

    Attributes:
        value: [SI].
        std: its standard deviation [SI].
    """

    value: Unbounded
    std: UnboundedPositive


@dataclass(frozen=True)
class SessionParameter(Stated):
    """A base parameter in all sessions.

    Attributes:
        name: the parameter that stands for it.
        expression: the whole combination.
        value: over the sessions [SI].
        between_std: standard deviation between sessions [SI].
        low: lower end of where the next session's lies [SI].
        high: upper end of it [SI].
        by_session: by session.
        varies: whether sessions lie further apart than their intervals allow.
        std: standard deviation of ``value`` [SI].
        inconsistency: share of the spread of the sessions' estimates that is no noise, 0 to 1.
        mean_low: lower end of where the mean over all possible sessions lies [SI].
        mean_high: upper end of it [SI].
    """

    name: str
    expression: str
    value: Unbounded
    between_std: UnboundedPositive
    low: Unbounded
    high: Unbounded
    by_session: Annotated[Mapping[Name, SessionValue], FEW]
    varies: bool = field(metadata=added_as(False))
    std: UnboundedPositive = field(metadata=ADDED)
    inconsistency: Unbounded = field(metadata=ADDED)
    mean_low: Unbounded = field(metadata=ADDED)
    mean_high: Unbounded = field(metadata=ADDED)


@dataclass(frozen=True, eq=False, repr=False)
class Sessions(Shown, Stated):
    """What several sessions say, each by itself and all together.

    Attributes:
        names: of the sessions.
        base: base parameters that every session determines.
        values: ``(n_sessions, n_base)`` least-squares values [SI].
        std: ``(n_sessions, n_base)`` standard deviations within the sessions.
        pooled: over the sessions.
        ranges: for domain randomisation: parameters of links and drives in a session yet to come.
        possible: ``(2, n_base)`` ends between which they lie in any robot, infinite for none.
        left_out: sessions whose motions do not determine all of them, with the number that they do.
    """

    names: tuple[Name, ...]
    base: BaseParameters = field(metadata=HIDDEN)
    values: Array = field(metadata=HIDDEN)
    std: Array = field(metadata=HIDDEN)
    pooled: Pooled = field(metadata=HIDDEN)
    ranges: tuple[ParameterRange, ...] = field(metadata=ADDED)
    possible: Array = field(metadata=HIDDEN)
    left_out: Annotated[Mapping[Name, int], FEW] = field(default_factory=dict)

    @property
    def varies(self) -> NDArray[np.bool_]:
        """Which base parameters' sessions lie further apart than their own intervals allow, ``(n_base,)``."""
        return self.pooled.varies(len(self.names))

    @property
    def next_interval(self) -> Array:
        """Where base parameters of a session yet to come lie, of what a robot can have, ``(2, n_base)``."""
        return np.clip(self.pooled.next_interval, *self.possible)

    @property
    @stated
    def level(self) -> Positive:
        """Level of the intervals."""
        return self.pooled.level

    @property
    @stated
    def parameters(self) -> tuple[SessionParameter, ...]:
        """Base parameters that every session determines."""
        pooled, varies, (low, high) = self.pooled, self.varies, self.next_interval
        return tuple(
            SessionParameter(
                name=label,
                expression=self.base.expressions[i],
                value=float(pooled.mean[i]),
                between_std=float(pooled.between[i]),
                low=float(low[i]),
                high=float(high[i]),
                by_session={
                    name: SessionValue(float(self.values[s, i]), float(self.std[s, i]))
                    for s, name in enumerate(self.names)
                },
                varies=bool(varies[i]),
                std=float(np.sqrt(pooled.covariance[i, i])),
                inconsistency=float(pooled.inconsistency[i]),
                mean_low=float(pooled.mean_interval[0, i]),
                mean_high=float(pooled.mean_interval[1, i]),
            )
            for i, label in enumerate(self.base.labels)
        )

    def summary(self) -> str:
        """How many parameters differ between sessions, and the worst, in units of their noise."""
        between, within = self.pooled.between, np.median(self.std, axis=0)
        ratio = between / np.maximum(within, 1e-300)
        lines = [
            f"{len(self.names)} sessions ({', '.join(self.names)}): {int(self.varies.sum())} of {len(between)} base "
            "parameters differ between them by more than their intervals allow"
        ]
        lines += [
            f"  left out: {name}, whose motions determine {own} of the {len(between)}"
            for name, own in self.left_out.items()
        ]
        for i in np.argsort(-ratio, kind="stable")[:5]:
            low, high = self.next_interval[:, i]
            lines.append(
                f"  {self.base.labels[i]}: {self.pooled.mean[i]:.4g}, sessions differ by {between[i]:.2g} "
                f"(noise of one {within[i]:.2g}); the next lies in {span(f'{low:.4g}', f'{high:.4g}')}"
            )
        return "\n".join(lines)


def write_ranges(sessions: Sessions, path: Path) -> Path:
    """Write what the next session may bring, for domain randomisation (``excite.ranges/1``, YAML or JSON).

    Links' quantities are not independent of each other: what the data fix are the base parameters, whose
    ranges stand beside. Those with a small share ``measured`` are the nominal model's spread. Values that no robot
    has are left out (``clipped``): negative masses, moments of inertia, friction and rotors, products of inertia
    beyond half the moment across them. ``varies_between_sessions`` names the base parameters whose sessions lie
    further apart than their own intervals allow, with each session's value.

    Args:
        sessions: what was identified.
        path: the YAML file to write.

    Returns:
        The file.
    """
    document = ranges_document(sessions.ranges, sessions.pooled.level)
    low, high = sessions.next_interval
    value = np.clip(sessions.pooled.mean, *sessions.possible)
    clipped = np.any(sessions.next_interval != sessions.pooled.next_interval, axis=0)
    varies = sessions.varies
    document["base_parameters"] = {
        label: {
            "low": float(low[i]),
            "high": float(high[i]),
            "value": float(value[i]),
            "varies": bool(varies[i]),
            "expression": sessions.base.expressions[i],
        }
        | ({"clipped": True} if clipped[i] else {})
        for i, label in enumerate(sessions.base.labels)
    }
    document["varies_between_sessions"] = {
        sessions.base.labels[i]: {
            name: {"value": float(sessions.values[s, i]), "std": float(sessions.std[s, i])}
            for s, name in enumerate(sessions.names)
        }
        for i in np.flatnonzero(varies)
    }
    return write_document(document, path)


@one_blas_thread
def identify_sessions(
    robot: Robot,
    sessions: Mapping[str, Log],
    *,
    settings: EstimatorSettings | None = None,
    problem_settings: ProblemSettings | None = None,
    level: float = 0.95,
) -> Sessions:
    """Identify every session by itself and pool the base parameters by random effects.

    All trials of a session are used, whatever their role. A session that leaves parameters undetermined which the
    others show is left out, as long as two remain.

    Args:
        robot: the robot.
        sessions: a log for each session, of the same joints and channels.
        settings: spreads of the nominal model, for the links' ranges.
        problem_settings: filters and drive terms.
        level: of the intervals and ranges.

    Returns:
        Each session's parameters, and what they have in common.

    Raises:
        LogError: robot and logs do not fit, or fewer than two sessions determine all that they show together.
        InputError: fewer than two sessions.
    """
    rows = {
        name: iterate_weights(condense_problem(build_problem(robot, log, problem_settings, role=None)))
        for name, log in sessions.items()
    }
    base = _common_base(rows)
    left_out = _poorer_sessions(rows, base)
    if len(rows) - len(left_out) < 2:
        name, own = next(iter(left_out.items()))
        raise LogError(
            f"determines {own} of the {base.rank} base parameters that the sessions show together",
            source=f"session {name!r}",
            field="trials",
            remedy="record richer motions in every session, or leave this one out",
        )
    rows = {name: item for name, item in rows.items() if name not in left_out}
    found = [base_statistics(item, base) for item in rows.values()]
    values = np.array([item.estimate for item in found])
    pooled = pool_estimates(values, np.array([item.covariance for item in found]), level)
    problem = next(iter(rows.values())).problem
    spreads = (settings or EstimatorSettings()).spreads(problem.robot)
    return Sessions(
        names=tuple(rows),
        base=base,
        values=values,
        std=np.array([item.std for item in found]),
        pooled=pooled,
        ranges=parameter_ranges(problem, base, pooled, spreads),
        possible=possible_ends(base, problem.parameter_names, problem.n_inertial),
        left_out=left_out,
    )


def _common_base(rows: Mapping[str, Regression]) -> BaseParameters:
    """Base parameters of all sessions together."""
    problem = next(iter(rows.values())).problem
    n, labels = problem.n_params, parameter_labels(problem)
    stacked = np.vstack([item.factor[:, :n] for item in rows.values()])
    return base_parameters(stacked, labels, RANK_TOLERANCE)


def _poorer_sessions(rows: Mapping[str, Regression], base: BaseParameters) -> dict[str, int]:
    """Sessions that do not determine all of the base parameters, with the number that they do."""
    ranks = {
        name: base_parameters(item.factor[:, base.independent], base.labels, RANK_TOLERANCE).rank
        for name, item in rows.items()
    }
    return {name: rank for name, rank in ranks.items() if rank < base.rank}


# Which trials of several logs are of one session.


def split_sessions(logs: Sequence[Log]) -> dict[str, Log]:
    """Logs by session: trials that name one go there, the rest of each log is a session of its own.

    Sessions of the same name in several logs are told apart by the logs' folders.

    Args:
        logs: as they were loaded.

    Returns:
        A log for each session, by its name.

    Raises:
        LogError: the logs hold fewer than two sessions.
    """
    sessions: dict[str, Log] = {}
    named = Counter(key for log in logs for key in {trial.session for trial in log.trials} if key)
    shared = {key for key, count in named.items() if count > 1}
    for number, log in enumerate(logs, start=1):
        own = log.folder.name if log.folder else f"log_{number}"
        keys = [trial.session or own for trial in log.trials]
        for key in dict.fromkeys(keys):
            name = f"{own}/{key}" if key in shared else key
            name = f"{name}_{number}" if name in sessions else name
            chosen = [i for i, other in enumerate(keys) if other == key]
            header = log.header.model_copy(update={"trials": tuple(log.header.trials[i] for i in chosen)})
            sessions[name] = replace(log, header=header, trials=tuple(log.trials[i] for i in chosen))
    if len(sessions) < 2:
        raise LogError(
            "holds one session",
            source=logs[0].folder if logs else None,
            field="trials",
            remedy="name sessions in log.yaml, or give several logs",
        )
    return sessions
