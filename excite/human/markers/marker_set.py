"""Which marker sits where: marker sets and the mapping files that describe others."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from excite.arrays import Array
from excite.errors import InputError, UnknownNameError
from excite.finding import list_names
from excite.formats.documents import read_yaml
from excite.human.body import DIMENSIONS, Dimensions, joint_offsets, stature_dimensions
from excite.human.markers.inverse_kinematics import MarkerModel, Solution, first_poses, solve_poses
from excite.human.segment_tables import DUMAS_PELVIS
from excite.human.segments import NAMES, PARENTS, SIDES, Subject
from excite.human.skeleton import DESCENDANTS, N_SEGMENTS, N_VELOCITY, Pose, place_segments, point_jacobian

# Where bony landmarks lie on the segments: first guesses, which calibration refines.

_STATURE = 1.77


@dataclass(frozen=True)
class Landmark:
    """A landmark of one side (of the right one, y counted outwards) or of the middle.

    Attributes:
        kind: segment without side.
        anchor: joint-carried segment without side from whose joint it is measured; None for the segment's own
            origin.
        place: x forward, y outward (to the left in the middle), z up from there, of a man of 1.77 m [m].
    """

    kind: str
    anchor: str | None
    place: tuple[float, float, float]


# Dumas et al. 2007 place the cervical joint from C7 and suprasternale (53 to 55 % of their distance, 8° to 14°
# above it) and the shoulder from the acromion; other places are of a mean man, good to two centimetres.
_SIDED: dict[str, Landmark] = {
    "asis": Landmark("pelvis", None, (0.021, 0.112, 0.083)),
    "psis": Landmark("pelvis", None, (-0.135, 0.045, 0.090)),
    "greater_trochanter": Landmark("thigh", None, (0.0, 0.075, -0.01)),
    "lateral_knee": Landmark("thigh", "shank", (0.0, 0.055, 0.0)),
    "medial_knee": Landmark("thigh", "shank", (0.0, -0.055, 0.0)),
    "fibula_head": Landmark("shank", None, (-0.01, 0.05, -0.05)),
    "lateral_ankle": Landmark("shank", "foot", (-0.005, 0.042, -0.005)),
    "medial_ankle": Landmark("shank", "foot", (0.005, -0.040, 0.005)),
    "heel": Landmark("foot", None, (-0.060, 0.0, -0.040)),
    "first_metatarsal": Landmark("foot", None, (0.135, -0.045, -0.050)),
    "second_metatarsal": Landmark("foot", None, (0.140, -0.010, -0.040)),
    "fifth_metatarsal": Landmark("foot", None, (0.110, 0.055, -0.055)),
    "toe": Landmark("foot", None, (0.195, -0.010, -0.050)),
    "acromion": Landmark("torso", "upper_arm", (-0.010, -0.005, 0.055)),
    "scapula": Landmark("torso", "upper_arm", (-0.120, -0.100, -0.060)),
    "lateral_elbow": Landmark("upper_arm", "forearm", (0.0, 0.040, 0.0)),
    "medial_elbow": Landmark("upper_arm", "forearm", (0.0, -0.040, 0.0)),
    # Pronation belongs to the wrist: both styloids turn with the hand.
    "radial_wrist": Landmark("hand", None, (0.0, 0.033, 0.0)),
    "ulnar_wrist": Landmark("hand", None, (0.0, -0.033, 0.0)),
    "second_metacarpal": Landmark("hand", None, (-0.015, 0.025, -0.085)),
    "fifth_metacarpal": Landmark("hand", None, (-0.015, -0.035, -0.075)),
    "temple": Landmark("head", None, (0.060, 0.075, 0.150)),
    "back_of_head": Landmark("head", None, (-0.090, 0.060, 0.150)),
}
_MIDDLE: dict[str, Landmark] = {
    "sacrum": Landmark("pelvis", None, (-0.140, 0.0, 0.090)),
    "c7": Landmark("torso", "head", (-0.076, 0.0, 0.025)),
    "t8": Landmark("torso", "head", (-0.110, 0.0, -0.170)),
    "t10": Landmark("torso", "head", (-0.100, 0.0, -0.240)),
    "suprasternale": Landmark("torso", "head", (0.052, 0.0, -0.043)),
    "xiphoid": Landmark("torso", "head", (0.090, 0.0, -0.200)),
    "vertex": Landmark("head", None, (0.0, 0.0, 0.244)),
    "parietal": Landmark("head", None, (-0.040, 0.0, 0.235)),
}
LANDMARKS: tuple[str, ...] = (
    *_MIDDLE,
    *(f"{side}_{name}" for side in SIDES for name in _SIDED),
)


def landmark_segment(name: str) -> str:
    """The segment that carries a landmark; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    return landmark.kind if side is None or landmark.kind in NAMES else f"{side}_{landmark.kind}"


