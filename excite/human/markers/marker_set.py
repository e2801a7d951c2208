"""Which marker sits where: marker sets and the mapping files that describe others."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from excite.arrays import Array, Flags, Indices
from excite.errors import InputError, UnknownNameError
from excite.finding import list_names
from excite.formats.documents import read_yaml
from excite.human.body import DIMENSIONS, DUMAS_PELVIS, Dimensions, joint_offsets, stature_dimensions
from excite.human.markers.inverse_kinematics import MarkerModel, Solution, first_poses, solve_poses
from excite.human.segments import NAMES, PARENTS, SIDES, Subject
from excite.human.skeleton import DESCENDANTS, N_SEGMENTS, N_VELOCITY, Pose, place_segments, point_jacobian

# Where bony landmarks lie on the segments: first guesses, which calibration refines.

_HERE = Path(__file__).parent


class Landmark(NamedTuple):
    """A landmark of one side (of the right one, y counted outwards) or of the middle, as ``landmarks.yaml`` has it."""

    kind: str
    anchor: str | None
    place: tuple[float, float, float]


_LANDMARKS = {
    group: {name: Landmark(*row) for name, row in rows.items()}
    for group, rows in read_yaml(_HERE / "landmarks.yaml").items()
}
LANDMARKS: tuple[str, ...] = (
    *_LANDMARKS["middle"],
    *(f"{side}_{name}" for side in SIDES for name in _LANDMARKS["sided"]),
)


def landmark_segment(name: str) -> str:
    """The segment that carries a landmark; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    return _of_side(landmark.kind, side)


def landmark_place(name: str, subject: Subject, dimensions: Dimensions) -> Array:
    """Where a landmark lies in its segment's frame, ``(3,)`` [m]; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    outward = -1.0 if side == "right" else 1.0
    if name.endswith("asis"):
        # Dumas' pelvis in units of the distance of the hips, which is what the dimensions hold.
        x, y, z = DUMAS_PELVIS[subject.sex].hip
        return dimensions["hip_half_width"] / z * np.array([-x, 50.0 * outward, -y])
    # Stature that the places of the landmarks are of [m].
    place = np.array(landmark.place) * [1.0, outward, 1.0] * subject.height / 1.77
    if landmark.anchor is not None:
        place += joint_offsets()[NAMES.index(_of_side(landmark.anchor, side))] @ dimensions.values
    return place


def _of_side(kind: str, side: str | None) -> str:
    return kind if side is None or kind in NAMES else f"{side}_{kind}"


def _find_landmark(name: str) -> tuple[Landmark, str | None]:
    side, _, rest = name.partition("_")
    if side in SIDES and rest in _LANDMARKS["sided"]:
        return _LANDMARKS["sided"][rest], side
    if name in _LANDMARKS["middle"]:
        return _LANDMARKS["middle"][name], None
    raise UnknownNameError("landmark", name, list(LANDMARKS))


SCHEMA = "excite.markers/1"
MARKER_SETS = {path.stem: path for path in sorted((_HERE / "sets").glob("*.yaml"))}
"""Sets that come with excite: mapping files as users write them."""


@dataclass(frozen=True)
class MarkerSite:
    """Where a marker sits.

    Attributes:
        segment: segment that carries it.
        landmark: bony landmark under it, None for a marker whose place only calibration finds.
    """

    segment: str
    landmark: str | None = None


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Markers by label.

    Attributes:
        name: of the set.
        sites: by label.
    """

    name: str
    sites: Mapping[str, MarkerSite]


def bare_label(label: str) -> str:
    """A label without the subject's name that capture programs put before a colon."""
    return label.rsplit(":", 1)[-1].strip()


def find_marker_set(labels: Iterable[str]) -> MarkerSet:
    """The set that most labels of a file belong to.

    Raises:
        InputError: no set has half of its markers in the file; a mapping file is needed.
    """
    present = {bare_label(label) for label in labels}
    best = max(map(read_marker_set, MARKER_SETS), key=lambda item: len(present & item.sites.keys()))
    found = len(present & best.sites.keys())
    if found < max(10, 0.5 * min(len(best.sites), len(present))):
        raise InputError(
            f"labels fit no known marker set ({best.name} has {found} of them): {list_names(sorted(present), 4)}",
            field="markers",
            remedy="give a mapping file with --markers: schema: excite.markers/1, markers:, and a line a label, "
            "{landmark: right_acromion} or {segment: right_thigh} behind it",
        )
    return best


def read_marker_set(name_or_path: str | Path) -> MarkerSet:
    """A marker set by name, or from a mapping file.

    The file is YAML: ``schema: excite.markers/1``, ``markers:`` and below it one line a label,
    ``RASI: {landmark: right_asis}`` or ``RTH1: {segment: right_thigh}``.

    Raises:
        InputError: the file is missing or malformed, or names no segment or landmark.
    """
    name = str(name_or_path)
    path = MARKER_SETS.get(name, Path(name_or_path))
    # Not Path.is_file, which raises for names that no file can have.
    if not os.path.isfile(path):
        raise UnknownNameError("marker set (or mapping file)", name[:200], list(MARKER_SETS))
    content = read_yaml(path)
    entries = content.get("markers")
    stated = content.get("schema") == SCHEMA
    if not stated or not isinstance(entries, dict) or not entries:
        raise InputError(
            "lists no markers" if stated else "is no mapping file",
            source=path,
            field="markers" if stated else "schema",
            remedy="map label to landmark or segment" if stated else f"begin with schema: {SCHEMA}",
        )
    return MarkerSet(
        path.stem, {str(label): _read_site(entry, str(label), path) for label, entry in entries.items()}
    )


def _read_site(entry: object, label: str, path: Path) -> MarkerSite:
    field = f"markers.{label}"
    if not isinstance(entry, dict) or not entry.keys() <= {"segment", "landmark"} or not entry:
        raise InputError(
            f"is {str(entry)[:60]!r}", source=path, field=field, remedy="write {landmark: …} or {segment: …}"
        )
    for kind, known in (("landmark", LANDMARKS), ("segment", NAMES)):
        given = entry.get(kind)
        if given is not None and str(given) not in known:
            raise InputError(
                f"no {kind} {str(given)[:60]!r}",
                source=path,
                field=field,
                remedy="choose one of " + ", ".join(known),
            )
    landmark, segment = (
        None if entry.get(kind) is None else str(entry[kind]) for kind in ("landmark", "segment")
    )
    return MarkerSite(segment or landmark_segment(str(landmark)), landmark)


# A subject's own joint centres and marker places, from all that markers do together.
#
# Postures of some frames, the sixteen dimensions and all marker places are found at once: the sum of squares
# of marker distances over these frames plus how far dimensions and bony landmarks lie from first guesses.
# Postures drop out frame by frame (Schur complement), so that the work grows with the number of frames only
# linearly.

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
