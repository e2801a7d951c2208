"""Force plates: their readings, their moments about the ground, the ground reaction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from excite.arrays import Array
from excite.errors import LogError
from excite.finding import Finding
from excite.human.body import Body
from excite.human.recording import PlateRecording, Recording
from excite.human.segments import NAMES, SIDES
from excite.human.skeleton import Placement
from excite.human.trial_poses import runs_of
from excite.identification.judgement.judgement import ChannelFit, channel_fit
from excite.logs.log import Log
from excite.logs.robot import robot_in_log
from excite.logs.signals.butterworth import central_differences, lowpass, settling_samples
from excite.regressor.kernels import base_link_regressor
from excite.robot.robot import Robot
from excite.rows.kinematics import forces_on_grid, trial_kinematics
from excite.rows.settings import ProblemSettings

# Plates whose channels and places do not belong together.

NEAR, FAR = 0.15, 0.25
"""A foot that stands on a plate has the centre of pressure below it; both are good to a few centimetres [m]."""


def unswapped_plates(
    plates: list[PlateRecording], feet: dict[str, Array], height: float, source: Path
) -> tuple[list[PlateRecording], list[Finding]]:
    """Plates with each other's places where that brings the centres of pressure under the feet, and a finding.

    Args:
        plates: loaded plates in a world with z up.
        feet: heel and toe of either foot over time, ``(n, 2, 3)``.
        height: of the ground [m].
        source: of the recording.
    """
    worst = max(typical_miss(plate, feet, height) for plate in plates)
    placed = [plate for plate in plates if plate.corners is not None]
    if worst < NEAR or len(placed) < len(plates) or not 2 <= len(plates) <= 4:
        return plates, []
    best, best_miss, order = plates, worst, tuple(range(len(plates)))
    for chosen in permutations(range(len(plates))):
        moved = [_move_plate(plates[i], plates[j]) for i, j in enumerate(chosen)]
        miss = max(typical_miss(plate, feet, height) for plate in moved)
        if miss < best_miss:
            best, best_miss, order = moved, miss, chosen
    if best_miss > 0.5 * worst or best_miss > FAR:
        return plates, []
    names = tuple(plates[i].name for i, j in enumerate(order) if i != j)
    text = (
        f"{source.name}: {' and '.join(names)} are swapped: their forces act {100 * worst:.0f} cm from any "
        f"foot, and {100 * best_miss:.0f} cm with each other's place; put back"
    )
    return best, [Finding("swapped_plates", text, {"miss_m": worst, "mended_m": best_miss}, names)]


def _move_plate(plate: PlateRecording, other: PlateRecording) -> PlateRecording:
    """A plate's reading at another plate's pose."""
    if plate.corners is None or other.corners is None:
        return plate
    here, there = _plate_pose(plate.corners), _plate_pose(other.corners)
    turn = there[0] @ here[0].T
    local = plate.moment - np.cross(here[1], plate.force)
    force, moment = plate.force @ turn.T, local @ turn.T
    return replace(plate, force=force, moment=moment + np.cross(there[1], force), corners=other.corners)


def _plate_pose(corners: Array) -> tuple[Array, Array]:
    """Rotation and centre of a plate; x and y along its edges, as C3D counts its corners."""
    x = corners[0] + corners[3] - corners[1] - corners[2]
    y = corners[0] + corners[1] - corners[2] - corners[3]
    z = np.cross(x, y)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z]), corners.mean(axis=0)


# Centres of pressure, and how far from the feet they lie.

LOADED_N = 50.0
"""Vertical force above which a centre of pressure means something [N]."""


def pressure_center(force: Array, moment: Array, height: float) -> Array:
    """Where a force acts on the plane ``z = height``, ``(n, 3)``; NaN where it is not loaded.

    Args:
        force: ``(n, 3)`` [N].
        moment: about the world's origin ``(n, 3)`` [N·m].
        height: of the plane [m].
    """
    vertical = np.where(force[:, 2] > LOADED_N, force[:, 2], np.nan)
    x = (-moment[:, 1] + height * force[:, 0]) / vertical
    y = (moment[:, 0] + height * force[:, 1]) / vertical
    return np.column_stack([x, y, np.full(len(force), height)])


def foot_line(placement: Placement, side: str, body: Body) -> Array:
    """Heel and toe of a foot over time, ``(n, 2, 3)``."""
    k = NAMES.index(f"{side}_foot")
    d = body.dimensions
    front = d.foot_length - d.heel
    ends = np.array([[-d.heel, 0.0, -d.ankle_height], [front, 0.0, -d.ankle_height]])
    return placement.origin[:, k, None] + np.einsum("nij,ej->nei", placement.rotation[:, k], ends)


def foot_distances(plate: PlateRecording, feet: dict[str, Array], height: float) -> dict[str, Array]:
    """Horizontal distance of the centre of pressure from each foot's line, ``(n,)``, NaN where not loaded."""
    point = pressure_center(plate.force, plate.moment, height)[:, :2]
    found = {}
    for side, line in feet.items():
        heel, toe = line[:, 0, :2], line[:, 1, :2]
        along = toe - heel
        share = np.einsum("ni,ni->n", point - heel, along) / np.maximum((along**2).sum(axis=1), 1e-6)
        nearest = heel + np.clip(share, 0.0, 1.0)[:, None] * along
        found[side] = np.linalg.norm(point - nearest, axis=1)
    return found