def landmark_place(name: str, subject: Subject, dimensions: Dimensions) -> Array:
    """Where a landmark lies in its segment's frame, ``(3,)`` [m]; raises UnknownNameError."""
    landmark, side = _find_landmark(name)
    scale = subject.height / _STATURE
    x, y, z = landmark.place
    place = np.array([x, -y if side == "right" else y, z]) * scale
    if landmark.kind == "pelvis" and name.endswith("asis"):
        # Dumas' pelvis in units of the distance of the hips, which is what the dimensions hold.
        row = DUMAS_PELVIS[subject.sex]
        width = dimensions["hip_half_width"] / (row.hip[2] / 100.0)
        outward = -0.5 if side == "right" else 0.5
        place = width * np.array([-row.hip[0] / 100.0, outward, -row.hip[1] / 100.0])
    if landmark.anchor is not None:
        child = landmark.anchor if landmark.anchor in NAMES else f"{side}_{landmark.anchor}"
        place = place + joint_offsets()[NAMES.index(child)] @ dimensions.values
    return place


def _find_landmark(name: str) -> tuple[Landmark, str | None]:
    side, _, rest = name.partition("_")
    if side in SIDES and rest in _SIDED:
        return _SIDED[rest], side
    if name in _MIDDLE:
        return _MIDDLE[name], None
    raise UnknownNameError("landmark", name, list(LANDMARKS))


SCHEMA = "excite.markers/1"
_FEWEST = 10
_SHARE = 0.5


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


def _both_sides(pairs: Mapping[str, str], right: str = "R", left: str = "L") -> dict[str, str]:
    """Landmarks (without side) by label's ending, for both sides."""
    return {
        f"{letter}{ending}": f"{side}_{name}"
        for letter, side in ((right, "right"), (left, "left"))
        for ending, name in pairs.items()
    }


def _from_landmarks(name: str, landmarks: Mapping[str, str], technical: Mapping[str, str]) -> MarkerSet:
    sites = {label: MarkerSite(landmark_segment(mark), mark) for label, mark in landmarks.items()}
    return MarkerSet(name, sites | {label: MarkerSite(segment) for label, segment in technical.items()})


