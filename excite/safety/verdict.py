"""What the independent check says about a motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

SCHEMA = "excite.check/1"


@dataclass(frozen=True)
class Violation:
    """One thing that a motion must not do, at the first time at which it does it.

    Attributes:
        kind: what is violated, such as ``joint_velocity`` or ``zmp``.
        time_s: first time of it [s]; None where it has no time (a missing column).
        where: joint, foot, pair of links or coordinate.
        value: the offending value at that time, in SI units; None where it is not a finite number.
        limit: what it must not pass, same unit; None where there is no number.
        unit: of both, that of what the joint does: rad or m; empty where none is known.
    """

    kind: str
    time_s: float | None
    where: str
    value: float | None
    limit: float | None
    unit: str = ""

    def __str__(self) -> str:
        at = "" if self.time_s is None else f" at {self.time_s:.4f} s"
        unit = f" {self.unit}" if self.unit else ""
        value = "" if self.value is None else f": {self.value:.5g}{unit}"
        limit = "" if self.limit is None else f" (limit {self.limit:.5g})"
        return f"{self.kind} of {self.where}{at}{value}{limit}"


@dataclass(frozen=True)
class Nearest:
    """The joint that comes nearest to its limit, of those that slide or of those that turn.

    Attributes:
        where: its name.
        value: its margin, negative beyond the limit.
        unit: of the margin.
    """

    where: str
    value: float
    unit: str


@dataclass(frozen=True)
class Margins:
    """Smallest margins over a whole motion; None where one could not be computed or does not apply.

    The first five are what is left to the nearest limit, negative beyond it. The last two are distances as
    they are: what a robot requires of them stands in the limit of the violation.

    Attributes:
        joint_position_rad: to the nearest end of the range [rad or m].
        joint_velocity_rad_s: to the velocity limit [rad/s or m/s].
        joint_acceleration_rad_s2: to the acceleration limit [rad/s² or m/s²].
        joint_jerk_rad_s3: to the jerk limit [rad/s³ or m/s³].
        joint_torque_nm: to the torque limit [N·m or N].
        self_collision_m: smallest distance between two bodies, or a body and the table; of a pair that keeps less than
            the robot's margin, what it is nearer or farther than that, from the margin [m].
        zmp_m: smallest distance of the zero-moment point from the edge of the support polygon,
            negative outside [m].
    """

    joint_position_rad: float | None = None
    joint_velocity_rad_s: float | None = None
    joint_acceleration_rad_s2: float | None = None
    joint_jerk_rad_s3: float | None = None
    joint_torque_nm: float | None = None
    self_collision_m: float | None = None
    zmp_m: float | None = None


@dataclass(frozen=True)
class Worst:
    """The least margin over a motion and a set of robots.

    Attributes:
        value: the margin, negative beyond the limit.
        limit: what it must not be less than, same unit.
        where: joint or feet.
        time_s: when [s].
    """

    value: float
    limit: float
    where: str
    time_s: float

    @property
    def holds(self) -> bool:
        """Whether the limit is kept by every robot of the set."""
        return self.value >= self.limit


# Margins over a set: field, in words, factor and unit in which a person reads it, kind of its violation.
_ROBUST = {
    "joint_torque_nm": ("torque", 1.0, "N·m", "robust_joint_torque"),
    "zmp_m": ("zero-moment point inside", 1e3, "mm", "robust_zmp"),
    "friction": ("friction left", 1.0, "", "robust_friction"),
}


@dataclass(frozen=True)
class Robustness:
    """Least margins over a set of robots, those whose inertial parameters are as uncertain as stated.

    Attributes:
        uncertainty: the set, as ``robot.yaml`` states it, and ``stated`` whether it does.
        words: the same for a person.
        joint_torque_nm: to the torque limit [N·m or N]; None where it could not be computed.
        zmp_m: of the zero-moment point from the edge of the support polygon [m]; None likewise, or without feet.
        friction: horizontal push at the feet that would make them slip, as a share of the vertical force.
        not_applicable: margins that mean nothing for this robot.
        decides: whether the motion is called safe only if it holds for all of the set.
    """

    uncertainty: Mapping[str, Any]
    words: str
    joint_torque_nm: Worst | None
    zmp_m: Worst | None = None
    friction: Worst | None = None
    not_applicable: tuple[str, ...] = ()
    decides: bool = False

    @property
    def margins(self) -> dict[str, Worst | None]:
        """Those that apply, by field."""
        return {name: getattr(self, name) for name in _ROBUST if name not in self.not_applicable}

    @property
    def holds(self) -> bool:
        """Whether every limit is kept by every robot of the set."""
        return all(worst is not None and worst.holds for worst in self.margins.values())

    def violations(self) -> tuple[Violation, ...]:
        """What some robot of the set violates, one a margin; the value is the least margin."""
        found = []
        for name, worst in self.margins.items():
            kind = _ROBUST[name][3]
            if worst is None:
                found.append(Violation(kind, None, "all of the set", None, None))
            elif not worst.holds:
                found.append(Violation(kind, worst.time_s, worst.where, worst.value, worst.limit))
        return tuple(found)

    def to_json(self) -> dict[str, Any]:
        """The block ``robust`` of a motion's entry."""
        return {
            "uncertainty": dict(self.uncertainty),
            **{name: None if (worst := getattr(self, name)) is None else worst.value for name in _ROBUST},
            "holds": self.holds,
            "decides": self.decides,
            "worst": {name: None if worst is None else asdict(worst) for name, worst in self.margins.items()},
        }

    def in_words(self) -> str:
        """One line: for which robots, whether it holds, and the least margins or by how much they fall short."""
        said = []
        for name, worst in self.margins.items():
            what, factor, unit, _ = _ROBUST[name]
            if worst is None:
                said.append(f"{what} not computed")
                continue
            number = f"{what} {factor * worst.value:.3g} {unit}".rstrip()
            if not worst.holds:
                short = f"{factor * (worst.limit - worst.value):.3g} {unit}".rstrip()
                number += f", which falls short by {short}, of {worst.where} at {worst.time_s:.2f} s"
            said.append(number)
        return f"for {self.words}: {'holds' if self.holds else 'does not hold'}; {'; '.join(said)}"


