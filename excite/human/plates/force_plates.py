"""Force plates: readings at the markers' times, which foot stands where, and whether they can be true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding
from excite.human.body import Body
from excite.human.plates.exchanged_plates import FAR, NEAR, unswapped_plates
from excite.human.plates.pressure import foot_distances, foot_line, pressure_center, typical_miss
from excite.human.posture.skeleton import Placement
from excite.human.recording import PlateRecording, Recording
from excite.human.segments import SIDES
from excite.logs.signals.butterworth import lowpass, settling_samples

GRAVITY = 9.81
_UNLOADED_N = 20.0
_FREE_MOMENT_NM = 200.0
_SHARED = 0.15


@dataclass(frozen=True, eq=False)
class PlateReading:
    """A plate at the markers' times.

    Attributes:
        name: of the plate.
        center: of its surface (or of the centres of pressure, where the file does not say), world ``(3,)`` [m].
        force: on the person, world ``(n, 3)`` [N].
        moment: on the person about ``center``, world ``(n, 3)`` [N·m].
        foot: segment that stands on it most.
        distance: RMS distance of the centre of pressure from that foot [m], NaN where it is never loaded.
    """

    name: str
    center: Array
    force: Array
    moment: Array
    foot: str
    distance: float

    @property
    def wrench(self) -> Array:
        """Force and moment, ``(n, 6)``."""
        return np.hstack([self.force, self.moment])


def plate_readings(
    recording: Recording, placement: Placement, body: Body, cutoff_hz: float | None
) -> tuple[tuple[PlateReading, ...], tuple[Finding, ...]]:
    """Readings of all loaded plates at the markers' times, and what is odd about them.

    A wrong sign, points of application in millimetres, feet or plates that are exchanged are put right where
    another reading fits the feet and the weight; everything is named.

    Args:
        recording: plates in a world with z up.
        placement: the segments at the markers' times.
        body: the person.
        cutoff_hz: of the same low-pass that the markers went through (third order, forwards and backwards).

    Raises:
        LogError: no plate carries load, or the centres of pressure lie at neither foot.
    """
    source, findings = recording.source, []
    plates = []
    for plate in recording.plates:
        largest = float(np.linalg.norm(plate.force, axis=1).max())
        if largest < _UNLOADED_N:
            text = f"{source.name}: {plate.name} carries no load (at most {largest:.1f} N); left out"
            findings.append(Finding("no_load", text, {"largest_n": largest}, (plate.name,)))
            continue
        plates.append(plate)
    if not plates:
        raise LogError(
            "no force plate carries load",
            source=source,
            field=", ".join(plate.name for plate in recording.plates) or "plates",
            remedy="check that the amplifiers were on, and that the right channels were exported",
        )
    plates, signs = _upward(plates, source)
    ground = _ground_height(plates)
    read = [_at_times(plate, recording.time, cutoff_hz, source) for plate in plates]
    feet = {side: foot_line(placement, side, body) for side in SIDES}
    read, units = _in_metres(read, feet, ground, source)
    read, swaps = unswapped_plates(read, feet, ground, source)
    readings, sides = _assigned(read, feet, ground, source)
    return readings, (*findings, *signs, *units, *swaps, *sides)


def _upward(plates: list[PlateRecording], source: Path) -> tuple[list[PlateRecording], list[Finding]]:
    total = sum(float(plate.force[:, 2].mean()) for plate in plates)
    if total >= 0.0:
        return plates, []
    text = f"{source.name}: vertical forces point down: they are those on the plates; turned round"
    turned = [replace(plate, force=-plate.force, moment=-plate.moment) for plate in plates]
    return turned, [Finding("reaction_sign", text, {"mean_n": total}, tuple(p.name for p in plates))]


def _ground_height(plates: Sequence[PlateRecording]) -> float:
    heights = [float(plate.corners[:, 2].mean()) for plate in plates if plate.corners is not None]
    return float(np.mean(heights)) if heights else 0.0


def _at_times(plate: PlateRecording, time: Array, cutoff_hz: float | None, source: Path) -> PlateRecording:
    """The plate's reading at other times, filtered against aliasing at least."""
    rate = (len(plate.time) - 1) / float(plate.time[-1] - plate.time[0])
    own = (len(time) - 1) / float(time[-1] - time[0])
    slack = 1.5 / min(rate, own)
    if plate.time[0] > time[0] + slack or plate.time[-1] < time[-1] - slack:
        raise LogError(
            f"forces run from {plate.time[0]:.3f} to {plate.time[-1]:.3f} s, markers from {time[0]:.3f} "
            f"to {time[-1]:.3f} s",
            source=source,
            field=plate.name,
            remedy="cut both to the same time",
        )
    cutoff = 0.4 * own if cutoff_hz is None else cutoff_hz
    values = np.hstack([plate.force, plate.moment])
    if len(values) > settling_samples(rate, cutoff):
        values = lowpass(values, rate, cutoff, 3)
    at = np.column_stack([np.interp(time, plate.time, values[:, i]) for i in range(6)])
    return replace(plate, time=time, force=at[:, :3], moment=at[:, 3:])


