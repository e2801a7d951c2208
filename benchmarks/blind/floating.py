"""Standing robots of a blind benchmark: exact dynamics of planned motions, contacts at the feet, noisy sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from benchmarks.blind.documents import CaseKind, HiddenEffect
from benchmarks.blind.standing_case import (
    ROBOTS,
    Drag,
    Jostle,
    Pull,
    SensorKind,
    Slosh,
    Table,
    Tether,
    Vector,
)
from benchmarks.blind.standing_effects import Bent, Mixed, Truth, Wobbly, true_recording
from excite.logs.columns import WRENCH_AXES
from excite.motion.generators.generator import leg_joints
from excite.simulation.effects.readings import Misaligned, Misplaced, WrenchBias
from excite.simulation.effects.registry import INJECTED_EFFECTS
from excite.simulation.true_parameters import box_parameters, deform_parameters
from excite.simulation.virtual_robot import Reading, nominal_robot

# Which effects, sensors and noise the standing cases of a battery have.

_KINDS: tuple[CaseKind, ...] = (
    "single",
    "none",
    "single",
    "single",
    "unknown",
    "single",
    "double",
    "single",
    "single",
    "none",
)
# Invisible where inertial parameters are free: part of them, or, over force plates, absorbed by them.
_NEEDS_GIVEN = frozenset({"payload", "link_inertia"})
_NEEDS_GIVEN_OVER_PLATES = frozenset({"base_orientation_bias", "encoder_offset", "link_length_error"})
# Pairs are drawn one from each.
_OF_SENSORS = ("sensor_gain", "sensor_bias", "sensor_crosstalk", "sensor_frame_offset")
_OF_THE_BODY = ("external_force", "unlogged_contact", "joint_elasticity", "payload", "encoder_offset")


@dataclass(frozen=True)
class FloatingDraft:
    """A standing case before it is simulated.

    Attributes:
        robot: name of the robot.
        kind: ``single``, ``double``, ``none`` or ``unknown``.
        effects: effects and their forms.
        sensors: ``force_plate`` or ``foot_ft``.
        fixed: whether inertial parameters are given.
        noise: factor on the usual noise.
    """

    robot: str
    kind: CaseKind
    effects: tuple[tuple[str, str], ...]
    sensors: SensorKind
    fixed: bool
    noise: float


def floating_draft(number: int, rng: np.random.Generator, robots: tuple[str, ...] = ROBOTS) -> FloatingDraft:
    """The case of a number: of ten, six have one effect, one has two, two have none and one something unknown.

    Effects go round in order; robots, sensors, forms and noise are drawn.

    Args:
        number: number of the case.
        rng: source of what is drawn.
        robots: to choose from.
    """
    robot = str(rng.choice(robots))
    kind, tens = _KINDS[number % 10], number // 10
    names = [name for name in FORMS if name != "unknown"]
    effects: list[str] = []
    if kind == "single":
        before = _KINDS[: number % 10].count("single")
        effects = [names[(tens * _KINDS.count("single") + before) % len(names)]]
    elif kind == "double":
        effects = [str(rng.choice(_OF_SENSORS)), str(rng.choice(_OF_THE_BODY))]
    elif kind == "unknown":
        effects = ["unknown"]
    if "soft_tissue" in effects and "human" in robots:
        robot = "human"
    sensors: SensorKind = "force_plate" if rng.random() < 0.5 else "foot_ft"
    given = bool({*effects} & _NEEDS_GIVEN) or (
        sensors == "force_plate" and bool({*effects} & _NEEDS_GIVEN_OVER_PLATES)
    )
    fixed = given or bool(rng.random() < 0.4)
    noise = 2.0 if number % 10 == 9 else float(rng.choice([1.0, 1.0, 1.0, 2.0]))
    forms = tuple((name, str(rng.choice(FORMS[name]))) for name in effects)
    return FloatingDraft(robot, kind, forms, sensors, fixed, noise)


# Places of a standing robot at which effects are hidden.


@dataclass(frozen=True, eq=False)
class Site:
    """An effect about to be hidden: into what, in which form, how large.

    Attributes:
        truth: the robot so far.
        effect: its name.
        form: its form.
        size: 1 for the usual size.
        rng: source of place and magnitude.
    """

    truth: Truth
    effect: str
    form: str
    size: float
    rng: np.random.Generator

    def sign(self) -> float:
        """One or minus one, either as likely."""
        return float(self.rng.choice([-1.0, 1.0]))

    def draw(self, low: float, high: float) -> float:
        """A magnitude between two bounds, times the effect's size."""
        return self.size * float(self.rng.uniform(low, high))

    def vector(self, low: float, high: float) -> Vector:
        """A random direction of a length between ``low`` and ``high``."""
        way = self.rng.standard_normal(3)
        x, y, z = (float(part) for part in self.draw(low, high) * way / np.linalg.norm(way))
        return x, y, z

    def one(self, names: tuple[str, ...]) -> str:
        """One of some names, each as likely."""
        return str(self.rng.choice(names))

    def found(self, place: str, value: float, **details: float) -> HiddenEffect:
        """What is hidden, with the numbers that describe it."""
        numbers = {name: float(x) for name, x in details.items()}
        return HiddenEffect(self.effect, place, float(value), self.form, numbers)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors of forces."""
        return tuple(sensor.name for sensor in self.truth.stand.robot.sensors)

    @property
    def measured(self) -> tuple[int, ...]:
        """Segments with mass that the sensors carry."""
        robot = self.truth.stand.robot
        beyond = {segment for sensor in robot.sensors for segment in sensor.excludes}
        masses = robot.nominal_parameters[::10]
        return tuple(k for k in range(len(robot.segments)) if k not in beyond and masses[k] > 0.0)

    @property
    def heavy(self) -> tuple[int, ...]:
        """Measured segments of at least a hundredth of the whole."""
        robot = self.truth.stand.robot
        masses = robot.nominal_parameters[::10]
        return tuple(k for k in self.measured if masses[k] >= 0.01 * robot.mass)

    @property
    def hands(self) -> tuple[int, ...]:
        """Last segments of at least 0.2 kg, feet and heads left out, and those before them."""
        robot = self.truth.stand.robot
        legs = {i + 1 for foot in robot.feet for i in leg_joints(robot, foot)}
        parents = [int(robot.model.parents[k + 1]) - 1 for k in range(len(robot.segments))]
        masses = robot.nominal_parameters[::10]
        ends = []
        for leaf in sorted(set(range(len(parents))) - set(parents) - legs):
            k = leaf
            while masses[k] < 0.2 and parents[k] >= 0:
                k = parents[k]
            if not {"head", "neck", "cervical"} & set(_name_words(robot.segments[k].link)):
                ends.append(k)
        return tuple(dict.fromkeys(ends))

    @property
    def joints(self) -> tuple[int, ...]:
        """Model joints that carry a fiftieth of the whole, or a sensor."""
        robot = self.truth.stand.robot
        carried = [float(inertia.mass) for inertia in robot.model.inertias]
        for joint in range(robot.model.njoints - 1, 1, -1):
            carried[int(robot.model.parents[joint])] += carried[joint]
        holding = {
            int(j) for sensor in robot.sensors if sensor.joint for j in robot.model.supports[sensor.joint]
        }
        return tuple(
            j for j in range(2, robot.model.njoints) if carried[j] > 0.02 * robot.mass or j in holding
        )

    def link(self, segment: int) -> str:
        """Name of a segment's link."""
        return self.truth.stand.robot.segments[segment].link

    def centre(self, segment: int) -> Vector:
        """Centre of mass in the frame of the segment's joint."""
        x, y, z = (float(c) for c in self.truth.stand.robot.model.inertias[segment + 1].lever)
        return x, y, z


