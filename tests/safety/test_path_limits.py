"""What limits the speed along a path, row by row, against inverse dynamics on the feet and plane geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from excite.motion.generators.generator import SupportPhase, leg_joints
from excite.motion.generators.registry import make_generator
from excite.robot.joint_values import per_joint
from excite.robot.loading import load_robot
from excite.safety.filter import make_repairs
from excite.safety.repairs.draft import Draft
from excite.safety.repairs.rows import PathLimits, Shares, friction_rows, support_of

SHARES = Shares()


CASES = [("g1", "leg_swing"), ("g1", "squat"), ("hrp2like", "leg_swing")]


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def limits(request: pytest.FixtureRequest) -> PathLimits:
    """The limits along a path over one foot and both, over both throughout, and over one broad foot."""
    name, generator = request.param
    robot = load_robot(name)
    candidate = make_generator(generator).candidates(robot, 1, np.random.SeedSequence(4))[0]
    draft = Draft(candidate)
    for repair in make_repairs(robot)[:2]:
        outcome = repair.repair(draft)
        assert isinstance(outcome, Draft)
        draft = outcome
    assert draft.path is not None
    return PathLimits(draft.candidate, draft.path, SHARES)


class Instant:
    """What a knot of a path needs at a speed, computed without the package."""

    def __init__(self, limits: PathLimits, k: int, rate: float, slope: float) -> None:
        robot = self.robot = limits.path.robot
        knots = limits.path.knots
        self.s, self.q = float(knots.s[k]), knots.q[k]
        self.v = knots.twist[k] * rate
        self.a = knots.curvature[k] * rate**2 + knots.twist[k] * slope
        self.data = robot.model.createData()
        pin.forwardKinematics(robot.model, self.data, robot.rest)
        self.soles = {
            foot.name: np.array([self.data.oMi[foot.joint].act(c) for c in foot.sole]) for foot in robot.feet
        }
        self.wrench = self._wrench(self.v, self.a)
        nothing = np.zeros(robot.model.nv)
        still = self._wrench(nothing, nothing)
        self.weight_at = np.array([-still[4], still[3]]) / still[2]
        phases = [p for p in limits.candidate.phases if p.start <= self.s <= p.end]
        self.feet = min((phase.feet for phase in phases), key=len)
        borders = [end for phase in limits.candidate.phases for end in (phase.start, phase.end)]
        self.from_border = min(abs(self.s - border) for border in borders)
        self.patterns = {phase.feet for phase in limits.candidate.phases}

    def _wrench(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        tau = pin.rnea(self.robot.model, self.data, self.q, v, a)
        return pin.XYZQUATToSE3(self.q[:7]).act(pin.Force(tau[:6])).vector

    def corners(self, feet: tuple[str, ...]) -> np.ndarray:
        return np.vstack([self.soles[foot.name] for foot in self.robot.feet if foot.name in feet])[:, :2]

    def inradius(self, feet: tuple[str, ...]) -> float:
        corners = self.corners(feet)
        planes = ConvexHull(corners).equations
        return -(planes[:, :2] @ corners.mean(axis=0) + planes[:, 2]).max()

    def drive_torques(self) -> np.ndarray:
        """Torques of the joints with the load on the feet shared by their distance from the weight's line."""
        robot = self.robot
        centres = {name: sole.mean(axis=0) for name, sole in self.soles.items()}
        shares = dict.fromkeys(self.feet, 1.0)
        if len(self.feet) == 2:
            first, second = (foot.name for foot in robot.feet)
            line = (centres[second] - centres[first])[:2]
            part = float(np.clip((self.weight_at - centres[first][:2]) @ line / (line @ line), 0.0, 1.0))
            shares = {first: 1.0 - part, second: part}
        middle = sum(share * centres[name] for name, share in shares.items())
        moment = self.wrench[3:] - np.cross(middle, self.wrench[:3])
        pin.forwardKinematics(robot.model, self.data, self.q)
        poses = {foot.name: self.data.oMi[foot.joint].copy() for foot in robot.feet}
        external = pin.StdVec_Force()
        for _ in range(robot.model.njoints):
            external.append(pin.Force.Zero())
        for foot in robot.feet:
            if foot.name in shares:
                force = shares[foot.name] * self.wrench[:3]
                about_origin = shares[foot.name] * moment + np.cross(centres[foot.name], force)
                external[foot.joint] += poses[foot.name].actInv(pin.Force(force, about_origin))
        tau = pin.rnea(robot.model, self.data, self.q, self.v, self.a, external)
        assert np.abs(tau[:6]).max() < 1e-6, "the feet's forces hold the base"
        return tau[6:]