def robustness_of_all(found: Sequence[Robustness]) -> str:
    """One line: for which robots, how many of several motions hold, and the least of their margins."""
    holding = sum(one.holds for one in found)
    said = []
    for name, (what, factor, unit, _) in _ROBUST.items():
        values = [worst.value for one in found if (worst := one.margins.get(name)) is not None]
        if values:
            said.append(f"{what} {factor * min(values):.3g} {unit}".rstrip())
    return f"for {found[0].words}: {holding} of {len(found)} hold; at least {', '.join(said)}"


_IN_WORDS = {
    "joint_position_rad": ("position", "rad"),
    "joint_velocity_rad_s": ("velocity", "rad/s"),
    "joint_acceleration_rad_s2": ("acceleration", "rad/s²"),
    "joint_jerk_rad_s3": ("jerk", "rad/s³"),
    "joint_torque_nm": ("torque", "N·m"),
    "self_collision_m": ("bodies apart", "m"),
    "zmp_m": ("zero-moment point inside", "m"),
}
MARGIN_FIELDS = tuple(item.name for item in fields(Margins))


@dataclass(frozen=True)
class Verdict:
    """The verdict on one motion.

    Attributes:
        motion: name of the motion, or the path that it was read from.
        margins: smallest margins over the motion.
        violations: everything found, in order of time; those without a time first.
        not_applicable: margins that mean nothing for this robot (``zmp_m`` of a robot without feet).
        readable: False where the motion is so broken that nothing could be computed from it.
        nearest: by margin of joints, the nearest to its limit in each unit: metres and radians are not compared.
        rehearsal: what it did in simulation, as it stands in the document; None where that was not tried.
        as_far_as: what has to hold of the robot's shapes, of which some are not known.
        robust: least margins over the robots that it may be; None where nobody asked for them.
    """

    motion: str
    margins: Margins
    violations: tuple[Violation, ...]
    not_applicable: tuple[str, ...] = ()
    readable: bool = True
    nearest: Mapping[str, tuple[Nearest, ...]] = field(default_factory=dict)
    rehearsal: Mapping[str, Any] | None = None
    as_far_as: tuple[str, ...] = ()
    robust: Robustness | None = None

    @property
    def safe(self) -> bool:
        """True if nothing is violated and every margin that applies could be computed."""
        return not self.violations and not self.not_computed

    @property
    def not_computed(self) -> tuple[str, ...]:
        """Margins that apply and that could not be computed; each makes the motion unsafe."""
        return tuple(
            name
            for name in MARGIN_FIELDS
            if getattr(self.margins, name) is None and name not in self.not_applicable
        )

    @property
    def reason(self) -> str:
        """Why it is not safe, in a few words; empty where it is."""
        if self.violations:
            more = f", and {len(self.violations) - 1} more" if len(self.violations) > 1 else ""
            return f"{self.violations[0]}{more}"
        return f"could not compute {', '.join(self.not_computed)}" if self.not_computed else ""

    def to_json(self) -> dict[str, Any]:
        """The motion's entry in an ``excite.check/1`` document, with the other fields too."""
        rehearsal = {} if self.rehearsal is None else {"rehearsal": dict(self.rehearsal)}
        robust = {} if self.robust is None else {"robust": self.robust.to_json()}
        return {
            "motion": self.motion,
            "safe": self.safe,
            "as_far_as": list(self.as_far_as),
            "margins": asdict(self.margins),
            "nearest": {name: [asdict(one) for one in items] for name, items in self.nearest.items()},
            "not_applicable": list(self.not_applicable),
            "violations": [asdict(violation) for violation in self.violations],
            **rehearsal,
            **robust,
        }

    def margins_in_words(self) -> str:
        """The smallest margins in one line; of a robot whose joints slide and turn, of both, and where."""
        said = []
        for name, (what, unit) in _IN_WORDS.items():
            value, nearest = getattr(self.margins, name), self.nearest.get(name, ())
            if len(nearest) == 1:
                said.append(f"{what} {nearest[0].value:.3g} {nearest[0].unit}")
            elif nearest:
                said.append(f"{what} " + " and ".join(f"{n.value:.3g} {n.unit} ({n.where})" for n in nearest))
            elif value is not None:
                said.append(f"{what} {value:.3g} {unit}")
            elif name not in self.not_applicable:
                said.append(f"{what} not computed")
        return ", ".join(said)

    def summary(self) -> str:
        """One line for a person."""
        if not self.safe:
            return f"{self.motion}: unsafe, {self.reason}"
        return f"{self.motion}: safe{conditions(self.as_far_as)}"