def _name_words(link: str) -> list[str]:
    return link.lower().replace("-", "_").split("_")


# How large each effect is where it is hidden in a standing robot, and what it does there.

Hidden = tuple[Truth, HiddenEffect]

# Forms by effect; the first is the textbook's.
FORMS: dict[str, tuple[str, ...]] = {
    "payload": ("plain",),
    "link_inertia": ("plain",),
    "link_length_error": ("along", "askew"),
    "encoder_offset": ("plain",),
    "joint_elasticity": ("plain", "hardening"),
    "base_orientation_bias": ("plain",),
    "sensor_gain": ("axis", "all"),
    "sensor_bias": ("plain",),
    "sensor_crosstalk": ("forces", "moments"),
    "sensor_frame_offset": ("turned", "shifted", "both"),
    "external_force": ("tether", "cable"),
    "unlogged_contact": ("table", "soft"),
    "time_delay": ("plain",),
    "soft_tissue": ("plain",),
    "unknown": ("jostle", "drag", "slosh"),
}


def _hide_in_reading(s: Site, reading: Reading, found: HiddenEffect) -> Hidden:
    return replace(s.truth, readings=(*s.truth.readings, reading)), found


def _hide_pull(s: Site, pull: Pull, found: HiddenEffect) -> Hidden:
    return replace(s.truth, pulls=(*s.truth.pulls, pull)), found


