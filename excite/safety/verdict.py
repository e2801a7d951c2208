"""What the independent check says about a motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields

from excite.data_tables import read_rows
from excite.display import Row, Tabled
from excite.finding import Finding
from excite.results import ADDED, HIDDEN, LEFT_OUT, Assumed, FilePath, Name, Stated, named, stated


@dataclass(frozen=True)
class Violation(Stated):
    """One thing that a motion must not do, at the first time at which it does it.

    Attributes:
        kind: what is violated, such as ``joint_velocity`` or ``zmp``.
        time_s: first time of it [s]; None where it has no time (a missing column).
        where: joint, foot, pair of links or coordinate.
        value: the offending value at that time, in SI units; None where it is not a finite number.
        limit: what it must not pass, same unit; None where there is no number.
        unit: of both, that of what the joint does: rad or m; empty where none is known.
    """

    kind: Name
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
class Nearest(Stated):
    """The joint that comes nearest to its limit, of those that slide or of those that turn.

    Attributes:
        where: its name.
        value: its margin, negative beyond the limit.
        unit: of the margin.
    """

    where: Name
    value: float
    unit: Name


@dataclass(frozen=True)
class Margins(Stated):
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
class Worst(Stated):
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
class LoadRange(Stated):
    """What may be carried.

    Attributes:
        link: that carries it.
        mass: from nothing to this [kg].
        position: where, in the link's frame [m].
    """

    link: Name
    mass: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Uncertainty(Stated):
    """The set of robots that margins are wanted for, as ``robot.yaml`` states it.

    Attributes:
        mass: of each body, as a share.
        com: centre of mass along each axis [m].
        inertia: principal moments of each body, as a share.
        payload: what may be carried.
        identified: file of an identification, whose ellipsoid stands in place of the shares.
        sigmas: standard deviations of that ellipsoid.
        stated: whether ``robot.yaml`` states it; else it is the default.
        words: the same for a person.
    """

    mass: float
    com: float
    inertia: float
    payload: LoadRange | None
    identified: FilePath | None = None
    sigmas: float = 2.0
    stated: bool = field(default=True, metadata=ADDED)
    words: str = field(default="", metadata=HIDDEN)


@dataclass(frozen=True)
class Robustness(Stated):
    """Least margins over a set of robots, those whose inertial parameters are as uncertain as stated.

    Attributes:
        uncertainty: the set.
        worst: by margin that applies, where and when it is least; null where it could not be computed.
        decides: whether the motion is called safe only if it holds for all of the set.
    """

    uncertainty: Uncertainty
    worst: Mapping[Name, Worst | None]
    decides: bool = False

    @property
    @stated
    def joint_torque_nm(self) -> float | None:
        """To the torque limit [N·m or N]."""
        return self._least("joint_torque_nm")

    @property
    @stated
    def zmp_m(self) -> float | None:
        """Zero-moment point to the edge of the support polygon [m]."""
        return self._least("zmp_m")

    @property
    @stated
    def friction(self) -> float | None:
        """Horizontal push at the feet that would make them slip, as a share of the vertical force."""
        return self._least("friction")

    def _least(self, name: str) -> float | None:
        found = self.worst.get(name)
        return None if found is None else found.value

    @property
    @stated
    def holds(self) -> bool:
        """Whether every limit is kept by every robot of the set."""
        return all(worst is not None and worst.holds for worst in self.worst.values())

    def violations(self) -> tuple[Violation, ...]:
        """What some robot of the set violates, one a margin; the value is the least margin."""
        found = []
        for name, worst in self.worst.items():
            kind = _ROBUST[name][3]
            if worst is None:
                found.append(Violation(kind, None, "all of the set", None, None))
            elif not worst.holds:
                found.append(Violation(kind, worst.time_s, worst.where, worst.value, worst.limit))
        return tuple(found)

    def in_words(self) -> str:
        """One line: for which robots, whether it holds, and the least margins or by how much they fall short."""
        said = []
        for name, worst in self.worst.items():
            what, factor, unit, _ = _ROBUST[name]
            if worst is None:
                said.append(f"{what} not computed")
                continue
            number = f"{what} {factor * worst.value:.3g} {unit}".rstrip()
            if not worst.holds:
                short = f"{factor * (worst.limit - worst.value):.3g} {unit}".rstrip()
                number += f", which falls short by {short}, of {worst.where} at {worst.time_s:.2f} s"
            said.append(number)
        return (
            f"for {self.uncertainty.words}: {'holds' if self.holds else 'does not hold'}; {'; '.join(said)}"
        )


def robustness_of_all(found: Sequence[Robustness]) -> str:
    """One line: for which robots, how many of several motions hold, and the least of their margins."""
    holding = sum(one.holds for one in found)
    said = []
    for name, (what, factor, unit, _) in _ROBUST.items():
        values = [worst.value for one in found if (worst := one.worst.get(name)) is not None]
        if values:
            said.append(f"{what} {factor * min(values):.3g} {unit}".rstrip())
    return f"for {found[0].uncertainty.words}: {holding} of {len(found)} hold; at least {', '.join(said)}"


MARGINS = {
    "joint_position_rad": ("joint position", "rad"),
    "joint_velocity_rad_s": ("joint velocity", "rad/s"),
    "joint_acceleration_rad_s2": ("joint acceleration", "rad/s²"),
    "joint_jerk_rad_s3": ("joint jerk", "rad/s³"),
    "joint_torque_nm": ("joint torque", "N·m"),
    "self_collision_m": ("bodies apart", "m"),
    "zmp_m": ("zero-moment point inside", "m"),
}
"""Margins by field: what a person calls each, and its unit."""
MARGIN_FIELDS = tuple(item.name for item in fields(Margins))


@dataclass(frozen=True)
class Rehearsed(Stated):
    """What a motion of a standing robot did in simulation, without any load: the worst over the robots that ran it.

    Attributes:
        robots: that ran it: ``model`` and, where its uncertainty is stated or has to be kept, the members of that set
            that lean furthest towards and away from the nearest edge of the support polygon.
        stands: whether it did not fall.
        slip_m: largest slip of a foot that stands [m].
        touches: whether parts other than soles touched each other or the ground.
        drive_share: largest torque of a drive, of its limit; one or more where it had no more to give [no unit].
    """

    robots: tuple[Name, ...]
    stands: bool
    slip_m: float
    touches: bool
    drive_share: float


@dataclass(frozen=True)
class Verdict(Stated):
    """The verdict on one motion.

    Attributes:
        motion: name of the motion, or the path that it was read from.
        margins: smallest margins over the motion.
        violations: everything found, in order of time; those without a time first.
        not_applicable: margins that mean nothing for this robot (``zmp_m`` of a robot without feet).
        readable: False where the motion is so broken that nothing could be computed from it.
        nearest: by margin of joints, the nearest to its limit in each unit: metres and radians are not compared.
        rehearsal: what it did in simulation; left out where that was not tried.
        as_far_as: what has to hold of the robot's shapes, of which some are not known, for what is safe to be so.
        robust: least margins over the robots that it may be; left out where nobody asked for them.
        file: that the motion was read from, relative to the document's folder.
    """

    motion: FilePath
    margins: Margins
    violations: tuple[Violation, ...]
    not_applicable: tuple[Name, ...] = ()
    readable: bool = field(default=True, metadata=HIDDEN)
    nearest: Mapping[Name, tuple[Nearest, ...]] = field(default_factory=dict)
    rehearsal: Rehearsed | None = field(default=None, metadata=LEFT_OUT)
    as_far_as: tuple[str, ...] = ()
    robust: Robustness | None = field(default=None, metadata=LEFT_OUT)
    file: FilePath | None = field(default=None, metadata=LEFT_OUT)

    @property
    @stated
    def safe(self) -> bool:
        """Whether nothing is violated and every margin that applies could be computed."""
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

    def margins_in_words(self) -> str:
        """The smallest margins in one line; of a robot whose joints slide and turn, of both, and where."""
        said = []
        for name, (title, unit) in MARGINS.items():
            what = title.removeprefix("joint ")
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


@dataclass(frozen=True, repr=False)
class CheckReport(Tabled, Stated):
    """Verdicts on several motions.

    Attributes:
        verdicts: one a motion, in order.
        assumed: what no file said of the robot, so that the verdicts hold as far as it does.
        robot: name of the robot that shall run them.
        robot_file: its file where it is not a bundled one, relative to the document's folder.
        findings: what spoils the robot's description itself, worst first.
    """

    SCHEMA = "excite.check/1"

    verdicts: tuple[Verdict, ...] = field(metadata=named("motions"))
    assumed: tuple[Assumed, ...] = ()
    robot: Name | None = None
    robot_file: FilePath | None = field(default=None, metadata=LEFT_OUT)
    findings: tuple[Finding, ...] = ()

    tables = ("motions", "violations")

    def rows(self, table: str) -> Sequence[Row]:
        """See :class:`~excite.display.Tabled`: verdict and smallest margins of each motion, or everything violated."""
        if table == "motions":
            return [
                {"motion": one.motion, "safe": one.safe, **one.margins.row(), "reason": one.reason}
                for one in self.verdicts
            ]
        return [found.row(motion=one.motion) for one in self.verdicts for found in one.violations]

    @property
    @stated
    def safe(self) -> bool:
        """Whether every motion is safe and there is at least one."""
        return bool(self.verdicts) and all(verdict.safe for verdict in self.verdicts)

    def summary(self) -> str:
        """A line a motion with its smallest margins below it, the total, and what the verdicts rest on."""
        unsafe = sum(not verdict.safe for verdict in self.verdicts)
        total = f"all {len(self.verdicts)} safe" if not unsafe else f"{unsafe} of {len(self.verdicts)} unsafe"
        lines = []
        for verdict in self.verdicts:
            margins = verdict.margins_in_words() if verdict.readable else ""
            lines += [verdict.summary(), *([f"  margins: {margins}"] if margins else [])]
            if verdict.robust is not None:
                lines.append(f"  {verdict.robust.in_words()}")
            if any(one.kind == "rate_too_low" for one in verdict.violations):
                lines.append(f"  {_NO_CURVE}")
        lines.append(total)
        if self.assumed:
            named = ", ".join(dict.fromkeys(one.what for one in self.assumed))
            lines.append(f"as far as what was assumed of the robot holds: {named}")
        return "\n".join(lines)


# What leads on where rows are too far apart.
_NO_CURVE = (
    "such rows tell no curve: write velocities beside the positions, 20 rows a second or more, or as the first line "
    'what the controller runs through them: # {"schema": "excite.motion/1", "curve": "linear"} (hold, blend)'
)

# Units of what limits a motion: those of a joint are what it moves in, radians or metres.

_UNITS = {row["kind"]: row["unit"] for row in read_rows(__file__, "units.csv")}
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
