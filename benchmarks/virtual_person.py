"""A virtual person in a virtual motion laboratory, whose every number is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.atomic import atomic_path
from excite.errors import UnknownNameError
from excite.formats.number import check_number
from excite.human.body import Body, body_of, segment_box
from excite.human.markers.marker_set import landmark_place, read_marker_set
from excite.human.measure import urdf_text
from excite.human.recording import PlateRecording, Recording
from excite.human.segments import (
    JOINT_NAMES,
    N_SEGMENTS,
    NAMES,
    PARENTS,
    SEGMENTS,
    Placement,
    Pose,
    Subject,
    frame_turn,
    place_segments,
)

# What a virtual person does: arms, trunk, head, legs and squats on two force plates, and the same done again.


@dataclass(frozen=True, eq=False)
class Performance:
    """True motion: time ``(n,)``, pelvis pose ``(n, 7)``, joint angles ``(n, 34)``, share on the right foot."""

    time: Array
    base: Array
    angles: Array
    right_share: Array


def perform_exercise(body: Body, seconds: float = 60.0, rate_hz: float = 100.0, seed: int = 0) -> Performance:
    """Arms, trunk and head all the time; right leg, left leg and squats in turn, weight over the standing foot."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    time = np.arange(n) / rate_hz
    angles = np.zeros((n, 34))

    def wave(amplitude: float, low: float = 0.2, high: float = 0.9) -> Array:
        parts = [
            np.sin(2 * np.pi * (f * time + p))
            for f, p in zip(rng.uniform(low, high, 4), rng.uniform(0, 1, 4), strict=True)
        ]
        return np.asarray(amplitude * np.sum(parts, axis=0) / 2.0)

    def put(name: str, values: Array) -> None:
        angles[:, JOINT_NAMES.index(name)] = values

    for name, amplitude in {
        "lumbar_flexion": 0.3,
        "lumbar_bending": 0.2,
        "lumbar_rotation": 0.3,
        "neck_flexion": 0.3,
        "neck_bending": 0.2,
        "neck_rotation": 0.4,
    }.items():
        put(name, wave(amplitude))
    phase = 2 * np.pi * time / seconds * 3.0
    right_share = 1.0 / (1.0 + np.exp(-6.0 * np.sin(phase)))
    squat = np.exp(-4.0 * np.sin(phase) ** 2)
    for side, share in (("right", right_share), ("left", 1.0 - right_share)):
        for name, amplitude, center in (
            ("shoulder_flexion", 0.7, 0.5),
            ("shoulder_rotation", 0.3, 0.0),
            ("shoulder_adduction", 0.5, -0.5),
            ("elbow", 0.6, 0.9),
            ("wrist_pronation", 0.4, 0.0),
            ("wrist_deviation", 0.2, 0.0),
            ("wrist_flexion", 0.3, 0.0),
        ):
            values = center + wave(amplitude)
            put(
                f"{side}_{name}",
                0.1 + np.logaddexp(0.0, 4.0 * (values - 0.1)) / 4.0 if name == "elbow" else values,
            )
        free = np.clip(1.0 - 2.0 * share, 0.0, 1.0)
        free = free**3 * (10.0 - 15.0 * free + 6.0 * free**2)
        down = 0.35 * squat * (1.0 + np.sin(2 * np.pi * 0.45 * time))
        put(f"{side}_hip_flexion", 0.15 + down + free * (0.4 + wave(0.5)))
        put(f"{side}_hip_adduction", -free * 0.15 + free * wave(0.2))
        put(f"{side}_hip_rotation", free * wave(0.25))
        put(f"{side}_knee", 0.3 + 2.0 * down + free * (0.5 + wave(0.4)))
        put(f"{side}_ankle_flexion", 0.15 + down + free * wave(0.3))
        put(f"{side}_ankle_adduction", free * wave(0.15))
        put(f"{side}_ankle_rotation", free * wave(0.1))
    return balance_pelvis(body, time, angles, right_share)


def repeat_exercise(body: Body, show: Performance, rng: np.random.Generator) -> Performance:
    """The same exercise done again: timing wanders by some tenths of a second, each joint's range by some 5 %."""
    n = len(show.time)
    rate = 1.0 / (show.time[1] - show.time[0])
    late = np.cumsum(_wandering_noise(n, rate, 4.0, 1, rng)[:, 0]) * 0.05 / rate
    at = np.clip(show.time + late - late.mean(), show.time[0], show.time[-1])
    angles, share = (CubicSpline(show.time, values)(at) for values in (show.angles, show.right_share))
    middle = angles.mean(axis=0)
    angles = middle + (angles - middle) * (1.0 + 0.05 * _wandering_noise(n, rate, 3.0, angles.shape[1], rng))
    return balance_pelvis(body, show.time, angles, share)