def _hide_payload(s: Site) -> Hidden:
    robot, heavy = s.truth.stand.robot, s.heavy
    segment = int(s.rng.choice(s.hands if s.rng.random() < 0.6 and s.hands else heavy))
    mass = s.draw(0.012, 0.035) * robot.mass
    centre = np.array(s.centre(segment)) + s.vector(0.02, 0.1)
    phi = s.truth.phi.copy()
    phi[10 * segment : 10 * segment + 10] += box_parameters(mass, centre, np.array([0.08, 0.08, 0.12]))
    return replace(s.truth, phi=phi), s.found(s.link(segment), mass)


def _link_inertia(s: Site) -> Hidden:
    segment = int(s.rng.choice(s.heavy))
    block = s.truth.phi[10 * segment : 10 * segment + 10]
    density = 1.0 + s.sign() * min(s.draw(0.08, 0.3), 0.6)
    affine = np.eye(4)
    affine[:3, 3] = s.vector(0.01, 0.04)
    phi = s.truth.phi.copy()
    phi[10 * segment : 10 * segment + 10] = deform_parameters(block, affine, density)
    return replace(s.truth, phi=phi), s.found(s.link(segment), (density - 1.0) * block[0])


def _hide_length_error(s: Site) -> Hidden:
    robot = s.truth.stand.robot
    joint = int(s.rng.choice(s.joints))
    line = robot.model.jointPlacements[joint].translation
    shift = np.array(s.vector(0.015, 0.035))
    if s.form == "along" and np.linalg.norm(line) > 0.02:
        shift = s.sign() * np.linalg.norm(shift) * line / np.linalg.norm(line)
    model = s.truth.model.copy()
    pose = model.jointPlacements[joint]
    model.jointPlacements[joint] = pin.SE3(pose.rotation, pose.translation + shift)
    value = float(np.linalg.norm(shift))
    return replace(s.truth, model=model), s.found(str(robot.model.names[joint]), value)


def _hide_encoder_offset(s: Site) -> Hidden:
    robot = s.truth.stand.robot
    joint = str(robot.model.names[int(s.rng.choice(s.joints))])
    value = s.sign() * s.draw(0.03, 0.07)
    virtual = INJECTED_EFFECTS["encoder_offset"].inject(nominal_robot(robot), joint, value)
    return _hide_in_reading(s, virtual.readings[-1], s.found(joint, value))


def _soft_gear(s: Site) -> Hidden:
    robot = s.truth.stand.robot
    torque = np.abs(true_recording(s.truth, s.truth.stand.motions[2], 2).tau_link).max(axis=0)
    joints = np.flatnonzero(torque > 0.15 * torque.max())
    joint = int(s.rng.choice(joints))
    stiffness = float(torque[joint]) / s.draw(0.03, 0.08)
    hard = 1.0 / float(torque[joint]) if s.form == "hardening" else 0.0
    return _hide_in_reading(s, Bent(joint, stiffness, hard), s.found(robot.joint_names[joint], stiffness))


