"""A virtual motion laboratory: what cameras and two force plates say of a virtual person; truth from pinocchio.

Levels: cameras 0.5 mm (Windolf et al. 2008: 0.06-0.5 mm), plates 1.5 N and 0.3 N·m, zero off by 2 N (Kistler 9281:
threshold 0.01 N, drift 0.01 N/s).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.human.markers.marker_set import read_marker_set
from excite.human.posture.joint_angles import pose_of
from excite.human.posture.skeleton import Placement, place_segments
from excite.human.recording import PlateRecording, Recording
from excite.human.segments import JOINT_NAMES, NAMES, PARENTS, SEGMENTS
from excite.human.virtual.exercise import Performance, balance_pelvis
from excite.human.virtual.person import MARKERS, Belt, VirtualSubject, true_model

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
