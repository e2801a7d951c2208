"""Force plates: readings at the markers' times, which foot stands where, and whether they can be true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
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
# What else than newtons forces are exported in, and by what moments are off that are not in the file's unit.
_FORCE_UNITS = {4.4482216152605: "pounds-force", 9.80665: "kilograms-force", 1e3: "kilonewtons"}
_LEVER_UNITS = {
    1e3: "N·m where the file's unit makes them N·mm",
    1e-3: "N·mm where the file's unit makes them N·m",
}
# Share of the frames in which plates carry the weight, within a third as in walking, that a unit has to bring.
_BROUGHT, _ABOUT = 0.25, 0.3
# The centre of pressure of somebody who stands still moves by some millimetres: by less it moves under nobody [m].
_LEAST_SWAY = 5e-4
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
    turned, signs = _turn_upward(list(recording.plates), source)
    in_newtons, forces = _in_newtons(turned, body.subject.mass * GRAVITY, source)
    for plate in in_newtons:
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
    ground = _ground_height(plates)
    read = [_at_times(plate, recording.time, cutoff_hz, source) for plate in plates]
    feet = {side: foot_line(placement, side, body) for side in SIDES}
    read, units = _in_metres(read, feet, ground, source)
    read, moments = _in_newton_metres(read, feet, ground, source)
    read, swaps = unswapped_plates(read, feet, ground, source)
    readings, sides = _assign_feet(read, feet, ground, source)
    return readings, (*findings, *signs, *forces, *units, *moments, *swaps, *sides)


def _turn_upward(plates: list[PlateRecording], source: Path) -> tuple[list[PlateRecording], list[Finding]]:
    """Plates whose vertical forces point up: nobody pulls at a plate."""
    vertical = [plate.force[:, 2] for plate in plates]
    down = [float((force * np.abs(force)).sum()) < 0.0 for force in vertical]
    down = [is_down and np.abs(f).max() > _UNLOADED_N for is_down, f in zip(down, vertical, strict=True)]
    names = tuple(plate.name for plate, is_down in zip(plates, down, strict=True) if is_down)
    if not names:
        return plates, []
    text = (
        f"{source.name}: vertical forces of {' and '.join(names)} point down: they are those on the plates; turned "
        "round"
    )
    mean = sum(float(force.mean()) for force, is_down in zip(vertical, down, strict=True) if is_down)
    turned = [
        replace(plate, force=-plate.force, moment=-plate.moment) if is_down else plate
        for plate, is_down in zip(plates, down, strict=True)
    ]
    return turned, [Finding("reaction_sign", text, {"mean_n": mean}, names)]


def _in_newtons(
    plates: list[PlateRecording], weight: float, source: Path
) -> tuple[list[PlateRecording], list[Finding]]:
    """Plates in newtons: in the units, one for each plate, in which they carry the person's weight [N]."""
    rows = min((len(plate.force) for plate in plates), default=0)
    if not rows or len({len(plate.force) for plate in plates}) > 1:
        return plates, []
    vertical = np.column_stack([plate.force[:, 2] for plate in plates])
    loaded = np.abs(vertical).max(axis=0) > 1e-3 * _UNLOADED_N
    choices = [(1.0, *_FORCE_UNITS) if has_load else (1.0,) for has_load in loaded]
    mixed = product(*choices) if len(plates) <= 4 else ((one,) * len(plates) for one in choices[0])
    factors = np.array(list(mixed))
    carried = np.abs(factors @ vertical.T - weight) < _ABOUT * weight
    share = carried.mean(axis=1)
    best = int(np.argmax(share))
    if share[best] - share[0] < _BROUGHT:
        return plates, []
    found, scaled = [], []
    for plate, factor in zip(plates, factors[best], strict=True):
        scaled.append(replace(plate, force=factor * plate.force, moment=factor * plate.moment))
        if factor != 1.0:
            text = (
                f"{source.name}: forces of {plate.name} are {_FORCE_UNITS[factor]}, in which the plates carry the "
                f"person's {weight:.0f} N in {100 * share[best]:.0f} % of the frames, and as newtons in "
                f"{100 * share[0]:.0f} %; converted"
            )
            found.append(Finding("units", text, {"factor": float(factor)}, (plate.name,)))
    return scaled, found


