"""Added weights on segments: candidates, their likelihood, and a worn weight (Jovic et al., T-RO 2016, table IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.people.segment_table import SegmentTable
from excite.arrays import Array
from excite.errors import LogError
from excite.human.segments import NAMES
from excite.identification.inertia import COLUMNS, ROWS
from excite.identification.problem import IdentificationProblem, build_problem
from excite.identification.regression import condense_problem, iterate_weights, prior_std
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.results import HIDDEN, Name, Stated, Unbounded, UnboundedPositive, named, stated
from excite.robot.robot import Robot
from excite.rows.kinematics import filtered_rows, trial_kinematics
from excite.rows.settings import ProblemSettings
from excite.threads import one_blas_thread

# A weight on each segment as a hypothesis: the best fit, and how likely it makes the data.

BELT_RADIUS = 0.06
"""A belt is worn around a segment: its mass lies at this radius of gyration about its own centre [m]."""
_MARGIN = 0.03


Place = tuple[float, float, float]


@dataclass(frozen=True)
class Candidate(Stated):
    """A weight on one segment.

    Attributes:
        segment: segment that carries it.
        mass: [kg].
        std: of the mass [kg].
        place: of its centre in the joint frame of the segment [m].
        cost: squared residual that it leaves, in units of the noise.
        evidence: logarithm of the probability of the data with a weight on this segment, up to a constant: the
            fit, less what a place at the segment's edge and parameters that have to be just so take away.
    """

    segment: Name
    mass: float = field(metadata=named("mass_kg"))
    std: UnboundedPositive = field(metadata=named("std_kg"))
    place: Place = field(metadata=HIDDEN)
    cost: Unbounded
    evidence: Unbounded


@dataclass(frozen=True)
class AddedMass(Stated):
    """The likeliest weight and the other segments' best.

    Attributes:
        candidates: one for each segment, likeliest first.
        nothing: squared residual without any weight.
    """

    candidates: tuple[Candidate, ...]
    nothing: float = field(metadata=HIDDEN)

    @property
    def best(self) -> Candidate:
        """The likeliest."""
        return self.candidates[0]

    @property
    @stated
    def segment(self) -> Name:
        """Segment that carries it."""
        return self.best.segment

    @property
    @stated
    def mass_kg(self) -> float:
        """Its mass [kg]."""
        return self.best.mass

    @property
    @stated
    def std_kg(self) -> UnboundedPositive:
        """Standard deviation of the mass [kg]."""
        return self.best.std

    @property
    @stated
    def place_m(self) -> Place:
        """Its centre in the joint frame of the segment [m]."""
        return self.best.place

    @property
    @stated
    def tied_segments(self) -> tuple[Name, ...]:
        """Segments that the data do not tell from the likeliest one, which comes first."""
        # Twenty times as likely, in the natural logarithm.
        return tuple(c.segment for c in self.candidates if self.best.evidence - c.evidence < 3.0)

    def summary(self) -> str:
        """One line."""
        best, second = self.best, self.candidates[1]
        others = ", ".join(self.tied_segments[1:])
        doubt = (
            f"or {others}, which look alike" if others else f"next: {second.segment}, {second.mass:.2f} kg"
        )
        return f"weight worn: {best.mass:.2f} ± {best.std:.2f} kg on {best.segment} ({doubt})"


@dataclass(frozen=True)
class WornSegment(Stated):
    """A segment's mass without the weight and with it.

    Attributes:
        segment: name of the segment.
        without_kg: identified from the trials without the weight [kg].
        wearing_kg: identified from those with it [kg].
    """

    segment: Name
    without_kg: float
    wearing_kg: float


@dataclass(frozen=True, eq=False)
class WornWeight(Stated):
    """Segments identified from the trials with a weight (table IV of Jovic et al., T-RO 2016).

    Attributes:
        located: where it was found, and how heavy.
        without: masses from the trials without it.
        wearing: masses from the trials with it.
    """

    located: AddedMass = field(metadata=HIDDEN)
    without: SegmentTable = field(metadata=HIDDEN)
    wearing: SegmentTable = field(metadata=HIDDEN)

    @property
    @stated
    def segment(self) -> Name:
        """Segment that carries the weight."""
        return self.located.segment

    @property
    @stated
    def mass_by_segments_kg(self) -> float:
        """How much heavier that segment was identified [kg], the last row of the paper's table."""
        row = self.segments[NAMES.index(self.segment)]
        return row.wearing_kg - row.without_kg

    @property
    @stated
    def segments(self) -> tuple[WornSegment, ...]:
        """Masses of all segments."""
        pairs = zip(self.without.rows, self.wearing.rows, strict=True)
        return tuple(WornSegment(a.segment, a.identified, b.identified) for a, b in pairs)

    def summary(self) -> str:
        """The table in words, for a terminal."""
        lines = ["segment masses [kg], identified:", f"  {'':16}{'without':>10}{'wearing':>10}{'more':>8}"]
        lines += [
            f"  {row.segment:16}{row.without_kg:10.2f}{row.wearing_kg:10.2f}{row.wearing_kg - row.without_kg:+8.2f}"
            for row in self.segments
        ]
        lines.append(f"weight by the masses of {self.segment}: {self.mass_by_segments_kg:.2f} kg")
        return "\n".join(lines)