def _hide_tilt(s: Site) -> Hidden:
    rotation = np.array(s.vector(0.02, 0.045)) * [1.0, 1.0, 0.3]
    x, y, z = (float(part) for part in rotation)
    return _hide_in_reading(
        s, Misaligned((x, y, z)), s.found("base", float(np.linalg.norm(rotation)), x=x, y=y, z=z)
    )


def _hide_gain(s: Site) -> Hidden:
    sensor, gain = s.one(s.sensors), 1.0 + s.sign() * s.draw(0.04, 0.1)
    matrix, place = gain * np.eye(6), sensor
    if s.form == "axis":
        axis = int(s.rng.choice([0, 1, 2, 2, 3, 4]))
        matrix, place = np.eye(6), f"{sensor}.{WRENCH_AXES[axis]}"
        # What a foot carries sideways is little.
        matrix[axis, axis] = gain if axis == 2 else 1.0 + 2.0 * (gain - 1.0)
        gain = float(matrix[axis, axis])
    return _hide_in_reading(s, Mixed(sensor, tuple(map(tuple, matrix.tolist()))), s.found(place, gain))


def _hide_bias(s: Site) -> Hidden:
    sensor = s.one(s.sensors)
    weight = 9.81 * s.truth.stand.robot.mass
    fx, fy, fz = s.vector(0.012, 0.04)
    tx, ty, tz = s.vector(0.003, 0.008)
    bias = (fx * weight, fy * weight, fz * weight, tx * weight, ty * weight, tz * weight)
    return _hide_in_reading(s, WrenchBias(sensor, bias), s.found(sensor, float(np.linalg.norm(bias[:3]))))


def _hide_crosstalk(s: Site) -> Hidden:
    sensor = s.one(s.sensors)
    source = 2 if s.rng.random() < 0.7 else int(s.rng.integers(2))
    if s.form == "forces":
        target = int(s.rng.choice([k for k in range(3) if k != source]))
        share = s.sign() * s.draw(0.03, 0.08)
    else:
        target, share = int(s.rng.integers(3, 6)), s.sign() * s.draw(0.01, 0.03)
    matrix = np.eye(6)
    matrix[target, source] = share
    place = f"{sensor}.{WRENCH_AXES[source]}->{WRENCH_AXES[target]}"
    return _hide_in_reading(s, Mixed(sensor, tuple(map(tuple, matrix.tolist()))), s.found(place, share))


def _hide_misplaced_sensor(s: Site) -> Hidden:
    sensor, still = s.one(s.sensors), (0.0, 0.0, 0.0)
    turn = still if s.form == "shifted" else s.vector(0.015, 0.05)
    shift = still if s.form == "turned" else s.vector(0.006, 0.02)
    value = float(np.linalg.norm(turn if s.form != "shifted" else shift))
    return _hide_in_reading(s, Misplaced(sensor, turn, shift), s.found(sensor, value))


def _hide_held_contact(s: Site) -> Hidden:
    robot = s.truth.stand.robot
    segment = int(s.rng.choice(s.heavy if s.rng.random() < 0.5 or not s.hands else s.hands))
    data, weight = robot.model.createData(), 9.81 * robot.mass
    point = s.centre(segment)
    pin.forwardKinematics(robot.model, data, robot.rest)
    hooked = data.oMi[segment + 1].act(np.array(point))
    force = s.vector(0.02, 0.05)
    steady = (force[0] * weight, force[1] * weight, force[2] * weight)
    stiffness = 0.0 if s.form == "cable" else s.draw(0.02, 0.06) * weight
    x, y, z = (float(part) for part in hooked)
    pull = Tether(segment + 1, point, steady, stiffness, (x, y, z))
    return _hide_pull(s, pull, s.found(s.link(segment), float(np.linalg.norm(steady)), stiffness=stiffness))