def _wandering_noise(n: int, rate: float, seconds: float, columns: int, rng: np.random.Generator) -> Array:
    """Smooth noise of unit variance that forgets itself in so many seconds, ``(n, columns)``."""
    kernel = np.hanning(int(2 * seconds * rate))
    noise = rng.standard_normal((n + len(kernel), columns))
    smooth = np.column_stack([fftconvolve(column, kernel, "valid")[:n] for column in noise.T])
    return np.asarray(smooth / np.sqrt((kernel**2).sum()))


def balance_pelvis(body: Body, time: Array, angles: Array, share: Array) -> Performance:
    """Put the pelvis so that the weighted feet keep their height and the centre of mass lies over them."""
    n = len(time)
    base = np.zeros((n, 7))
    base[:, 6] = 1.0
    placed = place_segments(pose_of(base, angles), body.offsets)
    masses = np.array([b.mass for b in body.inertias])
    centers = np.stack([b.lever for b in body.inertias])
    points = placed.origin + np.einsum("nkij,kj->nki", placed.rotation, centers)
    com = np.einsum("k,nki->ni", masses / masses.sum(), points)
    feet = {side: placed.origin[:, NAMES.index(f"{side}_foot")] for side in ("right", "left")}
    width = 0.5 * abs(feet["right"][0, 1] - feet["left"][0, 1])
    target = np.column_stack([0.05 + 0 * time, (1 - 2 * share) * width])
    base[:, :2] = target - com[:, :2]
    height = share * feet["right"][:, 2] + (1 - share) * feet["left"][:, 2]
    base[:, 2] = body.dimensions.ankle_height - height
    return Performance(time, base, angles, share)


# Recordings of markers and forces as OpenSim's files: TRC and MOT, in the formats' own words.


def write_trc(recording: Recording, path: Path, unit: float = 1e-3, name: str = "mm") -> Path:
    """A TRC file with y up; ``name`` is the unit that its header claims, ``unit`` the one it has."""
    labels = list(recording.markers)
    points = np.stack(list(recording.markers.values()), axis=1)
    turned = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1) / unit
    rate = recording.rate_hz
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate:g}\t{rate:g}\t{len(points)}\t{len(labels)}\t{name}\t{rate:g}\t1\t{len(points)}",
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(labels) + 1)),
        "",
    ]
    for i, (t, frame) in enumerate(zip(recording.time, turned, strict=True)):
        fields = [f"{v:.5f}" if np.isfinite(v) else "" for v in frame.ravel()]
        lines.append("\t".join([f"{i + 1}", f"{t:.5f}", *fields]))
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_mot(
    recording: Recording, path: Path, names: tuple[str, ...] = ("R", "L"), point_unit: float = 1.0
) -> Path:
    """Ground reaction forces with y up, point of application on the floor and free moment."""
    columns = {"time": recording.plates[0].time}
    for name, plate in zip(names, recording.plates, strict=True):
        loaded = np.abs(plate.force[:, 2]) > 5.0
        vertical = np.where(loaded, plate.force[:, 2], 1.0)
        point = np.column_stack([-plate.moment[:, 1] / vertical, plate.moment[:, 0] / vertical, 0 * vertical])
        point[~loaded] = 0.0
        free = plate.moment - np.cross(point, plate.force)
        for kind, values in (("force_v", plate.force), ("force_p", point / point_unit), ("torque_", free)):
            turned = np.column_stack([values[:, 0], values[:, 2], -values[:, 1]])
            for axis, column in zip("xyz", turned.T, strict=True):
                columns[f"{name}_ground_{kind}{axis}"] = column
    with atomic_path(path) as temporary:
        _write_storage(columns, temporary)
    return path


# A virtual motion laboratory: what cameras and two force plates say of a virtual person; truth from
# pinocchio.
#
# Levels: cameras 0.5 mm (Windolf et al. 2008: 0.06-0.5 mm), plates 1.5 N and 0.3 N·m, zero off by 2 N
# (Kistler 9281: threshold 0.01 N, drift 0.01 N/s).

CAMERA_M = 0.0005
PLATE_N, PLATE_NM, PLATE_ZERO_N = 1.5, 0.3, 2.0
_PLATE_SIZE = (0.6, 0.4)


