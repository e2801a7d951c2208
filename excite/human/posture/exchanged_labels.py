"""Markers that carry each other's label for a while."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from excite.arrays import Array
from excite.finding import Finding, list_names
from excite.human.markers.inverse_kinematics import MarkerModel, Solution
from excite.human.posture.between_poses import interpolate_poses
from excite.human.recording import Recording

FAR = 0.05
"""A pair of labels is exchanged only where both lie this far from where they belong [m]."""
_MENDED = 0.5


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
    for predicted in (model.predicted(solution.pose[bad]), model.predicted(between)):
        shown = points[bad]
        distance = np.linalg.norm(shown - predicted, axis=2)
        suspects = np.flatnonzero((np.nan_to_num(distance) > FAR).any(axis=0))
        for place, a in enumerate(suspects):
            for b in suspects[place + 1 :]:
                own = distance[:, a] + distance[:, b]
                other = np.linalg.norm(shown[:, a] - predicted[:, b], axis=1) + np.linalg.norm(
                    shown[:, b] - predicted[:, a], axis=1
                )
                chosen = (distance[:, a] > FAR) & (distance[:, b] > FAR) & (other < _MENDED * own)
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
        text = f"{recording.source.name}: {list_names(stray)} lie more than 10 cm off in some frames; they count less there"
        findings.append(Finding("stray_markers", text, {"share_of_frames": share}, stray))
    return findings
