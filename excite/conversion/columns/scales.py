"""Factors from the numbers of a recording to SI units, channel by channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from excite.arrays import Array, Flags, is_whole
from excite.conversion.columns.clock import row_seconds
from excite.conversion.columns.units import (
    BEYOND,
    COUNT_RATES,
    COUNTS,
    NEAR,
    WIDE,
    Told,
    derivative_of,
    position_unit,
)
from excite.conversion.columns.words import Clue
from excite.conversion.explicit_mapping import Map
from excite.conversion.guesses import Guesses, Mapped
from excite.conversion.recording import Machine, Recording
from excite.finding import first_names
from excite.logs.units import OF_SLIDING, OF_TURNING, QUANTITY_OF_UNIT, TO_SI

# LeRobot's servos report the share of the range that they were calibrated in, unless told to report degrees: from
# -100 to 100, grippers from 0 (its ``MotorNormMode``).
SHARE, _MOST_SHARE = "±100", 120.0
_CHANNELS = ("q", "q_cmd", "v", "a", "tau", "tau_cmd", "i", "base", "wrench", "contact")
# Channels of how joints move, and units that a channel may have of joints that turn alone.
_MOTION = ("q", "q_cmd", "v", "a")
_ANGLES = frozenset(u for u in OF_TURNING if QUANTITY_OF_UNIT[u] != "tau" and TO_SI[u] != 1.0)
# Units that velocities are told to be in by the positions' derivative: of what slides, of what turns, of counts.
_RATES = {
    True: {unit: TO_SI[unit] for unit in ("m/s", "mm/s", "cm/s", "in/s")},
    False: {unit: TO_SI[unit] for unit in ("rad/s", "deg/s", "rpm", "rev/s", "mrad/s", "in/s")},
}
_CALLED = {
    "q": "positions",
    "v": "velocities",
    "a": "accelerations",
    "tau": "torques or forces",
    "i": "currents",
}
USUAL = {"q": "rad", "v": "rad/s", "a": "rad/s2", "tau": "N·m", "i": "A", "time": "s"}
"""Units of channels and of their commands, of joints that turn."""
# Torques of more joints than gravity may keep on one side; by how much those of another unit exceed a joint's limit.
_SEVERAL, _BEYOND_LIMIT = 3, 30.0
# An accelerometer at rest reads gravity: 9.81 m/s², 1 g or 1000 mg. A robot that stands departs from it by less.
_GRAVITY, _NEAR_GRAVITY = 9.80665, 1.25
# A joint that is held is in the others' unit, and what it is called matters little. In degrees 16 of the 17 joints that
# are held in real recordings here stay within this number (0.054 at the most, the other 0.13); in radians 95 % of the
# 1421 joints that move in the library's motions of eleven robots go further. What is between is asked about.
_HELD = 0.06
# Joints may be faster than they are said to be, but not as much as degrees are larger than radians.
_FASTER = 3.0


@dataclass(frozen=True)
class Scaling:
    """What the units of a recording's columns are told by; what cannot be told is added to ``found.questions``."""

    found: Guesses
    recording: Recording
    machine: Machine
    mapping: Map
    clues: Mapping[str, Clue]
    columns: Mapping[str, Array]

    def convert(self) -> list[Mapped]:
        """The channels with their factors."""
        done = [item for item in self.found.mapped if item.target == "time"] + self._of_imu()
        measured: dict[str, Told] = {}
        for channel in _CHANNELS:
            items = self.found.of(channel)
            for group in [] if self._is_magnitude(channel, items) else self._by_unit(items):
                stated, named = self.stated(group), self.named(group)
                if not stated:
                    self._ask_for_kind(group, named)
                if channel in ("q", "q_cmd"):
                    told = self._position_unit(group, measured.get(f"q.{group[0].joint}"))
                    measured |= {item.target: told for item in group}
                elif stated:
                    told = Told(stated, "unit stated in the map")
                elif channel in ("v", "a"):
                    told = self._rate_unit(group, named, measured)
                elif named:
                    told = Told(named, "unit as named")
                elif channel in ("tau", "tau_cmd"):
                    told = self._torque_unit(group)
                else:
                    told = Told({"i": "A"}.get(channel, "SI"), self._without_unit(group))
                if told.unit == SHARE:
                    done += self._of_ranges(group)
                    continue
                unit = "" if channel in ("q", "q_cmd") else stated or named
                zero = COUNTS[told.unit][0] if told.unit in COUNTS else 0.0
                factor = COUNT_RATES.get(told.unit) or TO_SI.get(told.unit, 1.0)
                done += [replace(self._scaled(item, factor, zero, told.why), unit=unit) for item in group]
        return done

    def slides(self, item: Mapped) -> bool:
        """Whether a column is the motion of a joint that slides."""
        known = item.channel in _MOTION and item.joint in self.machine.joints
        return known and bool(self.machine.slides[self.machine.joints.index(item.joint)])

    def stated(self, items: Sequence[Mapped]) -> str:
        """The unit that a map states of a joint's column, or of its channel; empty for none.

        A part of a turn that is stated of a channel is that of its joints that turn.
        """
        own, common = (self.mapping.units.get(key) for key in (items[0].target, items[0].channel))
        return str(own or ("" if self.slides(items[0]) and common in _ANGLES else common) or "")

    def named(self, items: Sequence[Mapped]) -> str:
        """The unit that names or format state of all columns of a channel; empty for none, or several."""
        units = {self.clues[item.source].unit for item in items if item.source in self.clues}
        return units.pop() if len(units) == 1 else ""

    def values(self, items: Sequence[Mapped]) -> Array:
        """Numbers of several columns as they stand in the file, ``(n, k)``."""
        rows = min(len(self.columns[item.source]) for item in items)
        return np.column_stack([self.columns[item.source][:rows] for item in items])

    def _by_unit(self, items: Sequence[Mapped]) -> list[list[Mapped]]:
        """Columns of a channel by the unit that the map or their names state, and by whether their joints slide."""
        groups: dict[tuple[str, str, bool], list[Mapped]] = {}
        for item in items:
            groups.setdefault((self.stated([item]), self.named([item]), self.slides(item)), []).append(item)
        return list(groups.values())

    def _scaled(self, item: Mapped, factor: float, zero: float, because: str) -> Mapped:
        """A channel with its factor and zero (SI), scaled and moved as the map says."""
        scale = self.mapping.scale.get(item.channel, 1.0) * self.mapping.scale.get(item.target, 1.0)
        offset = self.mapping.offset.get(item.target, self.mapping.offset.get(item.channel, zero))
        return replace(item, factor=factor * scale, because=f"{item.because}; {because}", offset=offset)

    def _is_magnitude(self, channel: str, items: list[Mapped]) -> bool:
        """Whether commanded torques are none; asks for the sign of torques and currents that have none.

        Torques or currents of several joints that are never negative are magnitudes, which no equation holds for.
        """
        loads = channel not in _MOTION and channel not in ("base", "contact") and len(items) >= _SEVERAL
        if not loads or channel in self.mapping.columns or self.stated(items):
            return False
        values = self.values(items)
        if not (np.nanmin(values) >= 0.0 and (np.nanmax(values, axis=0) > 0.0).all()):
            return False
        if channel == "tau_cmd":
            # Feed-forward that is switched off, or a magnitude: nothing needs it.
            self.found.note("never negative", channel=channel, column=items[0].source)
            return True
        self.found.ask("magnitudes", column=items[0].source, pattern=_common_beginning(items))
        return False

    def _ask_for_kind(self, items: list[Mapped], named: str) -> None:
        """Ask what columns of one channel are that state a unit of another quantity.

        An angle's unit of velocities may be short for its rate, which the positions' derivative tells; what the map
        scales is in a unit that a person has thought of.
        """
        channel, is_of = items[0].channel, QUANTITY_OF_UNIT.get(named, "")
        own = channel.partition("_")[0]
        scaled = {channel, *(item.target for item in items)} & set(self.mapping.scale)
        if own in USUAL and is_of not in ("", "time", own) and (own, is_of) != ("v", "q") and not scaled:
            self.found.ask(
                "unit of another quantity",
                column=items[0].source,
                called=_CALLED[own],
                unit=named,
                kind=_CALLED.get(is_of, "voltages"),
                channel=channel,
                usual=USUAL[own],
                pattern=_common_beginning(items),
            )

    # Positions: by a map, by names, by ranges, or asked for.

    def _position_unit(self, items: list[Mapped], like: Told | None) -> Told:
        """The unit of positions that share one, and why; asked for where it cannot be told."""
        channel, slide = items[0].channel, self.slides(items[0])
        named, stated = self.named(items), self.stated(items)
        told = self._by_numbers(items, named)
        unit, why = told.unit, told.why
        if named == "counts" and unit not in COUNTS:
            unit, why = "", "counts, by its name, and how many are a turn is not said"
        elif not told.sure and channel == "q_cmd" and like is not None:
            unit, why = like.unit, "as the measured positions"
        if self.mapping.motors:
            # Motors turn beyond what joints do.
            return Told(named or "rad", "motors' positions")
        if stated:
            return Told(stated, self.found.stated_because)
        if TO_SI.get(named, 1.0) != 1.0 and named in (OF_TURNING if slide else OF_SLIDING):
            does, is_of, other = ("slide", "an angle", "mm") if slide else ("turn", "a length", "deg")
            written = ", ".join(f"{item.target}: {other}" for item in items)
            self.found.ask(
                "unit of other joints",
                column=items[0].source,
                unit=named,
                kind=is_of,
                does=does,
                line=written,
            )
            return Told(unit or "rad", why)
        if not unit and (
            channel in self.mapping.scale or {i.target for i in items} <= set(self.mapping.scale)
        ):
            return Told("rad", "scaled by the map")
        if not named and not slide and channel not in self.mapping.scale and self._ask_for_parts(items):
            return Told("rad", "asked about")
        values = self.values(items)
        if channel == "q" and unit == "deg" and not named and self._may_be_shares(items, values):
            self.found.ask("shares or degrees", column=items[0].source)
        if not unit:
            counted = is_whole(values)
            self.found.ask(
                "unit of positions",
                {"units": ({channel: "rad"}, {channel: "deg"}) if channel == "q" and told.either else ()},
                column=items[0].source,
                why=why,
                counts="; whole numbers: an encoder's counts, whose number a turn the maker states for each joint"
                if counted
                else "",
                channel=channel,
                target=items[0].target,
            )
        return Told(unit or "rad", why)

    def _may_be_shares(self, items: list[Mapped], values: Array) -> bool:
        """Whether degrees may be LeRobot's shares: its data sets, its names, or joints that end at 100 of something.

        Shares pass 100 a little where they are not cut off.
        """
        most = np.nanmax(np.abs(values), axis=0)
        if self.recording.said.get("maybe_shares") or all(item.source.endswith(".pos") for item in items):
            return bool(most.max() <= _MOST_SHARE)
        # To the digits that tables have.
        return bool(most.max() < 100.005 and (most > 99.995).sum() > 1)

    def _by_numbers(self, items: list[Mapped], named: str) -> Told:
        """The unit by ranges, where velocities do not let it open."""
        places = [self.machine.joints.index(item.joint) for item in items]
        lower, upper, slide = (
            of[places] for of in (self.machine.lower, self.machine.upper, self.machine.slides)
        )
        found = position_unit(self.values(items), lower, upper, slide, named)
        speeds = [self._own_speed(item) for item in items if found.unit == "deg" and not named]
        most = _FASTER * self.machine.speed[places]
        if (
            items[0].channel == "q"
            and speeds
            and all(s is not None and s < m for s, m in zip(speeds, most, strict=True))
        ):
            why = "as rad they turn over, no faster than they may by their velocities, which go with either"
            return Told("", f"{found.why}; {why}", found.sure, either=True)
        return found

    def _own_speed(self, item: Mapped) -> float | None:
        """How fast a joint is by velocities of no stated unit, where these are in that of the positions' numbers."""
        speed = next((one for one in self.found.of("v") if one.joint == item.joint), None)
        if speed is None or self.named([speed]):
            return None
        slope = self._slopes([(item, speed)])
        there = slope is not None and 1.0 / NEAR < slope.ratio < NEAR
        return float(np.nanmax(np.abs(self.columns[speed.source]))) if there else None

    def _ask_for_parts(self, items: list[Mapped]) -> bool:
        """Ask where some columns can only be degrees and others beside them look like radians."""
        places = [self.machine.joints.index(item.joint) for item in items]
        degrees = _in_degrees(self.values(items), self.machine.lower[places], self.machine.upper[places])
        if degrees is None or items[0].channel == "q_cmd":
            return False
        units = {item.target: "deg" if of else "rad" for item, of in zip(items, degrees, strict=True)}
        names = {u: [item.source for item in items if units[item.target] == u] for u in ("deg", "rad")}
        self.found.ask(
            "degrees and radians",
            {"units": ({"q": "rad"}, {"q": "deg"}, units)},
            degrees=first_names(names["deg"]),
            radians=first_names(names["rad"]),
            joint=next(item.joint for item in items if units[item.target] == "rad"),
            units_by_joint=", ".join(f"{target}: {unit}" for target, unit in units.items()),
        )
        return True

    def _of_ranges(self, items: list[Mapped]) -> list[Mapped]:
        """Positions that are shares of the joints' ranges, which the model states."""
        done = []
        for item in items:
            at = self.machine.joints.index(item.joint)
            low, high = float(self.machine.lower[at]), float(self.machine.upper[at])
            if not np.isfinite(high - low):
                self.found.ask("no range", joint=item.joint, column=item.source, channel=item.channel)
                continue
            # A gripper is counted from its lower end.
            zero, share = (low, 0.01) if "gripper" in item.joint.lower() else (0.5 * (low + high), 0.005)
            because = "shares of the model's ranges, which calibration may have had otherwise"
            done.append(self._scaled(item, share * (high - low), zero, because))
        return done

    # Velocities, torques and readings.

    def _rate_unit(self, items: list[Mapped], named: str, positions: Mapping[str, Told]) -> Told:
        """Unit of velocities or accelerations: what makes them the positions' derivative."""
        slides = self.slides(items[0])
        angle = positions.get(f"q.{items[0].joint}", next(iter(positions.values()), Told("", ""))).unit
        base = angle if angle in ("deg", "m", "mm") else "m" if slides else "rad"
        if items[0].channel == "a":
            return Told(named, "unit as named") if named else Told(f"{base}/s2", "as the positions")
        expected = named or f"{base}/s"
        of_joint = {item.joint: item for item in self.found.of("q")}
        pairs = [(of_joint[item.joint], item) for item in items if item.joint in of_joint]
        unit_of = {position.source: positions[position.target].unit for position, _ in pairs}
        found = self._slopes(pairs, unit_of) if all(unit in TO_SI for unit in unit_of.values()) else None
        values = self.values(items)
        counted = angle in COUNTS and is_whole(values[np.isfinite(values)])
        sizes = COUNT_RATES if counted else _RATES[slides] | ({named: TO_SI[named]} if named in TO_SI else {})
        unit = None
        if found is not None and np.isfinite(found.ratio):
            nearest = min(sizes, key=lambda one: abs(np.log(found.ratio / sizes[one])))
            unit = nearest if abs(np.log(found.ratio / sizes[nearest])) < np.log(NEAR) else None
        if unit is None and QUANTITY_OF_UNIT.get(named) == "q":
            self.found.ask(
                "unit of positions for velocities", column=items[0].source, unit=named, channel="v"
            )
        if found is None:
            return Told(
                expected,
                "unit as named" if named else "as the positions, with which they do not share a clock",
            )
        if not np.isfinite(found.ratio):
            return Told(expected, "they are not the positions' derivative, to which nothing agrees")
        if unit is None:
            by = found.ratio / TO_SI.get(expected, 1.0)
            return Told(expected, f"they differ from the positions' derivative by a factor of {by:.3g}")
        alike = f"they are the positions' derivative (correlation {found.alike:.2f})"
        if named and abs(np.log(sizes[unit] / TO_SI.get(named, 1.0))) < 0.1:
            return Told(named, f"as named; {alike}")
        return Told(unit, f"{unit}: so {alike}" + (f", though its name says {named}" if named else ""))

    def _slopes(
        self, pairs: Sequence[tuple[Mapped, Mapped]], units: Mapping[str, str] | None = None
    ) -> _Slope | None:
        """How positions' derivatives compare with velocities; None where no clock is common to them."""
        names = {item.source for pair in pairs for item in pair}
        stream = next((s for s in self.recording.streams if names <= {c.name for c in s.columns}), None)
        time = None if stream is None or not pairs else self.found.times(stream)
        dt = None if time is None else row_seconds(time)
        q, v = (self.values(side) for side in zip(*pairs, strict=True)) if pairs else (None, None)
        if dt is None or q is None or v is None:
            return None
        whole = np.isfinite(q).all(axis=1) & np.isfinite(v).all(axis=1)
        if whole.sum() < 20:
            return None
        size = [1.0 if units is None else TO_SI[units[item.source]] for item, _ in pairs]
        slopes = np.array(
            [derivative_of(*one, dt) for one in zip((q * size)[whole].T, v[whole].T, strict=True)]
        )
        told = slopes[slopes[:, 1] > 0.5]
        return (
            _Slope(float(np.median(np.abs(told[:, 0]))), float(told[:, 1].min()))
            if len(told)
            else _Slope(np.nan, 0.0)
        )

    def _torque_unit(self, items: list[Mapped]) -> Told:
        """Unit of torques that nothing states: N·mm where they exceed every limit by orders."""
        places = [self.machine.joints.index(item.joint) for item in items]
        share = np.nanmax(np.abs(self.values(items)), axis=0) / self.machine.torque[places]
        share = share[np.isfinite(self.machine.torque[places])]
        if len(share) and (beyond := float(np.median(share))) > _BEYOND_LIMIT:
            return Told("N·mm", f"N·mm: as N·m they would exceed the joints' limits by {beyond:.0f}")
        unit = "N" if self.machine.slides[places].all() else "N·m"
        return Told(unit, "no unit stated, within what the joints can do")

    def _without_unit(self, items: list[Mapped]) -> str:
        """What is said of columns whose unit nothing states: servos report currents in counts of a few milliamperes."""
        known = (values := self.values(items))[np.isfinite(values)]
        if items[0].channel == "i" and len(known) and is_whole(known):
            return "no unit stated; whole numbers, so counts of a drive or mA: torque constants are per one of them"
        return "no unit stated"

    def _of_imu(self) -> list[Mapped]:
        """Readings of an IMU: in the unit that names state, else rad/s and what makes gravity of accelerations."""
        items = self.found.of("imu")
        read = [item for item in items if item.target in ("imu.ax", "imu.ay", "imu.az")]
        weighed = (1.0, "no unit stated")
        if len(read) == 3:
            level = float(np.nanmedian(np.linalg.norm(self.values(read), axis=1)))
            near = [
                (factor, f"{unit}: it reads {level:.4g} where the robot hardly moves")
                for unit, factor in (("g", _GRAVITY), ("mg", 1e-3 * _GRAVITY))
                if 1.0 / _NEAR_GRAVITY < level * factor / _GRAVITY < _NEAR_GRAVITY
            ]
            weighed = near[0] if near else (1.0, "m/s²: no other unit makes gravity of it")
        done = []
        for item in items:
            named = str(self.mapping.units.get(item.channel, "")) or self.named([item])
            scaled = {item.channel, item.target} & set(self.mapping.scale)
            factor, why = weighed if item in read and not scaled else (1.0, "no unit stated")
            factor, why = (TO_SI[named], "unit as named") if named in TO_SI else (factor, why)
            done.append(self._scaled(item, factor, 0.0, why))
        return done