def typical_miss(plate: PlateRecording, feet: dict[str, Array], height: float) -> float:
    """Typical distance of the centre of pressure from the nearer foot [m]."""
    nearest = np.minimum(*foot_distances(plate, feet, height).values())
    return float(np.nanmedian(nearest)) if np.isfinite(nearest).any() else 0.0


# Force plates: readings at the markers' times, which foot stands where, and whether they can be true.

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
    choices = [
        (1.0, *_FORCE_UNITS) if has_load else (1.0,)
        for has_load in np.abs(vertical).max(axis=0) > 1e-3 * _UNLOADED_N
    ]
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


# Ground reaction as the plates measured it and as two models predict it: table III and figures 8 and 9 of
# Jovic et al., T-RO 2016.

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
UNITS = ("N", "N", "N", "N·m", "N·m", "N·m")
_NAMES = {**{f"f{a}": f"GRF {a}" for a in "xyz"}, **{f"t{a}": f"GRFM {a}" for a in "xyz"}}


@dataclass(frozen=True, eq=False)
class GroundReaction:
    """One trial; forces [N] and moments [N·m] in the world's axes (z up), moments about ``point``.

    Attributes:
        trial: its name.
        role: identification or validation.
        time: ``(n,)`` [s].
        point: on the ground below the pelvis, at the mean of the trial ``(3,)`` [m].
        measured: ``(n, 6)``.
        nominal: by the nominal model, ``(n, 6)``.
        identified: by the identified model, ``(n, 6)``.
    """

    trial: str
    role: str
    time: Array
    point: Array
    measured: Array
    nominal: Array
    identified: Array


def ground_reactions(
    robot: Robot, log: Log, identified: Array, settings: ProblemSettings | None = None
) -> tuple[GroundReaction, ...]:
    """Ground reaction of every trial of a log, filtered as for identification, ends without the filter's transient.

    Args:
        robot: the person's model, whose own parameters are the nominal ones.
        log: trials on force plates.
        identified: identified parameters ``(10·n_segments,)``.
        settings: filters; defaults if None.

    Raises:
        LogError: a trial is too short for the filter.
    """
    settings = settings or ProblemSettings()
    filters = settings.filters(floating=True, lowpass_hz=log.header.lowpass_hz)
    inside = robot_in_log(robot, log.header, log.folder)
    places = {sensor.name: np.asarray(sensor.placement.translation) for sensor in inside.sensors}
    models = np.column_stack([inside.nominal_parameters, identified])
    found = []
    for trial in log.trials:
        k = trial_kinematics(inside, log.header, trial, settings, filters)
        point = np.append(k.q[:, :2].mean(axis=0), min(place[2] for place in places.values()))
        measured = np.zeros((len(k.time), 6))
        for name, values in trial.wrenches.items():
            measured += _move_moment(forces_on_grid(trial.time, values, k.time), places[name] - point)
        at_base = base_link_regressor(inside.model, k.q, k.v, k.a) @ models
        curves = [measured, *(_in_world(at_base[:, :, i], k.q, point) for i in range(2))]
        edge = settling_samples(k.rate_hz, filters.cutoff_hz)
        use = k.valid.copy()
        use[:edge] = use[len(use) - edge :] = False
        if not use.any():
            raise LogError("is too short for the filter", source=trial.name, remedy="record longer")
        filtered = [lowpass(curve, k.rate_hz, filters.cutoff_hz, filters.order)[use] for curve in curves]
        found.append(GroundReaction(trial.name, str(trial.role), k.time[use], point, *filtered))
    return tuple(found)


def _move_moment(wrench: Array, lever: Array) -> Array:
    return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross(lever, wrench[:, :3])])


def _in_world(wrench: Array, q: Array, point: Array) -> Array:
    """A wrench about the base in its axes, in the world's axes about ``point``."""
    turn = Rotation.from_quat(q[:, 3:7])
    force, moment = turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])
    return np.hstack([force, moment + np.cross(q[:, :3] - point, force)])


@dataclass(frozen=True)
class ReactionTable:
    """RMSE and Pearson's correlation of the ground reaction, nominal and identified, by role of the trials.

    Attributes:
        fits: by role, then by component.
    """

    fits: dict[str, dict[str, ChannelFit]]

    @classmethod
    def of(cls, reactions: Sequence[GroundReaction]) -> ReactionTable:
        """All trials of a role together."""
        fits: dict[str, dict[str, ChannelFit]] = {}
        for role in dict.fromkeys(reaction.role for reaction in reactions):
            own = [reaction for reaction in reactions if reaction.role == role]
            measured, nominal, identified = (
                np.vstack([getattr(reaction, name) for reaction in own])
                for name in ("measured", "nominal", "identified")
            )
            fits[role] = {
                axis: channel_fit(UNITS[i], measured[:, i], identified[:, i], nominal[:, i])
                for i, axis in enumerate(AXES)
            }
        return cls(fits)

    def summary(self) -> str:
        """The table in words, for a terminal."""
        lines = []
        for role, fits in self.fits.items():
            lines.append(f"ground reaction, {role} trials, RMSE (correlation), world axes:")
            lines.append(f"  {'':8}{'identified':>20}{'nominal':>20}")
            for axis, fit in fits.items():
                ours = f"{fit.rmse:.2f} {fit.unit} ({_correlation_text(fit.cc)})"
                theirs = f"{fit.reference_rmse:.2f} {fit.unit} ({_correlation_text(fit.reference_cc)})"
                lines.append(f"  {_NAMES[axis]:8}{ours:>20}{theirs:>20}")
        return "\n".join(lines)


