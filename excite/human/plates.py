"""Force plates: their readings, their moments about the ground, the ground reaction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import permutations, product
from pathlib import Path

import numpy as np

from excite.arrays import Array, runs_of
from excite.errors import LogError
from excite.finding import Finding
from excite.human.body import Body
from excite.human.recording import PlateRecording, Recording
from excite.human.segments import NAMES, SIDES
from excite.human.skeleton import Placement
from excite.logs.signals.butterworth import Derivatives, central_differences, lowpass, settling_samples

# Centres of pressure, and how far from the feet they lie.

NEAR, FAR = 0.15, 0.25
"""A foot that stands on a plate has the centre of pressure below it; both are good to a few centimetres [m]."""
GRAVITY = 9.81


def pressure_center(force: Array, moment: Array, height: float) -> Array:
    """Where a force acts on the plane ``z = height``, ``(n, 3)``; NaN where it is not loaded.

    Args:
        force: ``(n, 3)`` [N].
        moment: about the world's origin ``(n, 3)`` [N·m].
        height: of the plane [m].
    """
    # Vertical force above which a centre of pressure means something [N].
    vertical = np.where(force[:, 2] > 50.0, force[:, 2], np.nan)
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


# Force plates: readings at the markers' times, which foot stands where, and whether they can be true.

_UNLOADED_N = 20.0
# What else than newtons forces are exported in, and by what moments are off that are not in the file's unit.
_FORCE_UNITS = {4.4482216152605: "pounds-force", 9.80665: "kilograms-force", 1e3: "kilonewtons"}
_LEVER_UNITS = {
    1e3: "N·m where the file's unit makes them N·mm",
    1e-3: "N·mm where the file's unit makes them N·m",
}
# The centre of pressure of somebody who stands still moves by some millimetres: by less it moves under nobody [m].
_LEAST_SWAY = 5e-4
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
    feet = {side: foot_line(placement, side, body) for side in SIDES}
    judged = _Plates(recording.source, list(recording.plates), feet)
    judged.turn_upward()
    judged.convert_forces(body.subject.mass * GRAVITY)
    judged.leave_out_unloaded()
    judged.plates = [_at_times(plate, recording.time, cutoff_hz, recording.source) for plate in judged.plates]
    judged.plates = [judged.in_metres(plate) for plate in judged.plates]
    rate = (len(recording.time) - 1) / float(recording.time[-1] - recording.time[0])
    judged.turn_about_vertical(body.subject.mass, motion_of_center(body, placement, rate).second)
    judged.exchange_places()
    return judged.assign_feet(), tuple(judged.findings)


@dataclass(eq=False)
class _Plates:
    """Plates of a recording as they are judged, one fault after the other.

    Attributes:
        source: of the recording.
        plates: in a world with z up, as far as they are put right.
        feet: heel and toe of either foot over time, ``(n, 2, 3)``.
        findings: what was wrong so far.
    """

    source: Path
    plates: list[PlateRecording]
    feet: dict[str, Array]
    findings: list[Finding] = field(default_factory=list)

    def add_finding(self, kind: str, text: str, values: dict[str, float], *names: str) -> None:
        """Add a finding."""
        self.findings.append(Finding(kind, f"{self.source.name}: {text}", values, names))

    @cached_property
    def ground_height(self) -> float:
        """Height of the plates' surfaces [m]."""
        heights = [float(plate.corners[:, 2].mean()) for plate in self.plates if plate.corners is not None]
        return float(np.mean(heights)) if heights else 0.0

    def turn_upward(self) -> None:
        """Turn plates whose vertical forces point down: nobody pulls at a plate."""
        mean, names = 0.0, []
        for i, plate in enumerate(self.plates):
            vertical = plate.force[:, 2]
            if np.abs(vertical).max() > _UNLOADED_N and (vertical * np.abs(vertical)).sum() < 0.0:
                self.plates[i] = replace(plate, force=-plate.force, moment=-plate.moment)
                mean += float(vertical.mean())
                names.append(plate.name)
        if names:
            text = f"vertical forces of {' and '.join(names)} point down: they are those on the plates; turned round"
            self.add_finding("reaction_sign", text, {"mean_n": mean}, *names)

    def convert_forces(self, weight: float) -> None:
        """Forces in newtons: of the units, one for each plate, that in which they carry the person's weight [N]."""
        if len({len(plate.force) for plate in self.plates}) != 1 or not len(self.plates[0].force):
            return
        vertical = np.column_stack([plate.force[:, 2] for plate in self.plates])
        has_load = np.abs(vertical).max(axis=0) > 1e-3 * _UNLOADED_N
        units = (1.0, *_FORCE_UNITS)
        choices = [units if one else units[:1] for one in has_load]
        few = len(choices) <= 4
        factors = np.array(list(product(*choices)) if few else [(one,) * len(choices) for one in choices[0]])
        # Share of the frames in which plates carry the weight, within a third as in walking, that a unit has to bring.
        share = (np.abs(factors @ vertical.T - weight) < 0.3 * weight).mean(axis=1)
        best = int(np.argmax(share))
        if share[best] - share[0] < 0.25:
            return
        for i, factor in enumerate(factors[best].tolist()):
            plate = self.plates[i]
            self.plates[i] = replace(plate, force=factor * plate.force, moment=factor * plate.moment)
            if factor != 1.0:
                text = (
                    f"forces of {plate.name} are {_FORCE_UNITS[factor]}, in which the plates carry the person's "
                    f"{weight:.0f} N in {100 * share[best]:.0f} % of the frames, and as newtons in "
                    f"{100 * share[0]:.0f} %; converted"
                )
                self.add_finding("units", text, {"factor": factor}, plate.name)

    def leave_out_unloaded(self) -> None:
        """Leave out plates that nobody stands on; raises LogError where none is left."""
        every, self.plates = self.plates, []
        for plate in every:
            largest = float(np.linalg.norm(plate.force, axis=1).max())
            if largest < _UNLOADED_N:
                text = f"{plate.name} carries no load (at most {largest:.1f} N); left out"
                self.add_finding("no_load", text, {"largest_n": largest}, plate.name)
            else:
                self.plates.append(plate)
        if not self.plates:
            raise LogError(
                "no force plate carries load",
                source=self.source,
                field=", ".join(plate.name for plate in every) or "plates",
                remedy="check that the amplifiers were on, and that the right channels were exported",
            )

    def foot_distances(self, plate: PlateRecording) -> dict[str, Array]:
        """Horizontal distance of the centre of pressure from each foot's line, ``(n,)``, NaN where not loaded."""
        point = pressure_center(plate.force, plate.moment, self.ground_height)[:, :2]
        found = {}
        for side, line in self.feet.items():
            heel, toe = line[:, 0, :2], line[:, 1, :2]
            along = toe - heel
            share = np.einsum("ni,ni->n", point - heel, along) / np.maximum((along**2).sum(axis=1), 1e-6)
            found[side] = np.linalg.norm(point - heel - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1)
        return found

    def typical_miss(self, plate: PlateRecording) -> float:
        """Typical distance of the centre of pressure from the nearer foot [m]."""
        nearest = np.minimum(*self.foot_distances(plate).values())
        return float(np.nanmedian(nearest)) if np.isfinite(nearest).any() else 0.0

    def typical_sway(self, plate: PlateRecording) -> float:
        """Typical distance of the centre of pressure from its middle [m]; NaN where the plate is not loaded."""
        point = pressure_center(plate.force, plate.moment, self.ground_height)[:, :2]
        point = point[np.isfinite(point[:, 0])]
        if not len(point):
            return float("nan")
        return float(np.median(np.linalg.norm(point - np.median(point, axis=0), axis=1)))

    def is_possible(self, plate: PlateRecording) -> bool:
        """Whether a centre of pressure lies under a foot and moves, as far as it is loaded."""
        sway = self.typical_sway(plate)
        return not np.isfinite(sway) or (sway > _LEAST_SWAY and self.typical_miss(plate) < NEAR)

    def in_metres(self, plate: PlateRecording) -> PlateRecording:
        """The plate in the unit of length of its moments in which its centre of pressure moves under a foot."""
        if self.is_possible(plate):
            return plate
        miss, sway = self.typical_miss(plate), self.typical_sway(plate)
        if plate.corners is None:
            point = np.nan_to_num(pressure_center(plate.force, plate.moment, self.ground_height))
            free = plate.moment - np.cross(point, plate.force)
            # A free moment of a foot is a few N·m.
            factor = 1e-3 if np.abs(free[:, 2]).max() > 200.0 else 1.0
            scaled = replace(plate, moment=np.cross(1e-3 * point, plate.force) + factor * free)
            if miss > 5.0 and self.typical_miss(scaled) <= FAR:
                text = (
                    f"points of application of {plate.name} lie kilometres from the feet: they are millimetres; "
                    "converted"
                )
                self.add_finding("units", text, {"factor": 1e-3}, plate.name)
                return scaled
        # Moments are about the laboratory's origin where the file has no plate's place.
        middle = np.zeros(3) if plate.corners is None else plate.corners.mean(axis=0)
        about = np.cross(middle, plate.force)
        for factor, unit in _LEVER_UNITS.items():
            scaled = replace(plate, moment=about + factor * (plate.moment - about))
            if self.is_possible(scaled):
                text = (
                    f"moments of {plate.name} are {unit}: as they stand the centre of pressure moves by "
                    f"{1e3 * sway:.2g} mm and lies {100 * miss:.0f} cm from a foot; converted"
                )
                self.add_finding("units", text, {"factor": factor}, plate.name)
                return scaled
        if sway < _LEAST_SWAY:
            text = (
                f"the centre of pressure of {plate.name} moves by {1e3 * sway:.2g} mm only: check that its moments "
                "were recorded, and their unit"
            )
            self.add_finding("moments", text, {"sway_m": sway}, plate.name)
        return plate

    def turn_about_vertical(self, mass: float, acceleration: Array) -> None:
        """Turn plates by quarters about the vertical where horizontal forces then accelerate the person as he moves.

        Plates with a place turn about their middle each, all of them about the laboratory's origin too.

        Args:
            mass: of the person [kg].
            acceleration: of the centre of mass, ``(n, 3)`` [m/s²].
        """
        own, origin = self.plates, np.zeros(3)
        if len(own) > 3:
            return
        middles = [origin if one.corners is None else one.corners.mean(axis=0) for one in own]
        carried = sum(one.force[:, 2] for one in own) > 0.7 * mass * (GRAVITY + acceleration[:, 2])
        least, mended, chosen = np.inf, own, (0,) * len(own)
        for turns, about in (
            *((turns, middles) for turns in product(range(4), repeat=len(own))),
            *(((k,) * len(own), [origin] * len(own)) for k in (1, 2, 3)),
        ):
            plates = [_turn_plate(*one) for one in zip(own, turns, about, strict=True)]
            rest = np.sum([one.force for one in plates], axis=0) - mass * acceleration
            left = float((rest[carried, :2] ** 2).sum())
            if not any(turns):
                least, first, miss = left, left, max(NEAR, *map(self.typical_miss, plates))
            elif left < min(least, 0.5 * first) and max(map(self.typical_miss, plates)) < miss:
                least, mended, chosen = left, plates, turns
        for plate, k in zip(own, chosen, strict=True):
            if k:
                text = (
                    f"{plate.name} is turned about the vertical: as it stands the plates' horizontal forces miss what "
                    f"moves the person by {np.sqrt(first / least):.2g} times as much; turned by {90 * k}°"
                )
                self.add_finding("turned_plate", text, {"angle_rad": 0.5 * np.pi * k}, plate.name)
        self.plates = mended

    def exchange_places(self) -> None:
        """Give plates each other's places where that brings the centres of pressure under the feet."""
        own, worst = self.plates, max(map(self.typical_miss, self.plates))
        if worst < NEAR or any(one.corners is None for one in own) or not 2 <= len(own) <= 4:
            return
        orders = list(permutations(range(len(own))))
        moved = [[_move_plate(own[i], own[j]) for i, j in enumerate(order)] for order in orders]
        misses = [max(map(self.typical_miss, plates)) for plates in moved]
        best = int(np.argmin(misses))
        if misses[best] > 0.5 * worst or misses[best] > FAR:
            return
        self.plates = moved[best]
        names = [own[i].name for i, j in enumerate(orders[best]) if i != j]
        text = (
            f"{' and '.join(names)} are swapped: their forces act {100 * worst:.0f} cm from any "
            f"foot, and {100 * misses[best]:.0f} cm with each other's place; put back"
        )
        self.add_finding("swapped_plates", text, {"miss_m": worst, "mended_m": misses[best]}, *names)

    def assign_feet(self) -> tuple[PlateReading, ...]:
        """Each plate with the foot that stands on it; raises LogError where none does."""
        readings, swapped = [], {}
        for plate in self.plates:
            distances = self.foot_distances(plate)
            right, left = distances["right"], distances["left"]
            loaded = np.isfinite(right)
            foot = "right" if np.nansum(right[loaded] < left[loaded]) >= 0.5 * loaded.sum() else "left"
            own = distances[foot][loaded]
            typical, rms = (np.median(own), np.sqrt(np.mean(own**2))) if len(own) else (0.0, np.nan)
            if typical > FAR:
                raise LogError(
                    f"its centre of pressure lies {100 * typical:.0f} cm from the nearer foot",
                    source=self.source,
                    field=plate.name,
                    remedy="check the plate's place, its unit of length, and that markers and forces belong together",
                )
            near = loaded & (np.minimum(right, left) < NEAR)
            weight = plate.force[near, 2]
            share = float(weight[right[near] < left[near]].sum() / max(weight.sum(), 1e-9))
            if _SHARED < share < 1.0 - _SHARED:
                text = f"both feet step on {plate.name} ({100 * share:.0f} % of its load is the right's)"
                self.add_finding("shared_plate", text, {"right_share": share}, plate.name)
            if plate.foot not in (None, foot):
                swapped[plate.name] = foot
            center = self.plate_center(plate)
            moment = plate.moment - np.cross(center, plate.force)
            readings.append(PlateReading(plate.name, center, plate.force, moment, f"{foot}_foot", float(rms)))
        if swapped:
            listing = ", ".join(f"{name} lies under the {foot} foot" for name, foot in swapped.items())
            text = f"left and right plates are swapped: {listing}; assigned by the markers"
            self.add_finding("swapped_plates", text, {}, *swapped)
        return tuple(readings)

    def plate_center(self, plate: PlateRecording) -> Array:
        """Of its surface, or of the centres of pressure ``(3,)`` [m]."""
        if plate.corners is not None:
            return plate.corners.mean(axis=0)
        point = pressure_center(plate.force, plate.moment, self.ground_height)
        return (
            np.nanmedian(point, axis=0)
            if np.isfinite(point).any()
            else np.array([0.0, 0.0, self.ground_height])
        )