def ground_wrench(model: pin.Model, show: Performance) -> Array:
    """Wrench of the ground on the person about the world's origin, ``(n, 6)``, by inverse dynamics."""
    order = [model.joints[model.getJointId(name)].idx_q for name in JOINT_NAMES]
    q = np.tile(pin.neutral(model), (len(show.time), 1))
    q[:, :7] = show.base
    q[:, order] = show.angles
    rate = 1.0 / (show.time[1] - show.time[0])
    v = np.array([pin.difference(model, a, b) for a, b in zip(q[:-2], q[2:], strict=True)]) * rate / 2
    v = np.vstack([v[:1], v, v[-1:]])
    a = np.gradient(v, axis=0) * rate
    data = model.createData()
    base = np.array([pin.rnea(model, data, *state)[:6] for state in zip(q, v, a, strict=True)])
    rotation = Rotation.from_quat(q[:, 3:7]).as_matrix()
    force, moment = (np.einsum("nij,nj->ni", rotation, part) for part in (base[:, :3], base[:, 3:]))
    return np.hstack([force, moment + np.cross(q[:, :3], force)])


def record_performance(
    who: VirtualSubject,
    show: Performance,
    rng: np.random.Generator,
    belt: Belt | None = None,
    *,
    noise: float = 1.0,
    name: str = "virtual",
) -> Recording:
    """What the laboratory's cameras and plates say of a performance."""
    placed = place_segments(pose_of(show.base, show.angles), who.body.offsets)
    markers = {}
    sites = read_marker_set(MARKERS).sites
    for label in who.local:
        k = NAMES.index(sites[label].segment)
        skin = _soft_tissue(who.wobble[label], show, k, rng)
        local = who.local[label] + noise * skin
        point = placed.origin[:, k] + np.einsum("nij,nj->ni", placed.rotation[:, k], local)
        markers[label] = point + noise * CAMERA_M * rng.standard_normal(point.shape)
    wrench = ground_wrench(true_model(who.body, belt), show)
    plates = _plate_recordings(wrench, show, placed, rng, noise)
    return Recording(Path(f"{name}.c3d"), show.time, markers, plates)


def _soft_tissue(coefficients: Array, show: Performance, segment: int, rng: np.random.Generator) -> Array:
    """Skin slides with the angles of the joints at either end, and swings a little by itself."""
    near = [segment, *[k for k in range(len(NAMES)) if PARENTS[k] == segment][:1]]
    columns = []
    for k in near:
        joint = SEGMENTS[k].joint
        if joint is not None:
            first = next(i for i, name in enumerate(JOINT_NAMES) if name.startswith(joint))
            columns.append(np.sin(show.angles[:, first]))
    columns = (columns + [np.zeros(len(show.time))] * 2)[:2]
    rate = 1.0 / (show.time[1] - show.time[0])
    noise = rng.standard_normal((len(show.time), 2))
    kernel = np.hanning(int(0.4 * rate))
    slow = np.column_stack([np.convolve(column, kernel, "same") for column in noise.T])
    slow /= np.maximum(slow.std(axis=0), 1e-9)
    basis = np.column_stack([*columns, 0.3 * slow])
    return basis @ coefficients.T


def _plate_recordings(
    wrench: Array, show: Performance, placed: Placement, rng: np.random.Generator, noise: float
) -> tuple[PlateRecording, ...]:
    """Two plates side by side at 1 kHz; the load is shared so that each foot carries its part."""
    n = len(show.time)
    found = []
    feet = {s: placed.origin[:, NAMES.index(f"{s}_foot")] for s in ("right", "left")}
    ground = {s: np.column_stack([p[:, 0] + 0.05, p[:, 1], 0 * p[:, 2]]) for s, p in feet.items()}
    # As much on either foot as brings the centre of pressure of the whole between them.
    pressure = wrench[:, 3] / wrench[:, 2]
    share = (pressure - ground["left"][:, 1]) / (ground["right"][:, 1] - ground["left"][:, 1])
    share = np.clip(share, 0.0, 1.0)
    part = {"right": share, "left": 1.0 - share}
    rest = wrench[:, 3:] - sum(
        np.cross(ground[s], part[s][:, None] * wrench[:, :3]) for s in ("right", "left")
    )
    for side in ("right", "left"):
        y = float(np.median(feet[side][:, 1]))
        lx, ly = _PLATE_SIZE
        corners = np.array([[lx, ly, 0], [-lx, ly, 0], [-lx, -ly, 0], [lx, -ly, 0]]) / 2 + [0.05, y, 0]
        force = part[side][:, None] * wrench[:, :3]
        moment = np.cross(ground[side], force) + part[side][:, None] * rest
        time = np.arange(10 * n - 9) * (show.time[1] - show.time[0]) / 10
        values = np.column_stack(
            [np.interp(time, show.time, column) for column in np.hstack([force, moment]).T]
        )
        zero = noise * PLATE_ZERO_N * rng.standard_normal(3)
        values[:, :3] += zero + noise * PLATE_N * rng.standard_normal((len(time), 3))
        values[:, 3:] += np.cross(corners.mean(axis=0), zero)
        values[:, 3:] += noise * PLATE_NM * rng.standard_normal((len(time), 3))
        found.append(PlateRecording(f"plate_{side}", time, values[:, :3], values[:, 3:], corners))
    return tuple(found)