def best_fit(columns: Array, target: Array, box: Array, body_mass: float) -> Any:
    """Mass and place on a segment that explain the most."""
    lower, upper = box[0] - _MARGIN, box[1] + _MARGIN

    def residual(x: Array) -> Array:
        mass, place = x[0], x[1:]
        inertia = mass * ((place @ place + BELT_RADIUS**2) * np.eye(3) - np.outer(place, place))
        return np.asarray(columns @ np.concatenate([[mass], mass * place, inertia[ROWS, COLUMNS]]) - target)

    fits = [
        least_squares(
            residual,
            np.concatenate([[1.0], start]),
            bounds=(np.concatenate([[0.0], lower]), np.concatenate([[0.5 * body_mass], upper])),
            x_scale=np.array([1.0, 0.1, 0.1, 0.1]),
        )
        for start in (0.5 * (lower + upper), np.clip(np.zeros(3), lower + 1e-6, upper - 1e-6))
    ]
    return min(fits, key=lambda fit: fit.cost)


def weight_candidate(link: str, fit: Any, box: Array, noise: float) -> Candidate:
    """A fit as a candidate; its evidence by Laplace's approximation.

    A weight is worn about the middle of a segment: its place is normal about the box's centre with half the box's
    size as deviation. Masses are as likely as each other.
    """
    half = 0.5 * (box[1] - box[0])
    curvature = fit.jac.T @ fit.jac / noise
    off = (fit.x[1:] - box.mean(axis=0)) / half
    total = curvature + np.diag(np.append(0.01, half**-2.0))
    volume = np.linalg.slogdet(total)[1] + 2.0 * float(np.log(half).sum())
    evidence = -0.5 * (2.0 * fit.cost / noise + float(off @ off) + float(volume))
    std = float(np.sqrt(np.linalg.pinv(curvature)[0, 0]))
    x, y, z = (float(value) for value in fit.x[1:])
    return Candidate(link, float(fit.x[0]), std, (x, y, z), 2.0 * float(fit.cost), evidence)


# Where a weight is worn, and how heavy it is, from trials without and with it.
#
# The trials without say what the body is like, as far as its motions show it and the tables elsewhere; the
# trials with it are then explained by that body and one more mass on one segment. The body's parameters are
# eliminated, so that whatever is as wrong with the one as with the other - skin, joints, filters - does not
# look like a weight.

# Plates' zeros wander from trial to trial by about this much, in force [N] and moment [N·m].
_ZERO = np.repeat([3.0, 1.0], 3)