# The 35 markers of Jovic et al., T-RO 2016, section V.
_JOVIC = _from_landmarks(
    "jovic",
    {
        "TOP": "parietal",
        "C7": "c7",
        "T10": "t10",
        "STRN": "suprasternale",
        "XIPH": "xiphoid",
        "SACR": "sacrum",
        "RSCAP": "right_scapula",
        **_both_sides(
            {
                "HEAD": "temple",
                "SHO": "acromion",
                "ELBL": "lateral_elbow",
                "ELBM": "medial_elbow",
                "WRT": "radial_wrist",
                "WRP": "ulnar_wrist",
                "HND": "second_metacarpal",
                "ASIS": "asis",
                "TROC": "greater_trochanter",
                "KNEL": "lateral_knee",
                "ANKL": "lateral_ankle",
                "HEEL": "heel",
                "MT1": "first_metatarsal",
                "MT5": "fifth_metatarsal",
            }
        ),
    },
    {},
)
_RAJAGOPAL = _from_landmarks(
    "rajagopal",
    {
        "C7": "c7",
        "CLAV": "suprasternale",
        **_both_sides(
            {
                "ACR": "acromion",
                "ASI": "asis",
                "PSI": "psis",
                "LEL": "lateral_elbow",
                "MEL": "medial_elbow",
                "FAradius": "radial_wrist",
                "FAulna": "ulnar_wrist",
                "LFC": "lateral_knee",
                "MFC": "medial_knee",
                "LMAL": "lateral_ankle",
                "MMAL": "medial_ankle",
                "CAL": "heel",
                "TOE": "toe",
                "MT5": "fifth_metatarsal",
            }
        ),
    },
    {
        f"{letter}{label}": f"{side}_{segment}"
        for letter, side in (("R", "right"), ("L", "left"))
        for label, segment in {
            **{f"UA{i}": "upper_arm" for i in (1, 2, 3)},
            **{f"TH{i}": "thigh" for i in (1, 2, 3, 4)},
            **{f"TB{i}": "shank" for i in (1, 2, 3)},
            "FAsuperior": "forearm",
        }.items()
    },
)
_PLUG_IN_GAIT = _from_landmarks(
    "plug_in_gait",
    {
        "C7": "c7",
        "T10": "t10",
        "CLAV": "suprasternale",
        "STRN": "xiphoid",
        "RBAK": "right_scapula",
        **_both_sides(
            {
                "FHD": "temple",
                "BHD": "back_of_head",
                "SHO": "acromion",
                "ELB": "lateral_elbow",
                "WRA": "radial_wrist",
                "WRB": "ulnar_wrist",
                "FIN": "second_metacarpal",
                "ASI": "asis",
                "PSI": "psis",
                "KNE": "lateral_knee",
                "ANK": "lateral_ankle",
                "HEE": "heel",
                "TOE": "second_metatarsal",
            }
        ),
    },
    {
        f"{letter}{label}": f"{side}_{segment}"
        for letter, side in (("R", "right"), ("L", "left"))
        for label, segment in {"UPA": "upper_arm", "FRM": "forearm", "THI": "thigh", "TIB": "shank"}.items()
    },
)
MARKER_SETS: tuple[MarkerSet, ...] = (_JOVIC, _PLUG_IN_GAIT, _RAJAGOPAL)


def bare_label(label: str) -> str:
    """A label without the subject's name that capture programs put before a colon."""
    return label.rsplit(":", 1)[-1].strip()


def find_marker_set(labels: Iterable[str]) -> MarkerSet:
    """The set that most labels of a file belong to.

    Raises:
        InputError: no set has half of its markers in the file; a mapping file is needed.
    """
    present = {bare_label(label) for label in labels}
    best = max(MARKER_SETS, key=lambda item: len(present & item.sites.keys()))
    found = len(present & best.sites.keys())
    if found < max(_FEWEST, _SHARE * min(len(best.sites), len(present))):
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
    for known in MARKER_SETS:
        if known.name == str(name_or_path):
            return known
    # Not Path.is_file, which raises for names that no file can have.
    if not os.path.isfile(name_or_path):
        names = [known.name for known in MARKER_SETS]
        raise UnknownNameError("marker set (or mapping file)", str(name_or_path)[:200], names)
    path = Path(name_or_path)
    content = read_yaml(path)
    if content.get("schema") != SCHEMA:
        raise InputError(
            "is no mapping file", source=path, field="schema", remedy=f"begin with schema: {SCHEMA}"
        )
    entries = content.get("markers")
    if not isinstance(entries, dict) or not entries:
        raise InputError(
            "lists no markers", source=path, field="markers", remedy="map label to landmark or segment"
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
    landmark, segment = entry.get("landmark"), entry.get("segment")
    if landmark is not None and str(landmark) not in LANDMARKS:
        raise InputError(
            f"no landmark {str(landmark)[:60]!r}",
            source=path,
            field=field,
            remedy="choose one of " + ", ".join(LANDMARKS),
        )
    segment = landmark_segment(str(landmark)) if segment is None else str(segment)
    if segment not in NAMES:
        raise InputError(
            f"no segment {segment[:60]!r}",
            source=path,
            field=field,
            remedy="choose one of " + ", ".join(NAMES),
        )
    return MarkerSite(segment, None if landmark is None else str(landmark))


# A subject's own joint centres and marker places, from all that markers do together.
#
# Postures of some frames, the sixteen dimensions and all marker places are found at once: the sum of squares
# of marker distances over these frames plus how far dimensions and bony landmarks lie from first guesses.
# Postures drop out frame by frame (Schur complement), so that the work grows with the number of frames only
# linearly.

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
        carried = np.flatnonzero(np.isin(model.segment, DESCENDANTS[k]))
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