def record_standing(who: VirtualSubject, rng: np.random.Generator, noise: float = 1.0) -> Recording:
    """Two seconds of quiet standing."""
    n = 200
    angles = np.zeros((n, 34))
    show = balance_pelvis(who.body, np.arange(n) / 100.0, angles, np.full(n, 0.5))
    return replace(record_performance(who, show, rng, noise=noise, name="static"), plates=())


# A virtual person: segments that differ from the tables as people's do, markers that ride on soft tissue.
#
# Soft tissue moves by 2-12 mm by segment (Leardini et al. 2005, Camomilla et al. 2017).

MARKERS = "jovic"
"""The marker set that a virtual person wears."""
SOFT_TISSUE_M = {
    "pelvis": 0.006,
    "torso": 0.006,
    "head": 0.002,
    "upper_arm": 0.007,
    "forearm": 0.005,
    "hand": 0.003,
    "thigh": 0.012,
    "shank": 0.007,
    "foot": 0.003,
}
# The subject of Jovic et al., T-RO 2016, section VIII.
_SUBJECT = Subject(70.0, 1.82, "male")


@dataclass(frozen=True)
class Belt:
    """A weight worn on a segment: mass [kg] and place in the segment's frame [m]."""

    segment: str
    mass: float
    place: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class VirtualSubject:
    """A person whose every number is known.

    Attributes:
        body: true dimensions and inertial parameters.
        local: true places of the markers by label, segment frames [m].
        wobble: by label: direction-by-angle coefficients of the soft tissue ``(3, 4)`` [m].
    """

    body: Body
    local: dict[str, Array]
    wobble: dict[str, Array]


def draw_subject(
    rng: np.random.Generator, subject: Subject = _SUBJECT, *, spread: float = 0.12
) -> VirtualSubject:
    """A person whose masses, centres, lengths and marker places differ from the tables' by chance.

    Args:
        rng: source of what is drawn.
        subject: mass, height and sex, which are as stated.
        spread: standard deviation of a segment's mass, as a share of the table's.
    """
    body = body_of(subject)
    values = body.dimensions.values * (1.0 + 0.03 * rng.standard_normal(16))
    values[12:16] = values[8:12] * (1.0 + 0.005 * rng.standard_normal(4))
    dimensions = replace(body.dimensions, values=values)
    body = body_of(subject, dimensions)
    masses = np.array([b.mass for b in body.inertias]) * (1.0 + spread * rng.standard_normal(15))
    masses[9:] = masses[3:9] * (1.0 + 0.03 * rng.standard_normal(6))
    masses *= subject.mass / masses.sum()
    inertias = []
    for b, mass in zip(body.inertias, masses, strict=True):
        center = b.lever * (1.0 + 0.05 * rng.standard_normal()) + 0.005 * rng.standard_normal(3)
        inertias.append(pin.Inertia(mass, center, b.inertia * mass / b.mass))
    body = replace(body, inertias=tuple(inertias))
    sites = read_marker_set(MARKERS).sites
    local, wobble = {}, {}
    for label, site in sites.items():
        if site.landmark is None:
            continue
        place_ = landmark_place(site.landmark, subject, dimensions)
        local[label] = place_ + 0.008 * rng.standard_normal(3)
        size = SOFT_TISSUE_M[SEGMENTS[NAMES.index(site.segment)].kind]
        wobble[label] = size * rng.standard_normal((3, 4)) / 2.0
    return VirtualSubject(body, local, wobble)


def true_model(body: Body, belt: Belt | None = None) -> pin.Model:
    """Pinocchio model of a body, with a belt as a point mass on its segment."""
    model = pin.buildModelFromXML(urdf_text(body), pin.JointModelFreeFlyer())
    if belt is not None:
        k = NAMES.index(belt.segment)
        frame = model.getFrameId(belt.segment)
        joint = model.frames[frame].parentJoint
        place_ = model.frames[frame].placement.act(frame_turn(k) @ np.array(belt.place))
        model.inertias[joint] = model.inertias[joint] + pin.Inertia(belt.mass, place_, np.zeros((3, 3)))
    return model