def instants(limits: PathLimits) -> list[tuple[int, float, float]]:
    n = len(limits.path.s)
    return [(k, rate, slope) for k in range(3, n, n // 9) for rate, slope in ((0.0, 0.0), (1.9, -1.3))]


def values(limits: PathLimits, k: int, rate: float, slope: float, kind: str) -> np.ndarray:
    rows = limits.rows(limits.path.knots)
    columns = [i for i, label in enumerate(rows.labels) if label[0] == kind]
    total = rows.static + rows.curved * rate**2 + rows.driven * slope
    return total[k, columns]


def test_contact_rows(limits: PathLimits) -> None:
    robot = limits.path.robot
    weight = robot.mass * np.linalg.norm(robot.model.gravity.linear)
    lifts = any(len(phase.feet) == 1 for phase in limits.candidate.phases)
    seen, broad = set(), False
    for k, rate, slope in instants(limits):
        now = Instant(limits, k, rate, slope)
        corners, relative = now.corners(now.feet), now.wrench / weight
        centre, one = corners.mean(axis=0), len(now.feet) == 1
        seen.add(len(now.feet))
        # Zero-moment point.
        planes = np.unique(np.round(ConvexHull(corners).equations, 9), axis=0)
        share = SHARES.zmp_one_foot if one else SHARES.zmp_shift if lifts else SHARES.zmp_both_feet
        margin = np.full(
            len(planes), min(SHARES.zmp, share * min(now.inradius(feet) for feet in now.patterns))
        )
        if one:
            (free,) = (foot.name for foot in robot.feet if foot.name not in now.feet)
            aside = now.soles[free].mean(axis=0)[:2] - centre
            facing = planes[:, :2] @ aside > 0.7 * np.linalg.norm(aside)
            assert facing.any()
            nearness = np.clip(now.from_border - 0.5, 0.0, 1.0)
            inwards = np.maximum(0.0, margin[facing] - SHARES.zmp_inwards)
            broad |= bool((nearness * inwards).max() > 0.0)
            margin[facing] -= nearness * inwards
        zmp = np.array([-now.wrench[4], now.wrench[3]]) / now.wrench[2]
        distance = -(planes[:, :2] @ zmp + planes[:, 2])
        expected = 10.0 * relative[2] * (margin - distance)
        found = values(limits, k, rate, slope, "zmp")
        padded = np.r_[expected, np.zeros(len(found) - len(expected))]
        assert np.allclose(np.sort(found), np.sort(padded), atol=1e-8)
        # Friction: |f_x| + |f_y| + |m_z|/r within the share of what the coefficient allows.
        turning = now.wrench[5] - (centre[0] * now.wrench[1] - centre[1] * now.wrench[0])
        soles = [now.soles[name] for name in now.feet]
        lever = np.mean([np.linalg.norm(sole - sole.mean(axis=0), axis=1).mean() for sole in soles])
        friction = min(foot.friction for foot in robot.feet) * (
            SHARES.friction_one_foot if one else SHARES.friction
        )
        used = abs(now.wrench[0]) + abs(now.wrench[1]) + abs(turning) / lever
        found = values(limits, k, rate, slope, "friction")
        assert found.max() == pytest.approx(used / weight - friction * relative[2], abs=1e-8)
        assert len(found) == 8
        # Load.
        found = values(limits, k, rate, slope, "weight_share")
        assert found == pytest.approx([SHARES.weight - relative[2]])
    assert seen == ({1, 2} if lifts else {2})
    assert broad is (robot.name == "hrp2like"), (
        "there alone the edges that face the free foot may be approached"
    )


def test_torque_rows_of_legs_and_upper_body(limits: PathLimits) -> None:
    robot = limits.path.robot
    legs = [joint for foot in robot.feet for joint in leg_joints(robot, foot)]
    share = np.full(robot.n_joints, SHARES.torque)
    share[legs] = SHARES.leg_torque
    drives, nothing = robot.description.drives, np.zeros(robot.n_joints)
    viscous, coulomb, armature = (
        per_joint(block, robot.joint_names, nothing)
        for block in (drives.viscous, drives.coulomb, drives.armature)
    )
    friction = coulomb + viscous * SHARES.velocity * robot.limits.velocity
    limit = np.maximum(share * robot.limits.torque - friction, 0.3 * robot.limits.torque)
    for k, rate, slope in instants(limits):
        now = Instant(limits, k, rate, slope)
        tau = now.drive_torques() + armature * now.a[6:]
        found = values(limits, k, rate, slope, "joint_torque")
        assert np.allclose(found, np.r_[tau / limit, -tau / limit] - 1.0, atol=1e-7)


def test_acceleration_rows(limits: PathLimits) -> None:
    robot = limits.path.robot
    limit = SHARES.acceleration * robot.limits.acceleration
    for k, rate, slope in instants(limits):
        a = Instant(limits, k, rate, slope).a[6:]
        found = values(limits, k, rate, slope, "joint_acceleration")
        assert np.allclose(found, np.r_[a / limit, -a / limit] - 1.0)


def test_labels_name_each_joint_in_both_directions(limits: PathLimits) -> None:
    robot = limits.path.robot
    rows = limits.rows(limits.path.knots)
    assert (
        rows.static.shape == rows.curved.shape == rows.driven.shape == (len(limits.path.s), len(rows.labels))
    )
    names = list(robot.joint_names)
    for kind in ("joint_acceleration", "joint_torque"):
        assert [where for label, where in rows.labels if label == kind] == names + names


def test_between_knots_rows_are_interpolated(limits: PathLimits) -> None:
    knots = limits.path.s
    at_knots, again = limits.rows(limits.path.knots), limits.rows(limits.path.sample(knots.copy()))
    dynamic = [i for i, label in enumerate(at_knots.labels) if label[0] == "joint_torque"]
    for name in ("static", "curved", "driven"):
        assert np.allclose(getattr(at_knots, name), getattr(again, name), atol=1e-9)
    between = limits.rows(limits.path.sample(knots[40:43] + 0.25 * np.diff(knots)[40:43]))
    expected = 0.75 * at_knots.static[40:43] + 0.25 * at_knots.static[41:44]
    assert np.allclose(between.static[:, dynamic], expected[:, dynamic])


def test_speed_is_bounded_by_joints_and_phases(limits: PathLimits) -> None:
    robot = limits.path.robot
    phases = (SupportPhase(0.0, 1.0, ("left_foot",), 2.0), SupportPhase(1.0, 3.0, ("left_foot",), 0.5))
    bounded = replace(limits, candidate=replace(limits.candidate, phases=phases))
    s = np.array([0.0, 0.5, 1.0, 1.5, 3.0, 3.5])
    assert bounded.phase_bound(s).tolist() == [np.inf, 2.0, np.inf, 0.5, np.inf, np.inf]
    bound, knots = bounded.speed_bound(), limits.path.knots
    for k in (5, 20, 50):
        twist = np.abs(knots.twist[k, 6:])
        fastest = min(
            SHARES.velocity * robot.limits.velocity[j] / twist[j]
            for j in range(robot.n_joints)
            if twist[j] > 0.0
        )
        assert bound[k] == pytest.approx(min(fastest, bounded.phase_bound(knots.s[k : k + 1])[0]))


def test_friction_rows_are_a_pyramid_about_the_feet_s_middle() -> None:
    sole = np.array([[0.3, 0.1, 0.0], [0.5, 0.1, 0.0], [0.5, 0.2, 0.0], [0.3, 0.2, 0.0]])
    support = support_of([sole, sole + np.array([0.0, 0.3, 0.0])], 0.8)
    assert support.centre == pytest.approx([0.4, 0.3])
    assert support.radius == pytest.approx(np.hypot(0.1, 0.05))
    assert support.inradius == pytest.approx(0.1)
    force, spin = np.array([0.2, -0.1, 0.9]), 0.03
    wrench = np.r_[force, np.cross([0.4, 0.3, 0.0], force)]
    wrench[5] += spin
    rows = friction_rows(wrench[None], support, 0.5)[0]
    assert rows.max() == pytest.approx(0.2 + 0.1 + spin / support.radius - 0.5 * 0.8 * 0.9)
    assert len(set(np.round(rows, 9))) == 8