def _in_newton_metres(
    plates: list[PlateRecording], feet: dict[str, Array], height: float, source: Path
) -> tuple[list[PlateRecording], list[Finding]]:
    """Plates whose centre of pressure moves under a foot: in the unit of moments in which it does."""
    found, read = [], []
    for plate in plates:
        chosen = plate
        if plate.corners is not None and not _is_possible(plate, feet, height):
            levers = {factor: _levered(plate, factor) for factor in _LEVER_UNITS}
            fits = next((f for f, one in levers.items() if _is_possible(one, feet, height)), None)
            sway = 1e3 * _sway(plate, height)
            if fits is not None:
                chosen = levers[fits]
                text = (
                    f"{source.name}: moments of {plate.name} are {_LEVER_UNITS[fits]}: as they stand the centre of "
                    f"pressure moves by {sway:.2g} mm and lies {100 * typical_miss(plate, feet, height):.0f} cm from "
                    f"a foot; converted"
                )
                found.append(Finding("units", text, {"factor": fits}, (plate.name,)))
            elif sway < 1e3 * _LEAST_SWAY:
                text = (
                    f"{source.name}: the centre of pressure of {plate.name} moves by {sway:.2g} mm only: check that "
                    "its moments were recorded, and their unit"
                )
                found.append(Finding("moments", text, {"sway_m": 1e-3 * sway}, (plate.name,)))
        read.append(chosen)
    return read, found


def _is_possible(plate: PlateRecording, feet: dict[str, Array], height: float) -> bool:
    """Whether a centre of pressure lies under a foot and moves, as far as it is loaded."""
    sway = _sway(plate, height)
    return not np.isfinite(sway) or (sway > _LEAST_SWAY and typical_miss(plate, feet, height) < NEAR)


def _sway(plate: PlateRecording, height: float) -> float:
    """Typical distance of the centre of pressure from its middle [m]; NaN where the plate is not loaded."""
    point = pressure_center(plate.force, plate.moment, height)
    point = point[np.isfinite(point[:, 0]), :2]
    if not len(point):
        return float("nan")
    return float(np.median(np.linalg.norm(point - np.median(point, axis=0), axis=1)))


def _levered(plate: PlateRecording, factor: float) -> PlateRecording:
    """The plate with its moments about the middle of its surface times a factor."""
    center = np.zeros(3) if plate.corners is None else plate.corners.mean(axis=0)
    about = np.cross(center, plate.force)
    return replace(plate, moment=about + factor * (plate.moment - about))


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
    """Points of application that are a thousand times too far out, plate by plate."""
    read, names = [], []
    for plate in plates:
        scaled = plate
        if plate.corners is None and typical_miss(plate, feet, height) > 5.0:
            point = np.nan_to_num(pressure_center(plate.force, plate.moment, height))
            free = plate.moment - np.cross(point, plate.force)
            factor = 1e-3 if np.abs(free[:, 2]).max() > _FREE_MOMENT_NM else 1.0
            scaled = replace(plate, moment=np.cross(1e-3 * point, plate.force) + factor * free)
            if typical_miss(scaled, feet, height) > FAR:
                scaled = plate
            else:
                names.append(plate.name)
        read.append(scaled)
    if not names:
        return plates, []
    text = (
        f"{source.name}: points of application of {' and '.join(names)} lie kilometres from the feet: they are "
        "millimetres; converted"
    )
    return read, [Finding("units", text, {"factor": 1e-3}, tuple(names))]


def _assign_feet(
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
        center = _plate_center(plate, height)
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


def _plate_center(plate: PlateRecording, height: float) -> Array:
    if plate.corners is not None:
        return plate.corners.mean(axis=0)
    point = pressure_center(plate.force, plate.moment, height)
    return np.nanmedian(point, axis=0) if np.isfinite(point).any() else np.array([0.0, 0.0, height])