# A first session without a laboratory: recordings of a virtual person as files, and the truth behind them.

# Shorter than ten seconds, legs and arms have no time to swing; longer than ten minutes, nobody does it.
_SECONDS = (10.0, 600.0)
_WEIGHT_KG = (0.0, 50.0)


@dataclass(frozen=True)
class SimulatedSession:
    """Files of a virtual person.

    Attributes:
        standing: markers while standing still, for calibration (TRC).
        moving: markers and ground reaction of the exercise (TRC, MOT).
        wearing: the exercise done again with a weight (TRC, MOT); empty without one.
        masses: true masses of the segments without the weight [kg].
    """

    standing: tuple[Path, ...]
    moving: tuple[Path, ...]
    wearing: tuple[Path, ...]
    masses: Mapping[str, float]


def simulate_person(
    out: Path,
    subject: Subject,
    *,
    seconds: float = 60.0,
    seed: int = 0,
    weight: tuple[str, float] | None = None,
) -> SimulatedSession:
    """Write recordings of a virtual person, to try `excite human` without a laboratory.

    Segments, joint centres and marker places differ from the tables' by chance; soft tissue, cameras and plates
    have the errors that are published of real ones. The person swings arms, trunk, head and legs, and squats.

    Args:
        out: folder for ``standing.trc``, ``moving.trc``, ``moving.mot``, and with a weight ``wearing.trc`` and
            ``wearing.mot``; made if it is not there.
        subject: mass, height and sex; the segments add up to this mass.
        seconds: of exercise, 10 to 600.
        seed: of person, exercise and noise.
        weight: segment and mass [kg] of a weight worn at the segment's middle while the exercise is done again.

    Returns:
        The files, and the true masses, to be looked at afterwards.

    Raises:
        InputError: absurd seconds or mass of the weight.
        UnknownNameError: no such segment.
    """
    check_number(seconds, "seconds", *_SECONDS, "s")
    if weight is not None:
        if weight[0] not in NAMES:
            raise UnknownNameError("segment", str(weight[0])[:60], list(NAMES))
        check_number(weight[1], "weight", *_WEIGHT_KG, "kg")
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    who = draw_subject(rng, subject)
    show = perform_exercise(who.body, seconds, seed=seed)
    moving = record_performance(who, show, rng)
    still = write_trc(record_standing(who, rng), out / "standing.trc")
    trial = (write_trc(moving, out / "moving.trc"), write_mot(moving, out / "moving.mot"))
    again: tuple[Path, ...] = ()
    if weight is not None:
        place = segment_box(who.body, NAMES.index(weight[0])).mean(axis=0)
        belt = Belt(weight[0], weight[1], tuple(place.tolist()))
        worn = record_performance(who, repeat_exercise(who.body, show, rng), rng, belt)
        again = (write_trc(worn, out / "wearing.trc"), write_mot(worn, out / "wearing.mot"))
    masses = {name: part.mass for name, part in zip(NAMES, who.body.inertias, strict=True)}
    return SimulatedSession((still,), trial, again, masses)


def pose_of(base: np.ndarray, angles: np.ndarray) -> Pose:
    """Postures from the pelvis' pose ``(n, 7)`` (x y z [m], qx qy qz qw) and joint angles ``(n, 34)`` [rad]."""
    n = len(base)
    rotation = np.tile(np.eye(3), (n, N_SEGMENTS, 1, 1))
    rotation[:, 0] = Rotation.from_quat(base[:, 3:]).as_matrix()
    column = 0
    for k, segment in enumerate(SEGMENTS):
        for axis in segment.axes:
            turn = np.outer(angles[:, column], np.eye(3)[axis.index] * axis.sign)
            rotation[:, k] = rotation[:, k] @ Rotation.from_rotvec(turn).as_matrix()
            column += 1
        rotation[:, k] = rotation[:, k] @ frame_turn(k)
    return Pose(base[:, :3].copy(), rotation)


def _write_storage(columns: Mapping[str, Array], path: Path) -> None:
    """Write columns, ``(n,)`` each, with tabs between them below a header, as OpenSim does."""
    rows = np.column_stack(list(columns.values())).tolist()
    lines = ["forces", f"nRows={len(rows)}", f"nColumns={len(columns)}", "endheader", "\t".join(columns)]
    lines += ["\t".join(format(value, ".6f") for value in row) for row in rows]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
