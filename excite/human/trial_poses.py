"""A body calibrated from its markers, and its postures in a whole trial: gaps bridged, labels put back, filtered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from excite.arrays import Array, Flags, Indices, runs_of
from excite.errors import InputError, LogError
from excite.finding import Finding, list_names
from excite.human.body import DIMENSIONS, Dimensions, joint_offsets, stature_dimensions
from excite.human.markers.inverse_kinematics import (
    FEWEST_MARKERS,
    MarkerModel,
    Solution,
    first_poses,
    solve_poses,
)
from excite.human.markers.marker_set import MarkerSite, landmark_place
from excite.human.recording import Recording
from excite.human.segments import (
    DESCENDANTS,
    N_SEGMENTS,
    N_VELOCITY,
    NAMES,
    PARENTS,
    Pose,
    Subject,
    place_segments,
    point_jacobian,
)
from excite.logs.signals.butterworth import lowpass, settling_samples

# A subject's own joint centres and marker places, from all that markers do together.
#
# Postures of some frames, the sixteen dimensions and all marker places are found at once: the sum of squares
# of marker distances over these frames plus how far dimensions and bony landmarks lie from first guesses.
# Postures drop out frame by frame (Schur complement), so that the work grows with the number of frames only
# linearly.

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
        if sum(sites[label].segment == trunk for label in marked) < FEWEST_MARKERS:
            raise InputError(
                f"fewer than {FEWEST_MARKERS} markers on landmarks of the {trunk}",
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
    # How far first guesses are off: of a bony landmark, and of a marker on none [m].
    sigma = np.where(np.isfinite(guess).all(axis=1), 0.02, 0.5)
    return _adjust_jointly(model, dimensions, points, solution.pose, sigma)


def _choose_frames(recording: Mapping[str, Array], labels: tuple[str, ...]) -> Array:
    """Some frames spread over a recording, ``(k, m, 3)``."""
    n = len(next(iter(recording.values())))
    frames = np.unique(np.linspace(0, n - 1, min(n, 60)).astype(int))
    nothing = np.full((len(frames), 3), np.nan)
    return np.stack([recording[label][frames] if label in recording else nothing for label in labels], axis=1)


def _trunk_seen(points: Array, segment: Indices, guess: Array) -> Flags:
    seen = np.asarray(np.isfinite(points).all(axis=2) & np.isfinite(guess).all(axis=1))
    pelvis, torso = (seen[:, segment == NAMES.index(trunk)].sum(axis=1) for trunk in ("pelvis", "torso"))
    return np.asarray((pelvis >= FEWEST_MARKERS) & (torso >= FEWEST_MARKERS))


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


def _sound_frames(solution: Solution, most: float) -> Flags:
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
    for _ in range(12):
        model = replace(model, local=local, offsets=basis @ values)
        solution = solve_poses(model, points, pose, steps=6)
        pose, sound = solution.pose, np.flatnonzero(_sound_frames(solution, _FOLDED))
        # Skin slides with the posture, not at random: however many frames there are, they say as much as these.
        share = min(1.0, 8.0 / len(sound))
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
        if abs(last - total) < 1e-4 * total:
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
    predicted = placed.locate_points(model.segment, model.local)
    seen = np.asarray(np.isfinite(points).all(axis=2))
    error = np.where(seen[:, :, None], points - predicted, 0.0)
    distance = np.linalg.norm(error, axis=2)
    # Markers are seen to a centimetre; what lies farther than three off counts less.
    scale = seen / (1.0 + (distance / 0.03) ** 2) / 0.01
    n, m = seen.shape
    own = point_jacobian(placed, predicted, model.segment) * scale[:, :, None, None]
    shared = np.zeros((n, m, 3, basis.shape[2] + 3 * m))
    for k in range(1, N_SEGMENTS):
        moved = placed.rotation[:, PARENTS[k]] @ basis[k]
        carried = np.flatnonzero(np.isin(model.segment, DESCENDANTS[k]))
        shared[..., : basis.shape[2]][:, carried] += moved[:, None]
    for i in range(m):
        start = basis.shape[2] + 3 * i
        shared[:, i, :, start : start + 3] = placed.rotation[:, model.segment[i]]
    shared *= scale[:, :, None, None]
    own, shared = own.reshape(n, 3 * m, -1), shared.reshape(n, 3 * m, -1)
    right = (error * scale[:, :, None]).reshape(n, 3 * m)
    normal = own.transpose(0, 2, 1) @ own
    # Postures stay within some 2 rad of where they were.
    normal[:, np.arange(N_VELOCITY), np.arange(N_VELOCITY)] += 0.25
    mixed = own.transpose(0, 2, 1) @ shared
    eliminated = np.linalg.solve(normal, mixed)
    flat = shared.reshape(-1, shared.shape[2])
    h = flat.T @ flat - np.tensordot(mixed, eliminated, ((0, 1), (0, 1)))
    g = flat.T @ right.ravel() - np.einsum("nji,nj->i", eliminated, np.einsum("nij,ni->nj", own, right))
    return _Normal(h, g, float((right**2).sum()))


_REPAIRS, _FAR_MARKERS = 4, 2


@dataclass(frozen=True, eq=False)
class TrialPoses:
    """Postures of a trial and how well they fit.

    Attributes:
        time: ``(n,)`` [s].
        pose: postures.
        residual: distance of each marker from its predicted place ``(n, m)`` [m], NaN where it is missing.
        labels: the ``m`` labels.
        findings: what was odd.
    """

    time: Array
    pose: Pose
    residual: Array
    labels: tuple[str, ...]
    findings: tuple[Finding, ...]

    @property
    def marker_rms(self) -> Mapping[str, float]:
        """RMS distance by marker [m]; markers that were never seen are left out."""
        seen = np.asarray(np.isfinite(self.residual).any(axis=0))
        return {
            label: float(np.sqrt(np.nanmean(self.residual[:, i] ** 2)))
            for i, label in enumerate(self.labels)
            if seen[i]
        }


def trial_poses(calibration: Calibration, recording: Recording, cutoff_hz: float | None = 6.0) -> TrialPoses:
    """Postures of every frame.

    Marker positions are low-pass filtered (third order, forwards and backwards) as in Jovic et al., T-RO 2016,
    section VI, after short gaps have been bridged and exchanged labels put back.

    Args:
        recording: markers in a world with z up.
        cutoff_hz: None leaves the markers as they are.

    Raises:
        LogError: pelvis or torso are never seen, or the trial is too short to filter.
    """
    model = calibration.model
    nothing = np.full((len(recording.time), 3), np.nan)
    points = np.stack([recording.markers.get(label, nothing) for label in model.labels], axis=1)
    if not np.isfinite(points).all(axis=2).any():
        raise LogError("shows no marker of the body", source=recording.source)
    # Postures of every few frames from scratch, then all frames from these, then bad ones from good neighbours.
    frames = np.unique(np.append(np.arange(0, len(points), 4), len(points) - 1))
    few = _repair_frames(model, points[frames], first_poses(model, points[frames]))
    start = interpolate_poses(frames.astype(float), few.pose, np.arange(len(points)).astype(float))
    rough = _repair_frames(model, points, solve_poses(model, points, start, steps=6))
    swapped: Counter[tuple[str, str]] = Counter()
    for _ in range(_REPAIRS):
        points, found = restore_labels(model, points, rough)
        swapped.update(found)
        if not found:
            break
        rough = _repair_frames(model, points, solve_poses(model, points, rough.pose, steps=8))
    predicted = model.predict_markers(rough.pose)
    findings = label_findings(swapped, points, predicted, model.labels, recording)
    if cutoff_hz is not None:
        points = _filter_markers(points, predicted, recording, cutoff_hz)
    prior, weight, lost = _prior_pose(model, points, rough.pose, recording.time)
    solution = solve_poses(model, points, rough.pose, steps=10, prior=prior, prior_weight=weight)
    return TrialPoses(recording.time, solution.pose, solution.residual, model.labels, (*findings, *lost))


def _repair_frames(model: MarkerModel, points: Array, solution: Solution) -> Solution:
    """Solve frames with far markers again from postures between good frames; the better answer stays.

    A limb can be found folded the wrong way where it is solved on its own; its neighbours in time know better.
    """
    pose, cost, residual = solution.pose, solution.cost, solution.residual
    for _ in range(_REPAIRS):
        far = (np.nan_to_num(residual) > FAR).sum(axis=1) >= _FAR_MARKERS
        good, bad = np.flatnonzero(~far), np.flatnonzero(far)
        if not len(bad) or not len(good):
            break
        start = interpolate_poses(good.astype(float), pose[good], bad.astype(float))
        rough = solve_poses(model, points[bad], start, steps=15, robust=False)
        again = solve_poses(model, points[bad], rough.pose, steps=10)
        better = bad[again.cost < cost[bad] * 0.999]
        chosen = again.cost < cost[bad] * 0.999
        if not len(better):
            break
        pose.position[better], pose.rotation[better] = (
            again.pose.position[chosen],
            again.pose.rotation[chosen],
        )
        cost[better], residual[better] = again.cost[chosen], again.residual[chosen]
    return Solution(pose, residual, cost)


def _filter_markers(points: Array, predicted: Array, recording: Recording, cutoff_hz: float) -> Array:
    """Low-pass each marker; gaps are bridged by the body's motion while it is filtered, and stay if long."""
    rate = recording.rate_hz
    if len(points) <= settling_samples(rate, cutoff_hz):
        raise LogError(
            f"{len(points)} frames are too few for a {cutoff_hz:g} Hz filter at {rate:g} Hz",
            source=recording.source,
            remedy="record longer, or give a higher --cutoff",
        )
    filled = points.copy()
    shown = np.asarray(np.isfinite(points).all(axis=2))
    frames = np.arange(len(points))
    for m in np.flatnonzero(shown.any(axis=0) & ~shown.all(axis=0)):
        missing = ~shown[:, m]
        offset = points[shown[:, m], m] - predicted[shown[:, m], m]
        bridge = np.column_stack([np.interp(frames, frames[shown[:, m]], offset[:, i]) for i in range(3)])
        filled[missing, m] = predicted[missing, m] + bridge[missing]
    some = shown.any(axis=0)
    filled[:, some] = lowpass(filled[:, some], rate, cutoff_hz, 3)
    for m in np.flatnonzero(some):
        for start, stop in runs_of(~shown[:, m]):
            if stop - start > round(0.2 * rate):
                filled[start:stop, m] = np.nan
    filled[:, ~some] = np.nan
    return filled


