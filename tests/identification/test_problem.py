"""Logs turned into linear problems: rows against pinocchio, exact recovery from exact signals, faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, LogError, UnknownNameError
from excite.identification.problem import build_problem
from excite.logs.log import Log, LogHeader, Trial
from excite.robot.robot import Robot
from excite.rows.drive_terms import DRIVE_TERMS
from excite.rows.settings import ProblemSettings
from tests.identification.synthetic import smooth

RATE = 200.0
TIME = np.arange(1600) / RATE


def arm_log(robot: Robot, friction: float = 0.0, **header: object) -> Log:
    """Exact torques of the nominal arm with Coulomb friction, offset and rotor inertia at every joint."""
    rng = np.random.default_rng(1)
    middle = 0.5 * (robot.limits.position_lower + robot.limits.position_upper)
    q, v, a = smooth(rng, TIME, np.full(robot.n_joints, 1.5))
    q = q + middle
    data = robot.model.createData()
    tau = np.array([pin.rnea(robot.model, data, *row) for row in zip(q, v, a, strict=True)])
    tau += friction * np.tanh(v / 0.01) + 0.4 * v + 0.7 + 0.2 * a
    fields = {
        "schema": "excite.log/1",
        "robot": "robot.yaml",
        "base": "fixed",
        "rate_hz": RATE,
        "joints": robot.joint_names,
        "torque": "motor_side",
        "trials": [{"file": "t.parquet", "role": "identification"}],
    }
    return Log(
        LogHeader.model_validate(fields | header),
        (Trial("t", "identification", TIME, q, tau=tau, current=tau),),
    )


def floating_log(robot: Robot) -> Log:
    """Exact ankle wrenches of a robot in smooth free motion, the load shared 30 : 70."""
    rng = np.random.default_rng(2)
    d, dd, ddd = smooth(
        rng, TIME, np.concatenate([np.full(6, 0.1), np.full(robot.n_joints, 0.25)]), top_hz=0.8
    )
    model, data = robot.model, robot.model.createData()
    q = np.tile(robot.rest, (len(TIME), 1))
    q[:, 7:] += d[:, 6:]
    q[:, :3] += d[:, :3]
    q[:, 3:7] = [pin.Quaternion(pin.exp3(row)).coeffs() for row in d[:, 3:6]]
    # Twist and acceleration by finite differences of the pose, far finer than the samples.
    step = 1e-5
    shifted = {}
    for sign in (-1.0, 1.0):
        pose = d[:, :6] + sign * step * dd[:, :6] + 0.5 * step**2 * ddd[:, :6]
        shifted[sign] = [pin.SE3(pin.exp3(row[3:]), robot.rest[:3] + row[:3]) for row in pose]
    middle = [pin.XYZQUATToSE3(row[:7]) for row in q]
    twist = np.array(
        [pin.log6(x.actInv(y)).vector / (2 * step) for x, y in zip(shifted[-1.0], shifted[1.0], strict=True)]
    )
    spatial = np.array(
        [
            (pin.log6(m.actInv(y)).vector + pin.log6(m.actInv(x)).vector) / step**2
            for x, m, y in zip(shifted[-1.0], middle, shifted[1.0], strict=True)
        ]
    )
    v, a = np.hstack([twist, dd[:, 6:]]), np.hstack([spatial, ddd[:, 6:]])
    bare = model.copy()
    for sensor in robot.sensors:
        for segment in sensor.excludes:
            bare.inertias[segment + 1] = pin.Inertia.Zero()
    wrenches: dict[str, list] = {sensor.name: [] for sensor in robot.sensors}
    for row in zip(q, v, a, strict=True):
        total = pin.Force(pin.rnea(bare, data, *row)[:6])
        pin.forwardKinematics(model, data, row[0])
        for sensor, share in zip(robot.sensors, (0.3, 0.7), strict=True):
            in_base = data.oMi[1].actInv(data.oMi[sensor.joint] * sensor.placement)
            wrenches[sensor.name].append(share * in_base.actInv(total).vector)
    sensors = [
        {
            "name": s.name,
            "kind": s.kind,
            "parent": s.link,
            "xyz": list(s.placement.translation),
            "rpy": list(pin.rpy.matrixToRpy(s.placement.rotation)),
            "foot": s.link,
            "excludes": [robot.segments[k].link for k in s.excludes],
            "noise_force": 1.0,
            "noise_moment": 0.1,
        }
        for s in robot.sensors
    ]
    header = LogHeader.model_validate(
        {
            "schema": "excite.log/1",
            "robot": "robot.yaml",
            "base": "floating",
            "base_link": robot.base_link,
            "wrench": "on_robot_in_sensor_frame",
            "rate_hz": RATE,
            "joints": robot.joint_names[::-1],
            "sensors": sensors,
            "trials": [{"file": "t.parquet", "role": "identification"}],
        }
    )
    readings = {name: np.array(values) for name, values in wrenches.items()}
    trial = Trial("t", "identification", TIME, q[:, :6:-1].copy(), base=q[:, :7], wrenches=readings)
    return Log(header, (trial,))


def test_joint_rows_hold_exactly_at_the_true_parameters(panda: Robot) -> None:
    settings = ProblemSettings(drive_terms=("viscous", "coulomb", "offset", "armature"))
    problem = build_problem(panda, arm_log(panda, friction=0.5), settings)
    assert problem.n_params == 10 * panda.n_joints + 4 * panda.n_joints
    truth = np.concatenate([panda.nominal_parameters, np.repeat([0.4, 0.5, 0.7, 0.2], panda.n_joints)])
    residual = problem.residual(truth)
    for joint in problem.channel_names:
        rows = problem.rows_of(joint)
        # Filtering both sides alike keeps Coulomb friction exact; only the kinematics' own filter is left.
        assert np.sqrt(np.mean(residual[rows] ** 2)) < 2e-2 * np.std(problem.y[rows]) + 5e-3
    assert problem.parameter_names[0].endswith(".m")
    assert problem.parameter_names[-1] == f"armature.{panda.joint_names[-1]}"


def test_smooth_motion_is_reproduced_to_a_thousandth(panda: Robot) -> None:
    problem = build_problem(panda, arm_log(panda), ProblemSettings(cutoff_hz=15.0))
    index = {name: i for i, name in enumerate(problem.parameter_names)}
    truth = problem.prior.copy()
    for joint in panda.joint_names:
        for term, value in (("viscous", 0.4), ("coulomb", 0.0), ("offset", 0.7), ("armature", 0.2)):
            truth[index[f"{term}.{joint}"]] = value
    scale = np.sqrt(np.mean(problem.y**2))
    assert np.abs(problem.residual(truth)).max() < 1e-3 * scale


def test_base_rows_hold_exactly_at_the_true_parameters(g1: Robot) -> None:
    problem = build_problem(g1, floating_log(g1), ProblemSettings(cutoff_hz=10.0))
    assert problem.channel_names == ("fx", "fy", "fz", "tx", "ty", "tz")
    residual = problem.residual(problem.prior)
    weight = g1.mass * 9.81
    assert np.abs(residual[problem.channel < 3]).max() < 1e-3 * weight
    assert np.abs(residual[problem.channel >= 3]).max() < 1e-3 * weight
    links = {g1.segments[segment].link for segment in problem.unmeasured}
    assert links == {"left_ankle_roll_link", "right_ankle_roll_link"}
    for segment in problem.unmeasured:
        assert not problem.Y[:, g1.parameter_columns(segment)].any()
    assert (problem.weights[problem.channel == 5] != problem.weights[problem.channel == 0]).all()


def test_long_trials_in_blocks_give_the_same_rows(panda: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    log = arm_log(panda, friction=0.5)
    whole = build_problem(panda, log)
    monkeypatch.setattr("excite.rows.kinematics._BLOCK_BYTES", 8.0 * 7 * 99 * 300)
    blocks = build_problem(panda, log)
    np.testing.assert_allclose(blocks.Y, whole.Y, atol=1e-5 * np.abs(whole.Y).max())


def test_rows_in_gaps_are_left_out(panda: Robot) -> None:
    log = arm_log(panda)
    keep = (TIME < 3.0) | (TIME > 3.6)
    trial = log.trials[0]
    holed = replace(trial, time=TIME[keep], q=trial.q[keep], tau=trial.tau[keep])
    holed = replace(holed, cleaning=replace(holed.cleaning, missing_rows=int((~keep).sum())))
    problem = build_problem(panda, replace(log, trials=(holed,)))
    assert not ((problem.time > 2.95) & (problem.time < 3.65)).any()
    assert ((problem.time > 2.0) & (problem.time < 2.8)).any()


def test_gravity_and_currents_are_the_logs(panda: Robot) -> None:
    gains = dict.fromkeys(panda.joint_names, 2.0)
    upright = build_problem(panda, arm_log(panda))
    halved = build_problem(panda, arm_log(panda, torque="current"), ProblemSettings(drive_gains=gains))
    np.testing.assert_allclose(halved.y, 2.0 * upright.y)
    tilted = build_problem(panda, arm_log(panda, gravity=[9.81, 0.0, 0.0]))
    np.testing.assert_array_equal(tilted.robot.model.gravity.linear, [9.81, 0.0, 0.0])
    assert np.abs(tilted.Y - upright.Y).max() > 1.0
    np.testing.assert_array_equal(panda.model.gravity.linear, [0.0, 0.0, -9.81])


@pytest.mark.parametrize("term", ["encoder", "bending"])
def test_sensor_terms_explain_what_they_are_named_after(term: str, panda: Robot) -> None:
    """A log with the fault in it is predicted once the term has the fault's value."""
    log = arm_log(panda)
    trial, joint = log.trials[0], 3
    name = panda.joint_names[joint]
    if term == "encoder":
        value, label = 2e-3, f"encoder.{name}"
        q = trial.q.copy()
        q[:, joint] -= value
        faulty = replace(trial, q=q)
    else:
        value, label = 4e-3, f"bending.{name}.x"
        data = panda.model.createData()
        index = panda.model.getJointId(name)
        tau = trial.tau.copy()
        v, a = (
            np.gradient(trial.q, 1 / RATE, axis=0),
            np.gradient(np.gradient(trial.q, 1 / RATE, axis=0), 1 / RATE, axis=0),
        )
        for k in range(len(TIME)):
            pin.rnea(panda.model, data, trial.q[k], v[k], a[k])
            before = pin.SE3(panda.model.jointPlacements[index])
            turn = before.rotation.T @ data.liMi[index].rotation
            # The joint turns about z; across(z) starts with z × x = y.
            tau[k, joint] += value * (turn @ data.f[index].angular)[1]
        faulty = replace(trial, tau=tau)
    settings = ProblemSettings(drive_terms=("viscous", "coulomb", "offset", "armature", term))
    problem = build_problem(panda, replace(log, trials=(faulty,)), settings)
    truth = problem.prior.copy()
    for i, parameter in enumerate(problem.parameter_names):
        known = {"viscous": 0.4, "coulomb": 0.0, "offset": 0.7, "armature": 0.2, label: value}
        truth[i] = known.get(parameter, known.get(parameter.split(".")[0], truth[i]))
    without = truth.copy()
    without[problem.parameter_names.index(label)] = 0.0
    rows = problem.rows_of(name)
    with_it, bare = (np.std(problem.residual(t)[rows]) for t in (truth, without))
    assert with_it < 0.15 * bare


