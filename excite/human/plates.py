"""Force plates: their readings, their moments about the ground, the ground reaction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import groupby, permutations, product
from pathlib import Path

import numpy as np

from excite.arrays import Array, runs_of
from excite.errors import LogError
from excite.finding import Finding
from excite.human.body import Body
from excite.human.recording import PlateRecording, Recording
from excite.human.segments import NAMES, SIDES, Placement
from excite.logs.signals.butterworth import Derivatives, central_differences, lowpass, settling_samples
from excite.robot.quantities import GRAVITY

# Centres of pressure, and how far from the feet they lie.

NEAR, FAR = 0.15, 0.25
"""A foot that stands on a plate has the centre of pressure below it; both are good to a few centimetres [m]."""


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
_FORCE_UNITS = {
    4.4482216152605: "pounds-force",
    9.80665: "kilograms-force",
    1e3: "kilonewtons",
    1e2: "hundreds of newtons (another gain of the amplifier)",
    1e1: "tens of newtons (another gain of the amplifier)",
    1e-1: "tenths of newtons (another gain of the amplifier)",
    1e-2: "hundredths of newtons (another gain of the amplifier)",
    1e-3: "millinewtons",
}
_LEVER_UNITS = {
    1e3: "N·m where the file's unit makes them N·mm",
    1e-3: "N·mm where the file's unit makes them N·m",
    1.3558179483314: "pound-feet",
    0.1129848290276: "pound-inches",
    0.3048: "made of levers in feet",
    0.2248089430997105: "N·m beside forces in pounds-force",
    0.0254: "made of levers in inches",
    1e2: "a hundred times too small beside the forces",
    1e1: "ten times too small beside the forces",
    1e-1: "ten times too large beside the forces",
    1e-2: "a hundred times too large beside the forces, as with levers in centimetres",
}
_MOMENTS_ARE = "moments of {} are "
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
        cutoff_hz: of the same low-pass that the markers went through (third order, forwards and backwards).

    Raises:
        LogError: no plate carries load, or the centres of pressure lie at neither foot.
    """
    feet = {side: foot_line(placement, side, body) for side in SIDES}
    judged = _Plates(recording.source, list(recording.plates), feet)
    judged.turn_upward()
    judged.plates = [_at_times(plate, recording.time, cutoff_hz, recording.source) for plate in judged.plates]
    rate = (len(recording.time) - 1) / float(recording.time[-1] - recording.time[0])
    motion = motion_of_center(body, placement, rate)
    needed = body.subject.mass * (motion.second + np.array([0.0, 0.0, GRAVITY]))
    judged.convert_forces(needed[:, 2])
    judged.leave_out_unloaded()
    judged.plates = [judged.in_metres(plate) for plate in judged.plates]
    vertical = np.sum([plate.force[:, 2] for plate in judged.plates], axis=0)
    carried, turning = vertical > 0.7 * needed[:, 2], angular_momentum_rate(body, placement, rate)
    judged.balance_body(_Balance(needed, turning, motion.value, carried, judged.ground_height))
    judged.find_lost_moments()
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

    def convert_forces(self, needed: Array) -> None:
        """Forces in newtons: of the units, one for each plate, that in which they carry the person.

        Args:
            needed: vertical force that moves the person, ``(n,)`` [N].
        """
        weight = float(needed.mean())
        vertical = np.column_stack([plate.force[:, 2] for plate in self.plates])
        units = (1.0, *_FORCE_UNITS)
        # A plate that somebody steps on carries some third of the weight for a while, and ten times as much in a jump.
        choices = [
            [k for k in units if k == 1.0 or 0.3 * weight < k * most < 10.0 * weight]
            for most in vertical.max(axis=0)
        ]
        few = len(choices) <= 4
        factors = np.array(list(product(*choices)) if few else [(k,) * len(choices) for k in units])
        missed = np.minimum(np.abs(factors @ vertical.T - needed) / weight, 1.0)
        best = int(np.argmin(missed.mean(axis=1)))
        # Where more than a third of the weight is missing a foot stands beside the plates.
        told = np.minimum(missed[0], missed[best]) < 0.3
        first, least = (float(missed[k][told].mean()) if told.any() else 0.0 for k in (0, best))
        if least > 0.5 * first or not first:
            return
        for i, factor in enumerate(factors[best].tolist()):
            plate = self.plates[i]
            self.plates[i] = replace(plate, force=factor * plate.force, moment=factor * plate.moment)
            if factor != 1.0:
                text = (
                    f"forces of {plate.name} are {_FORCE_UNITS[factor]}, in which the plates miss the person's "
                    f"{weight:.0f} N by {100 * least:.0f} %, and as newtons by {100 * first:.0f} % or more; converted"
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
        nearest = nearest[np.isfinite(nearest)]
        return float(np.median(nearest)) if len(nearest) else 0.0

    def typical_sway(self, plate: PlateRecording) -> float:
        """Typical distance of the centre of pressure from its middle [m]; NaN where the plate is not loaded."""
        point = pressure_center(plate.force, plate.moment, self.ground_height)[:, :2]
        point = point[np.isfinite(point[:, 0])]
        if not len(point):
            return float("nan")
        return float(np.median(np.linalg.norm(point - np.median(point, axis=0), axis=1)))

    def in_metres(self, plate: PlateRecording) -> PlateRecording:
        """The plate with points of application, which a table states, in metres."""
        miss = self.typical_miss(plate)
        if plate.corners is not None:
            return plate
        point = pressure_center(plate.force, plate.moment, self.ground_height)
        free = plate.moment - np.cross(np.nan_to_num(point), plate.force)
        is_far, loaded = miss > 5.0, np.isfinite(point[:, 0])
        # A free moment of a foot is a few N·m.
        twists = np.abs(free[loaded, 2]) if loaded.any() else np.zeros(1)
        is_twisted = bool((np.max if is_far else np.median)(twists) > 200.0)
        factors = np.where([is_far, is_twisted], 1e-3, 1.0)
        moment = np.cross(factors[0] * np.nan_to_num(point), plate.force) + factors[1] * free
        scaled = replace(plate, moment=moment)
        if not (is_far or is_twisted) or self.typical_miss(scaled) > FAR:
            return plate
        what = "points of application of" if is_far else "torques about the vertical of"
        text = f"{what} {plate.name} are a thousand times too large: they are in millimetres; converted"
        self.add_finding("units", text, {"factor": 1e-3}, plate.name)
        return scaled

    def balance_body(self, balance: _Balance) -> None:
        """Turn, mirror, exchange or move plates where their forces and moments then move the person as he moves."""
        # The same plate in the same pose stands in dozens of changes.
        miss_of = cache(self.typical_miss)

        def typical_miss(plates: Sequence[PlateRecording]) -> float:
            return max(map(miss_of, plates))

        def misfit(plates: Sequence[PlateRecording]) -> float:
            """Of forces, of moments, and of the feet, which are some centimetres wide."""
            return float(np.prod([np.sqrt((rest**2).mean()) for rest in balance.rest(plates)])) * (
                0.05 + typical_miss(plates)
            )

        while balance.carried.any() and len(self.plates) <= 4:
            first = least = misfit(self.plates)
            limit, chosen = max(NEAR, typical_miss(self.plates)), None
            # More is taken to be wrong only where that halves what is left; of units, which are few, its power.
            for _, alike in groupby(
                sorted(_changed_poses(self.plates, balance), key=_Change.size), _Change.size
            ):
                possible = [one for one in alike if typical_miss(one.plates) < limit]
                best = min(possible, key=lambda one: misfit(one.plates), default=None)
                if best is None or misfit(best.plates) >= best.bound * least:
                    continue
                least = misfit(best.plates)
                # Units that are next to each other are not told apart: a body's own moments are known to some tenths.
                near = [
                    one.fault.removeprefix(_MOMENTS_ARE)
                    for one in possible
                    if one is not best
                    and (one.kind, one.names) == (best.kind, best.names) == ("units", best.names)
                    and best.bound * misfit(one.plates) < least
                ]
                chosen = replace(best, fault=", or ".join([best.fault, *near]))
            if chosen is None:
                return
            self.plates = chosen.plates
            ratio = first / max(least, 1e-9)
            # Each plate has a unit of its own.
            for names in [(name,) for name in chosen.names] if chosen.kind == "units" else [chosen.names]:
                text = (
                    f"{chosen.fault.format(' and '.join(names))}: as it stands the plates' forces and moments miss "
                    f"what moves the person by {ratio:.2g} times as much; {chosen.cure}"
                )
                self.add_finding(chosen.kind, text, {"ratio": ratio}, *names)

    def find_lost_moments(self) -> None:
        """Name plates whose centre of pressure does not move: their moments are not there."""
        for plate in self.plates:
            if (sway := self.typical_sway(plate)) < _LEAST_SWAY:
                text = (
                    f"the centre of pressure of {plate.name} moves by {1e3 * sway:.2g} mm only: check that its moments "
                    "were recorded, and their unit"
                )
                self.add_finding("moments", text, {"sway_m": sway}, plate.name)

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
        loaded = point[np.isfinite(point[:, 0])]
        return np.median(loaded, axis=0) if len(loaded) else np.array([0.0, 0.0, self.ground_height])


@dataclass(frozen=True, eq=False)
class _Balance:
    """What moves the person: force ``(n, 3)`` [N] at the centre of mass ``(n, 3)`` [m], and what turns it [N·m].

    ``carried`` are the frames ``(n,)`` that tell; ``height`` is the ground's [m].
    """

    needed: Array
    turning: Array
    center: Array
    carried: Array
    height: float

    def rest(self, plates: Sequence[PlateRecording]) -> tuple[Array, Array]:
        """Horizontal forces ``(m, 2)`` and moments about the centre of mass ``(m, 3)`` that nothing balances."""
        force = np.sum([one.force for one in plates], axis=0)[self.carried]
        moment = np.sum([one.moment for one in plates], axis=0)[self.carried]
        about = moment - np.cross(self.center[self.carried], force) - self.turning[self.carried]
        return (force - self.needed[self.carried])[:, :2], about

    def moved(
        self, own: Sequence[PlateRecording], which: Mapping[int, PlateRecording]
    ) -> tuple[dict[int, PlateRecording], Array]:
        """Plates in place of some of a file's own, moved that moments balance best; by how much, ``(m, 3)`` [m]."""
        axes = np.eye(3)[:2]
        levers = [np.cross(axis, one.force[self.carried]).ravel() for one in which.values() for axis in axes]
        moment = self.rest([which.get(i, one) for i, one in enumerate(own)])[1].ravel()
        shifts = np.linalg.lstsq(np.column_stack(levers), -moment, rcond=None)[0].reshape(-1, 2) @ axes
        return {i: _shift_plate(which[i], by) for i, by in zip(which, shifts, strict=True)}, shifts


@dataclass(frozen=True, eq=False)
class _Change:
    """All plates with some of them changed; which, the finding's kind, what was wrong and what was done.

    ``fitted`` counts places, and units, that were fitted besides.
    """

    plates: list[PlateRecording]
    names: tuple[str, ...]
    kind: str
    fault: str
    cure: str
    fitted: int = 0

    @classmethod
    def of(
        cls,
        own: Sequence[PlateRecording],
        changed: Mapping[int, PlateRecording],
        *words: str,
        fitted: int = 0,
    ) -> _Change:
        """Some of a file's own plates changed."""
        plates = [changed.get(i, one) for i, one in enumerate(own)]
        kind, fault, cure = words
        return cls(plates, tuple(own[i].name for i in changed), kind, fault, cure, fitted)

    @property
    def bound(self) -> float:
        """Share of the misfit that it may leave, to be believed."""
        return float(np.sqrt(0.5)) if self.kind == "units" else 0.5

    def size(self) -> int:
        """How much is changed."""
        return len(self.names) + self.fitted


def _changed_poses(own: Sequence[PlateRecording], balance: _Balance) -> Iterator[_Change]:
    """Plates in other poses than they are said to have, or with moments of another size."""
    n, origin = len(own), np.zeros(3)
    middles = [origin if one.corners is None else one.corners.mean(axis=0) for one in own]
    # Of a table forces may be turned whose points of application are right.
    points = [np.nan_to_num(pressure_center(one.force, one.moment, balance.height)) for one in own]
    about_middles, about_points, about_origin = (
        [[_turn_plate(one, k, at) for k in range(4)] for one, at in zip(own, about, strict=True)]
        for about in (middles, points, [origin] * n)
    )
    apart = [
        (turns, poses)
        for poses in (about_middles, about_points)
        for turns in product(range(4), repeat=n)
        if n <= 3
    ]
    for turns, poses in (*apart, *(((k,) * n, about_origin) for k in (1, 2, 3))):
        turned = {i: poses[i][k] for i, k in enumerate(turns) if k}
        angles = " and ".join(f"{90 * k}°" for k in turns if k)
        words = ("turned_plate", "{} is turned about the vertical", f"turned by {angles}")
        yield _Change.of(own, turned, *words)
        # A plate turns about its middle, which a table does not tell.
        if turned and all(own[i].corners is None for i in turned):
            yield _Change.of(own, balance.moved(own, turned)[0], *words, fitted=len(turned))
    for order in permutations(range(n)):
        exchanged = {
            i: _move_plate(own[i], own[j])
            for i, j in enumerate(order)
            if i != j and own[j].corners is not None
        }
        yield _Change.of(own, exchanged, "swapped_plates", "{} are swapped", "put back")
    for which in list(product((False, True), repeat=n))[1:]:
        for factor, fault, cure in (
            (-1.0, "{} with moments that count the other way", "turned round"),
            *((factor, _MOMENTS_ARE + unit, "converted") for factor, unit in _LEVER_UNITS.items()),
        ):
            # Moments are about the laboratory's origin where the file has no plate's place.
            scaled = {
                i: replace(one, moment=factor * one.moment + (1.0 - factor) * np.cross(middles[i], one.force))
                for i, one in enumerate(own)
                if which[i]
            }
            kind = "moments" if factor < 0.0 else "units"
            yield _Change.of(own, scaled, kind, fault, cure, fitted=len(scaled) if factor > 0.0 else 0)
        moved, shifts = balance.moved(own, {i: own[i] for i in range(n) if which[i]})
        by = " and ".join(f"({x:.2f}, {y:.2f}) m" for x, y, _ in shifts)
        if (np.linalg.norm(shifts, axis=1) > NEAR).all():
            words = ("plate_place", "{} stands elsewhere than the file says", f"moved by {by}")
            yield _Change.of(own, moved, *words, fitted=len(moved))


def _shift_plate(plate: PlateRecording, by: Array) -> PlateRecording:
    """A plate's reading where it is moved by a vector ``(3,)`` [m]."""
    corners = None if plate.corners is None else plate.corners + by
    return replace(plate, corners=corners, moment=plate.moment + np.cross(by, plate.force))


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


def angular_momentum_rate(body: Body, placement: Placement, rate_hz: float) -> Array:
    """Moment about the centre of mass that turns the body's segments, ``(n, 3)`` [N·m].

    Each segment is six equal point masses on its principal axes, which have its second moments.
    """
    points, masses = [], []
    for one in body.inertias:
        second, axes = np.linalg.eigh(0.5 * np.trace(one.inertia) * np.eye(3) - one.inertia)
        reach = (axes * np.sqrt(3.0 * np.maximum(second, 0.0) / one.mass)).T
        points.append(one.lever + np.vstack([reach, -reach]))
        masses.append(np.full(6, one.mass / 6.0))
    each = np.repeat(np.arange(len(points)), 6)
    places, cutoff = placement.locate_points(each, np.concatenate(points)), min(6.0, 0.2 * rate_hz)
    if len(places) > settling_samples(rate_hz, cutoff):
        flat = lowpass(places.reshape(len(places), -1), rate_hz, cutoff, 3)
        places = flat.reshape(places.shape)
    weights = np.concatenate(masses)
    center = np.einsum("m,nmi->ni", weights / weights.sum(), places)
    pushes = weights[:, None] * central_differences(places, rate_hz).second
    return np.cross(places - center[:, None], pushes).sum(axis=1)


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