@one_blas_thread
def locate_added_mass(
    robot: Robot,
    without: Log,
    loaded: Log,
    boxes: Array,
    *,
    settings: ProblemSettings | None = None,
    segments: Sequence[str] = NAMES,
) -> AddedMass:
    """Find the weight that makes two logs of one person agree.

    Args:
        robot: the person's model, calibrated.
        without: trials without the weight.
        loaded: trials with it, the same motions for the best result.
        boxes: where the weight's centre may lie on each of the robot's segments, joint frames
            ``(n_segments, 2, 3)`` [m].
        settings: filters.
        segments: links that may carry it.

    Raises:
        LogError: a log leaves no rows, or no segment may carry the weight.
    """
    first = build_problem(robot, without, settings, role=None)
    second = build_problem(robot, loaded, settings, role=None)
    std = np.asarray(iterate_weights(condense_problem(first)).std)
    rows_without, rows_loaded = (
        _condense_rows(problem, std, _plate_zeros(robot, log, settings))
        for problem, log in ((first, without), (second, loaded))
    )
    projected, target = _eliminate_body(first, rows_without, rows_loaded)
    links = [segment.link for segment in robot.segments]
    carriers = [k for k, link in enumerate(links) if link in segments]
    if not carriers:
        raise LogError("no segment may carry the weight", field="segments")
    fits = {k: best_fit(projected[:, 10 * k : 10 * k + 10], target, boxes[k], robot.mass) for k in carriers}
    degrees = max(len(target) - 4, 1)
    noise = max(1.0, min(2.0 * fit.cost for fit in fits.values()) / degrees)
    found = [weight_candidate(links[k], fit, boxes[k], noise) for k, fit in fits.items()]
    ranked = tuple(sorted(found, key=lambda item: -item.evidence))
    return AddedMass(ranked, float(target @ target))


def _condense_rows(problem: IdentificationProblem, std: Array, zeros: Array) -> Array:
    """Triangular factor of weighted rows: body's columns, measurement, the plates' zeros eliminated."""
    rows = np.column_stack([zeros, problem.Y, problem.y]) / std[problem.channel, None]
    n = zeros.shape[1]
    known = np.hstack([np.eye(n), np.zeros((n, rows.shape[1] - n))])
    r = np.asarray(np.linalg.qr(np.vstack([known, rows]), mode="r"))
    return r[n:, n:]


def _plate_zeros(robot: Robot, log: Log, settings: ProblemSettings | None) -> Array:
    """What wrong zeros of the plates add to each row, six columns a trial, in units of their usual size.

    All plates stand still in one world, so their zeros together are one constant wrench.
    """
    settings = settings or ProblemSettings()
    filters = settings.filters(floating=True, lowpass_hz=log.header.lowpass_hz)
    inside = robot_in_log(robot, log.header, log.folder)
    place = np.asarray(inside.sensors[0].placement.translation)
    blocks = []
    for trial in log.trials:
        k = trial_kinematics(inside, log.header, trial, settings, filters)
        columns = _constant_wrench(k.q[:, :7], place) * _ZERO
        use = np.repeat(k.valid[:, None], 6, axis=1)
        rows = filtered_rows(columns.__getitem__, k, filters, use)
        blocks.append(rows.values[rows.use])
    return np.asarray(block_diag(*blocks))


def _constant_wrench(base: Array, place: Array) -> Array:
    """Each component of a wrench at a place in the world, about the base in its axes, ``(n, 6, 6)``."""
    turn = Rotation.from_quat(base[:, 3:]).as_matrix().transpose(0, 2, 1)
    x, y, z = (place - base[:, :3]).T
    lever = np.zeros((len(base), 3, 3))
    lever[:, 0, 1], lever[:, 0, 2], lever[:, 1, 2] = -z, y, -x
    lever -= lever.transpose(0, 2, 1)
    columns = np.zeros((len(base), 6, 6))
    columns[:, :3, :3] = columns[:, 3:, 3:] = turn
    columns[:, 3:, :3] = turn @ lever
    return columns


def _eliminate_body(problem: IdentificationProblem, without: Array, loaded: Array) -> tuple[Array, Array]:
    """Rows of the loaded trials with the body's parameters eliminated: columns and target."""
    # Share of the nominal parameters that the body may differ by.
    scale = prior_std(problem, 0.3)
    for k in problem.unmeasured:
        scale[10 * k : 10 * k + 10] = 1e-9
    n = problem.n_params
    body = np.vstack([np.eye(n), without[:, :n] * scale, loaded[:, :n] * scale])
    measured = np.concatenate(
        [
            np.zeros(n),
            without[:, n] - without[:, :n] @ problem.prior,
            loaded[:, n] - loaded[:, :n] @ problem.prior,
        ]
    )
    extra = np.vstack([np.zeros((n + len(without), n)), loaded[:, :n]])
    q, _ = np.linalg.qr(body, mode="complete")
    rest = q[:, n:]
    return rest.T @ extra, rest.T @ measured