def test_terms_have_as_many_names_as_columns(panda: Robot) -> None:
    problem = build_problem(panda, arm_log(panda), ProblemSettings(drive_terms=tuple(DRIVE_TERMS)))
    assert len(problem.parameter_names) == problem.n_params == len(problem.prior)
    assert len(set(problem.parameter_names)) == problem.n_params
    assert problem.drive_spread is not None
    assert len(problem.drive_spread) == problem.n_params - problem.n_inertial


def test_faults_are_named(panda: Robot, g1: Robot) -> None:
    log = arm_log(panda)
    with pytest.raises(LogError, match="no trial with role 'validation'"):
        build_problem(panda, log, role="validation")
    with pytest.raises(LogError, match="unlike that of robot"):
        build_problem(g1, log)
    with pytest.raises(LogError, match="no torque per ampere"):
        build_problem(panda, arm_log(panda, torque="current"))
    with pytest.raises(LogError, match="has no torques"):
        build_problem(panda, arm_log(panda, torque="none"))
    still = replace(log.trials[0], q=np.zeros_like(log.trials[0].q))
    # A posture is one row a joint.
    with pytest.raises(LogError, match="rows"):
        build_problem(panda, replace(log, trials=(still,)))
    short = replace(log.trials[0], time=TIME[:30], q=log.trials[0].q[:30], tau=log.trials[0].tau[:30])
    with pytest.raises(LogError, match="too few"):
        build_problem(panda, replace(log, trials=(short,)), ProblemSettings(cutoff_hz=1.0))


def test_a_foot_is_not_counted_twice(g1: Robot) -> None:
    log = floating_log(g1)
    plate = log.header.sensors[0].model_copy(
        update={"name": "plate", "kind": "force_plate", "parent": "world", "excludes": ()}
    )
    header = log.header.model_copy(update={"sensors": (*log.header.sensors, plate)})
    with pytest.raises(LogError, match="both an ankle sensor and a force plate"):
        build_problem(g1, replace(log, header=header))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cutoff_hz", 0.0),
        ("cutoff_hz", float("nan")),
        ("order", 0),
        ("rate_hz", -1.0),
        ("coulomb_width", "x"),
    ],
)
def test_settings_out_of_bounds_are_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        ProblemSettings(**{name: value})


def test_settings_refuse_unknown_terms_and_gains() -> None:
    with pytest.raises(UnknownNameError, match="sticky"):
        ProblemSettings(drive_terms=("sticky",))
    with pytest.raises(InputError, match=r"drive_gains\.a"):
        ProblemSettings(drive_gains={"a": 0.0})