class _Prior(NamedTuple):
    """A posture to stay near, with what weight, and the segments that were lost."""

    pose: Pose
    weight: Array
    lost: list[Finding]


def _prior_pose(model: MarkerModel, points: Array, pose: Pose, time: Array) -> _Prior:
    """Where markers of a joint's whole outer limb are lost for a while, its posture is interpolated and held."""
    shown = np.asarray(np.isfinite(points).all(axis=2))
    usual = shown.any(axis=0)
    weight = np.full((len(points), N_SEGMENTS), 0.5)
    rotation = pose.rotation.copy()
    standing = np.tile(np.eye(3), (len(points), N_SEGMENTS, 1, 1))
    lost: list[Finding] = []
    for k in range(1, N_SEGMENTS):
        outer = np.isin(model.segment, DESCENDANTS[k]) & usual
        own = (model.segment == k) & usual
        if not outer.any():
            continue
        enough = shown[:, own].sum(axis=1) >= min(2, own.sum()) if own.any() else shown[:, outer].any(axis=1)
        if enough.all() or not enough.any():
            continue
        good = np.flatnonzero(enough)
        if len(good) > 1:
            slerp = Slerp(good.astype(float), Rotation.from_matrix(rotation[good, k]))
            places = np.clip(np.flatnonzero(~enough), good[0], good[-1]).astype(float)
            standing[~enough, k] = slerp(places).as_matrix()
            # Held forty times as firmly as where its markers say what it does.
            weight[~enough, k] = 20.0
        seconds = float((~enough).sum() * np.median(np.diff(time)))
        text = f"{NAMES[k]}: too few of its markers for {seconds:.2f} s; its posture is interpolated there"
        lost.append(Finding("lost_segment", text, {"seconds": seconds}, (NAMES[k],)))
    return _Prior(Pose(pose.position, standing), weight, lost)


