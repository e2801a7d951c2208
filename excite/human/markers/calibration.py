"""A subject's own joint centres and marker places, from all that markers do together.

Postures of some frames, the sixteen dimensions and all marker places are found at once: the sum of squares of
marker distances over these frames plus how far dimensions and bony landmarks lie from first guesses. Postures
drop out frame by frame (Schur complement), so that the work grows with the number of frames only linearly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError
from excite.human.dimensions import DIMENSIONS, Dimensions, joint_offsets, stature_dimensions
from excite.human.markers.first_poses import first_poses
from excite.human.markers.inverse_kinematics import MarkerModel, Solution, solve_poses
from excite.human.markers.landmarks import landmark_place
from excite.human.markers.marker_set import MarkerSite
from excite.human.posture.skeleton import (
    N_SEGMENTS,
    N_VELOCITY,
    Pose,
    place_segments,
    point_jacobian,
)
from excite.human.segments import NAMES, PARENTS
from excite.human.subject import Subject

_MARKER_SIGMA = 0.01
# Skin slides with the posture, not at random: however many frames there are, they say as much as these.
_INDEPENDENT_FRAMES = 8.0
_LANDMARK_SIGMA = 0.02
_FREE_SIGMA = 0.5
_POSTURE_SIGMA = 2.0
_ROUNDS = 12
_CONVERGED = 1e-4
_FRAMES = 60
_FEWEST_MARKERS = 3
# Cost of a frame, in usual ones, beyond which a limb is taken to be folded: before and after it is adjusted.
_BAD_FRAME, _FOLDED = 2.5, 5.0


@dataclass(frozen=True, eq=False)
class Calibration:
    """What calibration found.

    Attributes:
        model: markers on the subject's body.
        dimensions: with standard deviations.
        rms: of marker distances in the frames used [m].
        frames: how many frames were used.
    """

    model: MarkerModel
    dimensions: Dimensions
    rms: float
    frames: int


def calibrate_body(
    subject: Subject, sites: Mapping[str, MarkerSite], recordings: Sequence[Mapping[str, Array]]
) -> Calibration:
    """Calibrate a body from recordings of its markers.

    Args:
        subject: mass, height and sex.
        sites: where markers sit, by label.
        recordings: positions by label ``(n, 3)`` [m], world with z up, NaN where missing. The first should begin
            (or stand) upright; not all markers need be in all of them.

    Raises:
        InputError: too few markers with landmarks, or no frame that shows pelvis and torso.
    """
    labels = tuple(label for label in sites if any(label in recording for recording in recordings))
    marked = [label for label in labels if sites[label].landmark is not None]
    for trunk in ("pelvis", "torso"):
        if sum(sites[label].segment == trunk for label in marked) < _FEWEST_MARKERS:
            raise InputError(
                f"fewer than {_FEWEST_MARKERS} markers on landmarks of the {trunk}",
                field="markers",
                remedy="map labels to landmarks with --markers",
            )
    dimensions = stature_dimensions(subject)
    segment = np.array([NAMES.index(sites[label].segment) for label in labels])
    guess = np.array(
        [
            np.full(3, np.nan)
            if sites[label].landmark is None
            else landmark_place(sites[label].landmark or "", subject, dimensions)
            for label in labels
        ]
    )
    points = np.concatenate([_choose_frames(recording, labels) for recording in recordings])
    usable = _trunk_seen(points, segment, guess)
    points = points[usable]
    if not len(points):
        raise InputError(
            "no frame shows three markers each of pelvis and torso",
            field="markers",
            remedy="record a standing trial, or fill the gaps",
        )
    offsets = joint_offsets() @ dimensions.values
    model = MarkerModel(labels, segment, guess, offsets)
    solution = first_poses(model, points)
    model = _with_free_markers(model, points, solution)
    # Landmarks alone can leave a limb folded the wrong way; with all markers postures are found afresh.
    solution = first_poses(model, points)
    model = _with_free_markers(
        replace(model, local=np.where(np.isfinite(guess), guess, np.nan)), points, solution
    )
    sound = _sound_frames(solution, _BAD_FRAME)
    points, solution = points[sound], replace(solution, pose=solution.pose[sound])
    sigma = np.where(np.isfinite(guess).all(axis=1), _LANDMARK_SIGMA, _FREE_SIGMA)
    return _adjust_jointly(model, dimensions, points, solution.pose, sigma)


def _choose_frames(recording: Mapping[str, Array], labels: tuple[str, ...]) -> Array:
    """Some frames spread over a recording, ``(k, m, 3)``."""
    n = len(next(iter(recording.values())))
    frames = np.unique(np.linspace(0, n - 1, min(n, _FRAMES)).astype(int))
    nothing = np.full((len(frames), 3), np.nan)
    return np.stack([recording[label][frames] if label in recording else nothing for label in labels], axis=1)


def _trunk_seen(points: Array, segment: NDArray[np.int64], guess: Array) -> NDArray[np.bool_]:
    seen = np.asarray(np.isfinite(points).all(axis=2) & np.isfinite(guess).all(axis=1))
    pelvis, torso = (seen[:, segment == NAMES.index(trunk)].sum(axis=1) for trunk in ("pelvis", "torso"))
    return np.asarray((pelvis >= _FEWEST_MARKERS) & (torso >= _FEWEST_MARKERS))


def _with_free_markers(model: MarkerModel, points: Array, solution: Solution) -> MarkerModel:
    """Places of markers without landmark: their median in their segments' frames."""
    placed = place_segments(solution.pose, model.offsets)
    local = model.local.copy()
    for m in np.flatnonzero(~np.isfinite(local).all(axis=1)):
        k = model.segment[m]
        inside = np.einsum("nji,nj->ni", placed.rotation[:, k], points[:, m] - placed.origin[:, k])
        shown = np.isfinite(inside).all(axis=1)
        local[m] = np.median(inside[shown], axis=0) if shown.any() else 0.0
    return replace(model, local=local)