def _hide_leaning_contact(s: Site) -> Hidden:
    robot = s.truth.stand.robot
    segment = int(s.rng.choice(s.hands or s.heavy))
    model, point = robot.model, s.centre(segment)
    data, heights = model.createData(), []
    for motion in s.truth.stand.motions:
        for q in motion.q[::20]:
            pin.forwardKinematics(model, data, q)
            heights.append(float(data.oMi[segment + 1].act(np.array(point))[2]))
    height = float(np.quantile(heights, s.rng.uniform(0.3, 0.6)))
    load = s.draw(0.025, 0.07) * 9.81 * robot.mass
    depth = 0.02 if s.form == "table" else 0.08
    way = s.rng.uniform(-0.2, 0.2, 2)
    pull = Table(segment + 1, point, height, depth, load, (float(way[0]), float(way[1])))
    return _hide_pull(s, pull, s.found(s.link(segment), load, height=height))


def _hide_delay(s: Site) -> Hidden:
    value = s.draw(0.012, 0.03)
    virtual = INJECTED_EFFECTS["time_delay"].inject(nominal_robot(s.truth.stand.robot), "wrench", value)
    return _hide_in_reading(s, virtual.readings[-1], s.found("wrench", value))


def _hide_soft_tissue(s: Site) -> Hidden:
    """On a segment of a limb or the trunk, at the first of its joints; massless axes come before its matter."""
    robot = s.truth.stand.robot
    model, heaviest = (
        robot.model,
        [k for k in s.heavy if k > 0 and robot.nominal_parameters[10 * k] > 0.02 * robot.mass],
    )
    segment = int(s.rng.choice(heaviest))
    joint = segment + 1
    while robot.nominal_parameters[10 * (int(model.parents[joint]) - 1)] == 0.0:
        joint = int(model.parents[joint])
    gain, hertz = s.vector(0.015, 0.04), float(s.rng.uniform(4.0, 9.0))
    wobbly = Wobbly(s.truth.model, joint - 2, gain, hertz, float(s.rng.uniform(0.1, 0.4)))
    return _hide_in_reading(s, wobbly, s.found(s.link(segment), float(np.linalg.norm(gain)), hertz=hertz))


def _hide_unknown(s: Site) -> Hidden:
    robot = s.truth.stand.robot
    segment = int(s.rng.choice((0, *s.heavy)))
    joint, point, weight = segment + 1, s.centre(segment), 9.81 * robot.mass
    if s.form == "jostle":
        value = s.draw(0.01, 0.03) * weight
        return _hide_pull(
            s, Jostle(joint, point, value, int(s.rng.integers(1 << 30))), s.found(s.link(segment), value)
        )
    if s.form == "drag":
        value = s.draw(0.06, 0.15) * weight
        return _hide_pull(s, Drag(joint, point, value), s.found(s.link(segment), value))
    value, hertz = s.draw(0.06, 0.15) * robot.mass, float(s.rng.uniform(0.6, 1.4))
    slosh = Slosh(1, s.centre(0), value, hertz, float(s.rng.uniform(0.03, 0.15)))
    return _hide_pull(s, slosh, s.found(s.link(0), value, hertz=hertz))


MAKERS: dict[str, Callable[[Site], Hidden]] = {
    "payload": _hide_payload,
    "link_inertia": _link_inertia,
    "link_length_error": _hide_length_error,
    "encoder_offset": _hide_encoder_offset,
    "joint_elasticity": _soft_gear,
    "base_orientation_bias": _hide_tilt,
    "sensor_gain": _hide_gain,
    "sensor_bias": _hide_bias,
    "sensor_crosstalk": _hide_crosstalk,
    "sensor_frame_offset": _hide_misplaced_sensor,
    "external_force": _hide_held_contact,
    "unlogged_contact": _hide_leaning_contact,
    "time_delay": _hide_delay,
    "soft_tissue": _hide_soft_tissue,
    "unknown": _hide_unknown,
}