class _Slope(NamedTuple):
    """Median of the derivatives' slopes over velocities, and their least correlation."""

    ratio: float
    alike: float


def _in_degrees(values: Array, lower: Array, upper: Array) -> Flags | None:
    """Which columns are degrees, the others looking like radians, by their ranges; None where none contradict.

    Args:
        values: ``(n, k)`` positions of joints that turn, as they stand in the file.
        lower: ``(k,)`` ends of the joints' ranges [rad], ``upper`` too; infinite where they are not known.
    """
    low, high, factor = np.nanmin(values, axis=0), np.nanmax(values, axis=0), TO_SI["deg"]
    span, beyond = high - low, np.maximum(lower - low, high - upper)
    beyond_in_degrees = np.maximum(lower - low * factor, high * factor - upper)
    # Wherever a joint's zero is, it does not turn further than its range is wide.
    wide = span > np.where(np.isfinite(upper - lower), upper - lower, WIDE)
    degrees = wide & (((beyond > BEYOND) & (beyond_in_degrees <= BEYOND)) | ~np.isfinite(beyond))
    # No joint of those motions, and 3 of 204 in the recordings, turn further in radians; in degrees it would be 6.3.
    radians = (beyond <= BEYOND) & (span > _HELD) & (span < 2.0 * np.pi)
    if not (degrees.any() and radians.any()):
        return None
    # Those that hardly move go with most.
    return degrees | (~radians & bool(degrees.sum() > radians.sum()))


def _common_beginning(items: Sequence[Mapped]) -> str:
    """What the columns' names begin with, all of them; none of it means anything else in a pattern."""
    first, last = min(item.source for item in items), max(item.source for item in items)
    same = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same].rstrip("[0123456789") or first[:same]