def _correlation_text(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


# When the plates carry the whole person, and what mass they say.

_MISSING = 0.35
_SHORTEST_S = 0.1
_MASS_TOLERANCE = 0.05


@dataclass(frozen=True, eq=False)
class Support:
    """What vertical forces say against the weight.

    Attributes:
        frames: the longest span in which the plates carry the whole person.
        mass: from the mean vertical force in it, the change of momentum taken off [kg].
        findings: what was odd.
    """

    frames: slice
    mass: float
    findings: tuple[Finding, ...]


def mass_center(body: Body, placement: Placement) -> Array:
    """Centre of mass of the whole body, ``(n, 3)`` [m]."""
    masses = np.array([inertia.mass for inertia in body.inertias])
    centers = np.stack([inertia.center for inertia in body.inertias])
    points = placement.origin + np.einsum("nkij,kj->nki", placement.rotation, centers)
    return np.einsum("k,nki->ni", masses / masses.sum(), points)


def find_support(
    body: Body, placement: Placement, readings: Sequence[PlateReading], rate_hz: float, source: Path
) -> Support:
    """Find the span in which all contact is on plates, and weigh the person in it.

    Measured vertical force is compared with the weight times one plus the acceleration of the centre of mass;
    where much is missing for longer than a tenth of a second a foot stands beside the plates.

    Raises:
        LogError: at no time do the plates carry the person, or the forces are not in newtons.
    """
    center = mass_center(body, placement)
    cutoff = min(6.0, 0.2 * rate_hz)
    if len(center) > settling_samples(rate_hz, cutoff):
        center = lowpass(center, rate_hz, cutoff, 3)
    motion = central_differences(center, rate_hz)
    weight = body.subject.mass * GRAVITY
    vertical = np.sum([reading.force[:, 2] for reading in readings], axis=0)
    expected = body.subject.mass * (GRAVITY + motion.second[:, 2])
    typical = float(np.median(vertical[expected > 0.5 * weight])) if (expected > 0.5 * weight).any() else 0.0
    if not 0.05 * weight < typical < 20.0 * weight:
        raise LogError(
            f"vertical forces are {typical:.4g} N where the person weighs {weight:.0f} N ({_largest(readings)})",
            source=source,
            field="force plates",
            remedy="check the plates' gains and the person's mass in kilograms: no unit of force makes them agree",
        )
    short = expected - vertical > _MISSING * weight
    carried = _without_short_runs(~short, round(_SHORTEST_S * rate_hz))
    span = _longest_run(carried)
    if span is None:
        raise LogError(
            "the plates carry the person at no time",
            source=source,
            field="force plates",
            remedy="both feet have to stand on plates",
        )
    findings = []
    if span.stop - span.start < len(carried):
        text = (
            f"{source.name}: plates carry the whole person from frame {span.start} to {span.stop} of "
            f"{len(carried)} only; the rest is left out"
        )
        findings.append(Finding("unlogged_contact", text, {"share": float(np.mean(carried))}))
    duration = (span.stop - span.start - 1) / rate_hz
    gained = motion.first[span.stop - 1, 2] - motion.first[span.start, 2]
    mass = float(vertical[span].mean() / (GRAVITY + gained / max(duration, 1e-9)))
    share = mass / body.subject.mass - 1.0
    if abs(share) > _MASS_TOLERANCE:
        text = (
            f"{source.name}: the plates say {mass:.1f} kg, the person weighs {body.subject.mass:.1f} kg "
            f"({100 * share:+.1f} %): check gains, zeros, and what is worn"
        )
        findings.append(Finding("mass", text, {"plates_kg": mass, "given_kg": body.subject.mass}))
    return Support(span, mass, tuple(findings))


def _largest(readings: Sequence[PlateReading]) -> str:
    return ", ".join(f"{one.name} at most {one.force[:, 2].max():.4g}" for one in readings)


def _without_short_runs(flags: NDArray[np.bool_], shortest: int) -> NDArray[np.bool_]:
    """Runs of False shorter than ``shortest`` become True."""
    flags = flags.copy()
    for start, stop in runs_of(~flags):
        if stop - start < shortest:
            flags[start:stop] = True
    return flags


def _longest_run(flags: NDArray[np.bool_]) -> slice | None:
    runs = runs_of(flags)
    return slice(*max(runs, key=lambda run: run[1] - run[0])) if runs else None