def interpolate_poses(at: Array, pose: Pose, wanted: Array) -> Pose:
    """Postures between postures: positions linearly, rotations on the shortest arc.

    Args:
        at: ``(k,)`` rising places of ``pose``.
        pose: ``k`` postures.
        wanted: ``(n,)`` places; outside ``at`` the outermost posture holds.
    """
    wanted = np.clip(wanted, at[0], at[-1])
    if len(at) == 1:
        index = np.zeros(len(wanted), dtype=int)
        return Pose(pose.position[index], pose.rotation[index])
    position = np.column_stack([np.interp(wanted, at, pose.position[:, i]) for i in range(3)])
    rotation = np.stack(
        [Slerp(at, Rotation.from_matrix(pose.rotation[:, k]))(wanted).as_matrix() for k in range(N_SEGMENTS)],
        axis=1,
    )
    return Pose(position, rotation)


# Markers that carry each other's label for a while.

FAR = 0.05
"""A pair of labels is exchanged only where both lie this far from where they belong [m]."""


def restore_labels(
    model: MarkerModel, points: Array, solution: Solution
) -> tuple[Array, dict[tuple[str, str], int]]:
    """Exchange labels back in frames in which each of two markers lies where the other belongs.

    Where they belong is said by the posture of the frame itself, and by postures between frames that fit: markers
    that are exchanged for a while pull their own frames' postures over.
    """
    points = points.copy()
    far = (np.nan_to_num(solution.residual) > FAR).any(axis=1)
    good, bad = np.flatnonzero(~far), np.flatnonzero(far)
    if not len(good) or not len(bad):
        return points, {}
    between = interpolate_poses(good.astype(float), solution.pose[good], bad.astype(float))
    swapped: dict[tuple[str, str], int] = {}
    for predicted in (model.predict_markers(solution.pose[bad]), model.predict_markers(between)):
        shown = points[bad]
        distance = np.linalg.norm(shown - predicted, axis=2)
        suspects = np.flatnonzero((np.nan_to_num(distance) > FAR).any(axis=0))
        for place, a in enumerate(suspects):
            for b in suspects[place + 1 :]:
                own = distance[:, a] + distance[:, b]
                other = np.linalg.norm(shown[:, a] - predicted[:, b], axis=1) + np.linalg.norm(
                    shown[:, b] - predicted[:, a], axis=1
                )
                chosen = (distance[:, a] > FAR) & (distance[:, b] > FAR) & (other < 0.5 * own)
                if chosen.any():
                    frames = bad[chosen]
                    points[np.ix_(frames, [a, b])] = points[np.ix_(frames, [b, a])]
                    shown = points[bad]
                    distance = np.linalg.norm(shown - predicted, axis=2)
                    pair = (model.labels[a], model.labels[b])
                    swapped[pair] = swapped.get(pair, 0) + int(chosen.sum())
    return points, swapped


def label_findings(
    swapped: Mapping[tuple[str, str], int],
    points: Array,
    predicted: Array,
    labels: tuple[str, ...],
    recording: Recording,
) -> list[Finding]:
    """What is said of labels that were put back, and of markers that lie far from where the body has them.

    Args:
        swapped: frames in which the labels of a pair were exchanged.
        points: ``(n, m, 3)`` as recorded, labels put back [m].
        predicted: ``(n, m, 3)`` where the body has the markers [m].
    """
    findings = [
        Finding(
            "swapped_markers",
            f"{recording.source.name}: {a} and {b} carry each other's label in {count} frames; put back",
            {"frames": float(count)},
            (a, b),
        )
        for (a, b), count in swapped.items()
    ]
    distance = np.nan_to_num(np.linalg.norm(points - predicted, axis=2))
    stray = tuple(label for i, label in enumerate(labels) if (distance[:, i] > 2 * FAR).any())
    if stray:
        share = float((distance > 2 * FAR).any(axis=1).mean())
        text = (
            f"{recording.source.name}: {list_names(stray)} lie more than 10 cm off in some frames; "
            "they count less there"
        )
        findings.append(Finding("stray_markers", text, {"share_of_frames": share}, stray))
    return findings