def _in_metres(
    plates: list[PlateRecording], feet: dict[str, Array], height: float, source: Path
) -> tuple[list[PlateRecording], list[Finding]]:
    """Points of application that are a thousand times too far out."""
    if max(typical_miss(plate, feet, height) for plate in plates) < 5.0:
        return plates, []
    scaled = []
    for plate in plates:
        point = np.nan_to_num(pressure_center(plate.force, plate.moment, height))
        free = plate.moment - np.cross(point, plate.force)
        factor = 1e-3 if np.abs(free[:, 2]).max() > _FREE_MOMENT_NM else 1.0
        scaled.append(replace(plate, moment=np.cross(1e-3 * point, plate.force) + factor * free))
    if max(typical_miss(plate, feet, height) for plate in scaled) > FAR:
        return plates, []
    text = (
        f"{source.name}: points of application lie kilometres from the feet: they are millimetres; converted"
    )
    return scaled, [Finding("units", text, {"factor": 1e-3}, tuple(plate.name for plate in plates))]


def _assigned(
    plates: list[PlateRecording], feet: dict[str, Array], height: float, source: Path
) -> tuple[tuple[PlateReading, ...], list[Finding]]:
    """Each plate with the foot that stands on it."""
    readings, swapped, findings = [], [], []
    for plate in plates:
        distances = foot_distances(plate, feet, height)
        right, left = distances["right"], distances["left"]
        loaded = np.isfinite(right)
        on_right = bool(np.nansum(right[loaded] < left[loaded]) >= 0.5 * loaded.sum())
        foot = "right" if on_right else "left"
        miss = float(np.sqrt(np.nanmean(distances[foot] ** 2))) if loaded.any() else float("nan")
        typical = float(np.nanmedian(distances[foot])) if loaded.any() else 0.0
        if typical > FAR:
            raise LogError(
                f"its centre of pressure lies {100 * typical:.0f} cm from the nearer foot",
                source=source,
                field=plate.name,
                remedy="check the plate's place, its unit of length, and that markers and forces belong together",
            )
        near = loaded & (np.minimum(right, left) < NEAR)
        weight = plate.force[near, 2]
        share = float(weight[right[near] < left[near]].sum() / max(weight.sum(), 1e-9))
        if _SHARED < share < 1.0 - _SHARED:
            text = f"{source.name}: both feet step on {plate.name} ({100 * share:.0f} % of its load is the right's)"
            findings.append(Finding("shared_plate", text, {"right_share": share}, (plate.name,)))
        if plate.foot is not None and plate.foot != foot:
            swapped.append((plate.name, foot))
        center = _center(plate, height)
        readings.append(
            PlateReading(
                name=plate.name,
                center=center,
                force=plate.force,
                moment=plate.moment - np.cross(center, plate.force),
                foot=f"{foot}_foot",
                distance=miss,
            )
        )
    if swapped:
        names = tuple(name for name, _ in swapped)
        listing = ", ".join(f"{name} lies under the {foot} foot" for name, foot in swapped)
        text = f"{source.name}: left and right plates are swapped: {listing}; assigned by the markers"
        findings.append(Finding("swapped_plates", text, {}, names))
    return tuple(readings), findings


def _center(plate: PlateRecording, height: float) -> Array:
    if plate.corners is not None:
        return plate.corners.mean(axis=0)
    point = pressure_center(plate.force, plate.moment, height)
    return np.nanmedian(point, axis=0) if np.isfinite(point).any() else np.array([0.0, 0.0, height])