def _sound_frames(solution: Solution, most: float) -> NDArray[np.bool_]:
    """Frames without a limb that was found the wrong way, which would pull the joints: cost near the usual one."""
    return np.asarray(solution.cost <= most * np.median(solution.cost))


def _adjust_jointly(
    model: MarkerModel, dimensions: Dimensions, points: Array, pose: Pose, sigma: Array
) -> Calibration:
    """Gauss-Newton on postures, dimensions and places together."""
    basis = joint_offsets()
    first_values, first_local = dimensions.values, model.local
    values, local = first_values.copy(), first_local.copy()
    n_shared = len(DIMENSIONS) + 3 * len(model.labels)
    precision = np.concatenate([dimensions.spread**-2.0, np.repeat(sigma**-2.0, 3)])
    covariance = np.diag(1.0 / precision)
    last = np.inf
    for _ in range(_ROUNDS):
        model = replace(model, local=local, offsets=basis @ values)
        solution = solve_poses(model, points, pose, steps=6)
        pose, sound = solution.pose, np.flatnonzero(_sound_frames(solution, _FOLDED))
        share = min(1.0, _INDEPENDENT_FRAMES / len(sound))
        normal = np.diag(precision)
        right = precision * np.concatenate([first_values - values, (first_local - local).ravel()])
        total = float(right @ (right / precision))
        for start in range(0, len(sound), 64):
            block = sound[start : start + 64]
            h, g, cost = _shared_equations(model, points[block], pose[block], basis)
            normal, right, total = normal + share * h, right + share * g, total + share * cost
        covariance = np.linalg.inv(normal)
        step = covariance @ right
        values = values + step[: len(values)]
        local = local + step[len(values) :].reshape(-1, 3)
        if abs(last - total) < _CONVERGED * total:
            break
        last = total
    model = replace(model, local=local, offsets=basis @ values)
    solution = solve_poses(model, points, pose, steps=10)
    spread = np.sqrt(np.diag(covariance))[: len(values)]
    changed = replace(dimensions, values=values, spread=spread)
    sound = np.flatnonzero(_sound_frames(solution, _FOLDED))
    rms = float(np.sqrt(np.nanmean(solution.residual[sound] ** 2)))
    if n_shared > np.isfinite(points).sum():
        raise InputError("has too few markers and frames to calibrate a body", field="markers")
    return Calibration(model, changed, rms, len(sound))


class _Normal(NamedTuple):
    """Normal equations of dimensions and places with the postures eliminated: matrix, right-hand side, cost."""

    matrix: Array
    right: Array
    cost: float


def _shared_equations(model: MarkerModel, points: Array, pose: Pose, basis: Array) -> _Normal:
    placed = place_segments(pose, model.offsets)
    predicted = placed.points(model.segment, model.local)
    seen = np.asarray(np.isfinite(points).all(axis=2))
    error = np.where(seen[:, :, None], points - predicted, 0.0)
    distance = np.linalg.norm(error, axis=2)
    scale = seen / (1.0 + (distance / 0.03) ** 2) / _MARKER_SIGMA
    n, m = seen.shape
    own = point_jacobian(placed, predicted, model.segment) * scale[:, :, None, None]
    shared = np.zeros((n, m, 3, basis.shape[2] + 3 * m))
    for k in range(1, N_SEGMENTS):
        moved = placed.rotation[:, PARENTS[k]] @ basis[k]
        carried = [i for i in range(m) if _joint_carries(k, int(model.segment[i]))]
        shared[..., : basis.shape[2]][:, carried] += moved[:, None]
    for i in range(m):
        start = basis.shape[2] + 3 * i
        shared[:, i, :, start : start + 3] = placed.rotation[:, model.segment[i]]
    shared *= scale[:, :, None, None]
    own, shared = own.reshape(n, 3 * m, -1), shared.reshape(n, 3 * m, -1)
    right = (error * scale[:, :, None]).reshape(n, 3 * m)
    normal = own.transpose(0, 2, 1) @ own
    normal[:, np.arange(N_VELOCITY), np.arange(N_VELOCITY)] += _POSTURE_SIGMA**-2.0
    mixed = own.transpose(0, 2, 1) @ shared
    eliminated = np.linalg.solve(normal, mixed)
    flat = shared.reshape(-1, shared.shape[2])
    h = flat.T @ flat - np.tensordot(mixed, eliminated, ((0, 1), (0, 1)))
    g = flat.T @ right.ravel() - np.einsum("nji,nj->i", eliminated, np.einsum("nij,ni->nj", own, right))
    return _Normal(h, g, float((right**2).sum()))


def _joint_carries(joint: int, segment: int) -> bool:
    while segment > 0:
        if segment == joint:
            return True
        segment = PARENTS[segment]
    return False