def conditions(as_far_as: Iterable[str]) -> str:
    """What a verdict holds under, to follow the word safe; empty where that is nothing."""
    said = " and ".join(as_far_as)
    return f", as far as {said}" if said else ""


def check_document(verdicts: Iterable[Verdict]) -> dict[str, Any]:
    """The ``excite.check/1`` document of several verdicts; ``safe`` if all are and there is at least one."""
    entries = [verdict.to_json() for verdict in verdicts]
    safe = bool(entries) and all(entry["safe"] for entry in entries)
    return {"schema": SCHEMA, "safe": safe, "motions": entries}


# Units of what limits a motion: those of a joint are what it moves in, radians or metres.

_UNITS = {
    "self_collision": "m",
    "zmp": "m",
    "robust_zmp": "m",
    "com": "m",
    "foot_lifted": "m",
    "foot_below_ground": "m",
    "foot_slip": "m",
    "slipped_in_rehearsal": "m",
    "drive_at_limit_in_rehearsal": "N·m",
    "foot_slip_speed": "m/s",
    "joint_position": "rad",
    "joint_velocity": "rad/s",
    "joint_acceleration": "rad/s²",
    "joint_jerk": "rad/s³",
    "joint_torque": "N·m",
    "robust_joint_torque": "N·m",
    "starts_moving": "rad/s",
    "ends_moving": "rad/s",
    "velocity_not_derivative": "rad/s",
    "acceleration_not_derivative": "rad/s²",
    "time_step": "s",
    "time_gap": "s",
    "time_not_increasing": "s",
    "rate_too_low": "Hz",
}
_SLIDING = {"rad": "m", "rad/s": "m/s", "rad/s²": "m/s²", "rad/s³": "m/s³", "N·m": "N"}
# Columns of a free base's velocity that are lengths a second.
_BASE = frozenset(("base.x", "base.y", "base.z"))


def unit_of(kind: str, where: str, sliding: frozenset[str]) -> str:
    """Unit of the value and the limit of something violated; empty where none is known.

    Args:
        kind: what is violated, such as ``joint_velocity``.
        where: joint, foot, pair of links or coordinate of the base.
        sliding: joints that slide.
    """
    unit = _UNITS.get(kind, "")
    return _SLIDING.get(unit, unit) if where in sliding | _BASE else unit