def _turn_plate(plate: PlateRecording, quarters: int, about: Array) -> PlateRecording:
    """A plate's reading turned by quarters about a vertical line; its place stays."""
    turn = np.linalg.matrix_power(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), quarters)
    moment = (plate.moment - np.cross(about, plate.force)) @ turn.T
    force = plate.force @ turn.T
    return replace(plate, force=force, moment=moment + np.cross(about, force))


def _move_plate(plate: PlateRecording, other: PlateRecording) -> PlateRecording:
    """A plate's reading at another plate's pose."""
    here, there = _plate_pose(plate), _plate_pose(other)
    turn = there[0] @ here[0].T
    local = plate.moment - np.cross(here[1], plate.force)
    force, moment = plate.force @ turn.T, local @ turn.T
    return replace(plate, force=force, moment=moment + np.cross(there[1], force), corners=other.corners)


def _plate_pose(plate: PlateRecording) -> tuple[Array, Array]:
    """Rotation and centre of a plate; x and y along its edges, as C3D counts its corners."""
    corners = np.asarray(plate.corners)
    x = corners[0] + corners[3] - corners[1] - corners[2]
    y = corners[0] + corners[1] - corners[2] - corners[3]
    z = np.cross(x, y)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z]), corners.mean(axis=0)


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
    at = np.column_stack([np.interp(time, plate.time, column) for column in values.T])
    return replace(plate, time=time, force=at[:, :3], moment=at[:, 3:])


