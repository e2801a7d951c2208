"""Postures of a whole trial: gaps bridged, exchanged labels put back, filtered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from excite.arrays import Array, runs_of
from excite.errors import LogError
from excite.finding import Finding, list_names
from excite.human.markers.inverse_kinematics import MarkerModel, Solution, first_poses, solve_poses
from excite.human.markers.marker_set import Calibration
from excite.human.recording import Recording
from excite.human.segments import NAMES
from excite.human.skeleton import DESCENDANTS, N_SEGMENTS, Pose
from excite.logs.signals.butterworth import lowpass, settling_samples

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
        calibration: the subject's body.
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
    rough = _coarse_solution(model, points)
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


def _coarse_solution(model: MarkerModel, points: Array) -> Solution:
    """Postures of every few frames from scratch, then all frames from these, then bad ones from good neighbours."""
    frames = np.unique(np.append(np.arange(0, len(points), 4), len(points) - 1))
    few = _repair_frames(model, points[frames], first_poses(model, points[frames]))
    start = interpolate_poses(frames.astype(float), few.pose, np.arange(len(points)).astype(float))
    return _repair_frames(model, points, solve_poses(model, points, start, steps=6))


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


# Postures between those that are known: positions linearly, rotations on the shortest arc.


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
        labels: of the markers.
        recording: whose source is named.
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