# When the plates carry the whole person, and what mass they say.


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
    centers = np.stack([inertia.lever for inertia in body.inertias])
    points = placement.origin + np.einsum("nkij,kj->nki", placement.rotation, centers)
    return np.einsum("k,nki->ni", masses / masses.sum(), points)


def motion_of_center(body: Body, placement: Placement, rate_hz: float) -> Derivatives:
    """Velocity and acceleration of the whole body's centre of mass, ``(n, 3)`` each [m/s, m/s²]."""
    center, cutoff = mass_center(body, placement), min(6.0, 0.2 * rate_hz)
    if len(center) > settling_samples(rate_hz, cutoff):
        center = lowpass(center, rate_hz, cutoff, 3)
    return central_differences(center, rate_hz)


def find_support(
    body: Body, placement: Placement, readings: Sequence[PlateReading], rate_hz: float, source: Path
) -> Support:
    """Find the span in which all contact is on plates, and weigh the person in it.

    Measured vertical force is compared with the weight times one plus the acceleration of the centre of mass;
    where much is missing for longer than a tenth of a second a foot stands beside the plates.

    Raises:
        LogError: at no time do the plates carry the person, or the forces are not in newtons.
    """
    motion = motion_of_center(body, placement, rate_hz)
    weight = body.subject.mass * GRAVITY
    vertical = np.sum([reading.force[:, 2] for reading in readings], axis=0)
    expected = body.subject.mass * (GRAVITY + motion.second[:, 2])
    typical = float(np.median(vertical[expected > 0.5 * weight])) if (expected > 0.5 * weight).any() else 0.0
    if not 0.05 * weight < typical < 20.0 * weight:
        peaks = ", ".join(f"{one.name} at most {one.force[:, 2].max():.4g}" for one in readings)
        raise LogError(
            f"vertical forces are {typical:.4g} N where the person weighs {weight:.0f} N ({peaks})",
            source=source,
            field="force plates",
            remedy="check the plates' gains and the person's mass in kilograms: no unit of force makes them agree",
        )
    # More than a foot that swings takes away, for longer than a tenth of a second.
    short = expected - vertical > 0.35 * weight
    carried = ~short
    for start, stop in runs_of(short):
        if stop - start < round(0.1 * rate_hz):
            carried[start:stop] = True
    span = slice(*max(runs_of(carried), key=lambda run: run[1] - run[0], default=(0, 0)))
    if span.stop == 0:
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
    if abs(share) > 0.05:
        text = (
            f"{source.name}: the plates say {mass:.1f} kg, the person weighs {body.subject.mass:.1f} kg "
            f"({100 * share:+.1f} %): check gains, zeros, and what is worn"
        )
        findings.append(Finding("mass", text, {"plates_kg": mass, "given_kg": body.subject.mass}))
    return Support(span, mass, tuple(findings))
