"""Mistakes in a log are found, named with their cause, and none is seen where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from excite.doctor.examine import examine
from excite.finding import Finding
from excite.logs.files import load_log, save_log
from excite.logs.log import Cleaning, Log, LogHeader, Trial
from excite.logs.robot import nominal_robot
from excite.robot.loading import load_robot
from tests.identification.practice_log import arm_log, changed


def suspicions(robot, log) -> tuple[Finding, ...]:
    """What spoils a log."""
    return tuple(item for item in examine(robot, log).findings if item.severity == "spoils")


JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))


def signs(*flipped: int) -> np.ndarray:
    values = np.ones(7)
    values[list(flipped)] = -1.0
    return values


def order(*pairs: tuple[int, int]) -> list[int]:
    values = list(range(7))
    for i, j in pairs:
        values[i], values[j] = values[j], values[i]
    return values


# Motors that turn by the sum and the difference of two joints.
MOTORS = np.eye(7)
MOTORS[3:5, 3:5] = [[1.0, 1.0], [1.0, -1.0]]

FAULTS = {
    "degrees": (lambda t: replace(t, q=np.degrees(t.q)), "degrees", JOINTS),
    "revolutions": (lambda t: replace(t, q=t.q / (2.0 * np.pi)), "revolutions", JOINTS),
    "two joints exchanged": (
        lambda t: replace(t, q=t.q[:, order((1, 3))], tau=t.tau[:, order((1, 3))]),
        "order",
        (JOINTS[1], JOINTS[3]),
    ),
    "all joints reversed": (
        lambda t: replace(t, q=t.q[:, ::-1], tau=t.tau[:, ::-1]),
        "order",
        JOINTS[:3] + JOINTS[4:],
    ),
    "torques exchanged": (
        lambda t: replace(t, tau=t.tau[:, order((1, 2))]), "torque_order", (JOINTS[1], JOINTS[2]),
    ),
    "one torque turned": (lambda t: replace(t, tau=t.tau * signs(3)), "torque_sign", (JOINTS[3],)),
    "all torques turned": (lambda t: replace(t, tau=-t.tau), "torque_sign", JOINTS),
    "a position turned": (lambda t: replace(t, q=t.q * signs(1)), "position_sign", (JOINTS[1],)),
    "zeros of two joints a quarter turn off": (
        lambda t: replace(t, q=t.q + 0.5 * np.pi * np.array([0, -1, 0, 1, 0, 0, 0])),
        "zero_position", (JOINTS[1], JOINTS[3]),
    ),
    "torques before a gear of 100": (lambda t: replace(t, tau=t.tau / 100.0), "torque_scale", JOINTS),
    "positions exchanged": (lambda t: replace(t, q=t.q[:, order((2, 4))]), "order", (JOINTS[2], JOINTS[4])),
    "one in degrees": (
        lambda t: replace(t, q=t.q * np.where(np.arange(7) == 2, 180 / np.pi, 1.0), q_cmd=None),
        "degrees", JOINTS[2:3],
    ),
    "one in revolutions": (
        lambda t: replace(t, q=t.q / np.where(np.arange(7) == 1, 2.0 * np.pi, 1.0)), "revolutions", JOINTS[1:2],
    ),
    "half turns": (
        lambda t: replace(t, q=np.where(np.arange(7) == 2, np.mod(t.q, np.pi), t.q)), "whole_turns", JOINTS[2:3],
    ),
    "motors of a differential": (
        lambda t: replace(t, q=t.q @ MOTORS.T, tau=t.tau @ np.linalg.inv(MOTORS), q_cmd=None),
        "differential", JOINTS[3:5],
    ),
    "commands in degrees": (lambda t: replace(t, q_cmd=np.degrees(t.q_cmd)), "command_degrees", JOINTS),
    "a command turned": (lambda t: replace(t, q_cmd=t.q_cmd * signs(4)), "command_sign", JOINTS[4:5]),
    "a dead torque": (lambda t: replace(t, tau=t.tau * (np.arange(7) != 5)), "constant", (f"tau.{JOINTS[5]}",)),
    "time in milliseconds": (lambda t: replace(t, time=1e3 * t.time), "time_unit", ("time",)),
    "time that went back": (lambda t: replace(t, cleaning=Cleaning(reordered_rows=2)), "reordered_rows", ()),
    "a velocity turned": (
        lambda t: replace(t, v=np.gradient(t.q, t.time, axis=0) * signs(3)), "velocity", JOINTS[3:4],
    ),
    "torques in N·mm": (lambda t: replace(t, tau=1e3 * t.tau), "torque_size", JOINTS),
    "too short": (
        lambda t: replace(t, time=t.time[:60], q=t.q[:60], tau=t.tau[:60], q_cmd=None), "too_few_rows", (),
    ),
}  # fmt: skip
# A unit is said beside the sizes that it makes.
COMPANY = {"torques in N·mm": {"torque_scale"}}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_mistake_is_named_with_its_place(panda, log, fault):
    change, kind, places = FAULTS[fault]
    found = {item.kind: item for item in examine(panda, changed(log, change)).findings}
    assert found[kind].places == places and found[kind].figures and found[kind].text
    spoiling = {item.kind for item in found.values() if item.severity in {"fatal", "spoils"}}
    assert spoiling <= {kind} | COMPANY.get(fault, set())


def test_angles_of_a_differential_are_put_right(panda, log):
    motors = changed(
        log, lambda t: replace(t, q=t.q @ MOTORS.T, tau=t.tau @ np.linalg.inv(MOTORS), q_cmd=None)
    )
    for mended, trial in zip(examine(panda, motors).log.trials, log.trials, strict=True):
        np.testing.assert_allclose(mended.q, trial.q, atol=1e-12)
        np.testing.assert_allclose(mended.tau, trial.tau, atol=1e-9)


@pytest.mark.parametrize("torque", ["motor_side", "none"])
@pytest.mark.parametrize("some", [(0,), (1, 2)])
def test_trials_in_degrees_alone_are_converted(panda, log, some, torque):
    trials = tuple(replace(t, q=np.degrees(t.q)) if k in some else t for k, t in enumerate(log.trials))
    ill = changed(
        replace(log, trials=trials), lambda t: t if torque != "none" else replace(t, tau=None), torque=torque
    )
    chart = examine(panda, ill)
    (found,) = (item for item in chart.findings if item.kind == "degrees")
    assert found.trials == tuple(log.trials[k].name for k in some) and "alone" in found.text
    for mended, trial in zip(chart.log.trials, log.trials, strict=True):
        np.testing.assert_allclose(mended.q, trial.q, atol=1e-12)


@pytest.mark.parametrize(
    ("times", "unit"), [(0.7376, "lbf·ft: 0.738"), (8.851, "lbf·in: 8.85"), (141.6, "ozf·in: 142")]
)
def test_units_that_would_make_all_torques_so_large_are_named(panda, log, times, unit):
    said = [
        item.text for item in examine(panda, changed(log, lambda t: replace(t, tau=times * t.tau))).findings
    ]
    assert any(unit in text for text in said), said


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-9])
def test_no_unit_of_the_clock_hides_that_joints_are_faster_than_they_may_be(panda, log, unit):
    limits = panda.limits.velocity[[panda.joint_index(joint) for joint in JOINTS]]
    speeds = [np.abs(np.gradient(t.q, t.time, axis=0) / limits).max() for t in log.trials]

    def faster(trial):
        return replace(trial, time=trial.time * max(speeds) / 6.0 / unit, tau=None)

    charted = examine(panda, changed(log, faster, torque="none"))
    found = {item.kind: item for item in charted.findings}
    assert found["too_fast"].figures["share_of_limit"] == pytest.approx(6.0, rel=0.2)
    assert ("time_unit" in found) == (unit < 1.0)
    if unit < 1.0:
        assert found["time_unit"].figures["seconds"] == unit


def test_commands_that_never_change_are_compared_with_nothing(panda, log):
    """A column of 0.1 deviates by its rounding, and no channel is that many times as large."""
    held = changed(log, lambda t: replace(t, tau_cmd=np.full_like(t.q, 0.1)))
    assert not [item for item in examine(panda, held).findings if item.kind.startswith("command")]


def test_the_zeros_that_the_model_needs_are_stated(panda, log):
    turned = changed(log, lambda t: replace(t, q=t.q + np.pi * np.array([0, 0, 0, 0.5, 0, 0, 0])))
    (found,) = suspicions(panda, turned)
    assert f"add -90° to {JOINTS[3]}" in found.text


def test_a_zero_that_no_torque_tells_is_not_moved_along(panda, log):
    """An upright axis' quarter turn came for nothing with that of the joint beyond it."""
    shift = 0.5 * np.pi * np.array([0, 1, 0, 0, 0, 0, 0])
    found = suspicions(panda, changed(log, lambda t: replace(t, q=t.q + shift, tau=t.tau * signs(2))))
    assert {item.kind: item.places for item in found} == {
        "zero_position": (JOINTS[1],),
        "torque_sign": (JOINTS[2],),
    }


def test_motor_side_torques_called_link_side_are_named(panda, log):
    found = suspicions(panda, changed(log, lambda t: t, torque="link_side"))
    assert [item.kind for item in found] == ["torque_side"]
    assert found[0].figures["rotor_share"] > 0.3


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("side", ["motor_side", "link_side"])
def test_a_sound_log_raises_no_suspicion(panda, side, seed):
    log = arm_log(panda, seed, torque=side, trials=2)
    found = examine(panda, log).findings
    assert not [item for item in found if item.severity == "spoils"]
    with_speeds = changed(log, lambda t: replace(t, v=np.gradient(t.q, t.time, axis=0)))
    assert examine(panda, with_speeds).findings == found


def test_logs_without_torques_are_left_alone(panda, log):
    assert suspicions(panda, changed(log, lambda t: replace(t, tau=None), torque="none")) == ()


def test_weak_channels_are_named_and_move_nothing(panda, log) -> None:
    """A channel in another unit and one that reads nothing but noise are no exchange of joints."""
    rng = np.random.default_rng(1)

    def weaken(trial):
        tau = np.array(trial.tau)
        tau[:, 3] *= 0.02
        tau[:, 5] = 1e-3 * rng.standard_normal(len(tau))
        return replace(trial, tau=tau)

    found = suspicions(panda, changed(log, weaken))
    assert {(item.kind, item.places) for item in found} == {
        ("torque_scale", (JOINTS[3],)),
        ("weak_torque", (JOINTS[5],)),
    }


def test_a_torque_in_which_something_large_hides_the_bodies_is_no_dead_channel(panda, log) -> None:
    """A joint on which a cable pulled, of eight times its bodies' torque, was left out as a channel of noise."""

    def pulled(trial):
        tau = np.array(trial.tau)
        tau[:, 4] += 8.0 * np.sin(11.0 * trial.q[:, 4])
        return replace(trial, tau=tau)

    found = suspicions(panda, changed(log, pulled))
    assert "weak_torque" not in {item.kind for item in found}


def test_joints_declared_without_torque_raise_no_suspicion(panda, log) -> None:
    quiet = changed(log, lambda t: replace(t, tau=np.delete(t.tau, 3, 1).dot(np.delete(np.eye(7), 3, 0))))
    header = quiet.header.model_copy(update={"no_torque": (JOINTS[3],)})
    assert suspicions(panda, replace(quiet, header=header)) == ()


_DAMPER = """<robot name="damper"><link name="frame"/>
  <link name="rod"><inertial><mass value="1e-3"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="stroke" type="prismatic"><parent link="frame"/><child link="rod"/><axis xyz="1 0 0"/>
    <limit lower="-0.1" upper="0.1" effort="5000" velocity="1"/></joint></robot>
"""


def _damped(name: str, role: str, phase: float) -> Trial:
    """Dry friction that builds up over 8 mm after each reversal (Dahl 1968), seen at a rod without weight."""
    time = np.arange(0.0, 10.0, 2e-3)
    q = 0.03 * np.sin(2.0 * np.pi * 0.8 * time + phase) + 0.01 * np.sin(2.0 * np.pi * 0.3 * time)
    force, state = np.zeros_like(q), 0.0
    for i, way in enumerate(np.diff(q, prepend=q[0])):
        state += (way - abs(way) * state) / 0.008 if abs(way) < 0.008 else 0.0
        force[i] = 1e3 * state
    return Trial(name=name, role=role, time=time, q=q[:, None], tau=force[:, None])


def test_friction_that_builds_up_over_a_way_is_not_late(tmp_path) -> None:
    """It follows the velocity some 50 ms late, and no weight or inertia says that time has to do with it."""
    trials = (_damped("a", "identification", 0.3), _damped("b", "validation", 1.0))
    files = [{"file": f"{trial.name}.parquet", "role": trial.role} for trial in trials]
    said = {"schema": "excite.log/1", "robot": "damper.urdf", "base": "fixed", "rate_hz": 500}
    said |= {"joints": ["stroke"], "torque": "link_side", "modelled": ["rigid_body_fixed"], "trials": files}
    log = load_log(
        save_log(Log(LogHeader.model_validate(said), trials, robot_text=_DAMPER), tmp_path / "log")
    )
    chart = examine(nominal_robot(log), log)
    assert {item.kind for item in chart.findings} <= {"quantised", "too_few_rows"}
    assert not chart.doubts


def test_torques_of_a_logger_that_was_started_seconds_later_are_found(panda, log) -> None:
    """Two files whose clocks both begin at zero; before, signs and dead channels were said to be wrong."""

    def later(trial: Trial) -> Trial:
        rows = round(1.5 / float(np.median(np.diff(trial.time))))
        early = trial.rows(np.arange(len(trial.time) - rows))
        return replace(early, tau=trial.tau[rows:])

    chart = examine(panda, changed(log, later))
    (found,) = (item for item in chart.findings if item.severity == "spoils")
    assert found.kind == "torque_late" and found.repaired
    assert found.figures["late_s"] == pytest.approx(-1.5, abs=0.05)
    for trial, before in zip(chart.log.trials, log.trials, strict=True):
        # Rows for which no torque was logged are left out, the others have their own.
        rows = np.searchsorted(before.time, trial.time - 1e-6)
        assert rows[0] == pytest.approx(150, abs=5)
        rest = trial.tau - before.tau[rows]
        assert (rest.std(axis=0) < 0.2 * before.tau.std(axis=0)).sum() >= 6


def test_a_motion_that_repeats_itself_is_not_late_by_a_period(panda, log) -> None:
    """Two seconds, over and over: a period later all torques agree as well, and no better."""

    def repeated(trial: Trial) -> Trial:
        rows = np.tile(np.arange(200), len(trial.time) // 200)
        return replace(trial.rows(rows), time=trial.time[: len(rows)])

    assert "torque_late" not in {item.kind for item in examine(panda, changed(log, repeated)).findings}


def test_torques_that_are_too_large_each_by_a_factor_of_its_own_have_no_unit(panda, log) -> None:
    """What an arm with a load and uncalibrated torque constants had; of one factor for all they keep together."""
    apart = np.array([1.13, 1.44, 1.28, 2.18, 1.86, 1.65, 1.65])
    assert "torque_scale" not in {
        item.kind for item in suspicions(panda, changed(log, lambda t: replace(t, tau=t.tau * apart)))
    }
    (found,) = suspicions(panda, changed(log, lambda t: replace(t, tau=t.tau * 1.8)))
    assert found.kind == "torque_scale" and found.figures["factor"] == pytest.approx(1.8, rel=0.1)


@pytest.mark.parametrize("whole", [1.0, 100.0, 1000.0])
def test_shares_of_the_joints_limits_are_named_and_left_to_a_person(panda, log, whole) -> None:
    """To repair one joint of them would leave the others, and to repair all takes the nominal masses for the truth."""
    limits = np.array([panda.limits.torque[panda.joint_index(joint)] for joint in JOINTS])
    shares = changed(log, lambda t: replace(t, tau=whole * t.tau / limits))
    chart = examine(panda, shares)
    (found,) = (item for item in chart.findings if item.kind == "torque_scale")
    assert found.places == JOINTS and not found.repaired and "limits" in found.text
    np.testing.assert_allclose(chart.log.trials[0].tau, shares.trials[0].tau)


def test_currents_whose_constants_are_not_known_are_left_to_a_person(panda, log) -> None:
    constants = np.array([9.0, 14.0, 8.0, 12.0, 5.0, 6.0, 7.0])
    (found,) = suspicions(panda, changed(log, lambda t: replace(t, tau=t.tau / constants)))
    assert found.kind == "torque_scale" and found.places == JOINTS and not found.repaired


def test_a_joint_that_counts_whole_turns_is_not_in_degrees(panda, log):
    """The wrist turned once too often lies beyond three times its range, and inside it in degrees."""
    wound = changed(log, lambda t: replace(t, q=t.q + 4.0 * np.pi * np.array([0, 0, 0, 0, 0, 0, 1])))
    assert "degrees" not in {item.kind for item in examine(panda, wound).findings}


def test_a_seam_at_which_rows_are_lost_is_one(panda, log):
    """Over a gap a joint goes further than from row to row."""

    def wrapped(trial):
        low = np.median(trial.q[:, :2], axis=0)
        q = np.column_stack([low + (trial.q[:, :2] - low) % (2.0 * np.pi), trial.q[:, 2:]])
        seams = np.flatnonzero((np.abs(np.diff(q, axis=0)) > np.pi).any(axis=1))
        lost = (np.abs(np.arange(len(q))[:, None] - seams) < 4).any(axis=1)
        return replace(trial, q=q, q_cmd=None).rows(~lost)

    chart = examine(panda, changed(log, wrapped))
    kinds = {one.kind for one in chart.findings if one.severity != "note"}
    assert kinds <= {"whole_turns", "missing_rows"} and "whole_turns" in kinds
    for mended, trial in zip(chart.log.trials, log.trials, strict=True):
        turns = (np.interp(mended.time, trial.time, trial.q[:, 0]) - mended.q[:, 0]) / (2.0 * np.pi)
        assert np.ptp(turns) < 0.02 and abs(turns[0] - np.round(turns[0])) < 0.02


def test_positions_alone_tell_nothing(panda, log):
    """A bag of joint states without efforts; with commands, or of a robot on sensors, it would tell something."""
    header = log.header.model_copy(update={"torque": "none"})
    bare = tuple(replace(trial, tau=None, current=None, q_cmd=None) for trial in log.trials)
    found = examine(panda, replace(log, header=header, trials=bare)).findings
    assert [(item.kind, item.severity) for item in found if item.severity == "fatal"] == [
        ("no_torques", "fatal")
    ]
    commanded = tuple(replace(trial, q_cmd=trial.q) for trial in bare)
    assert not any(
        item.kind == "no_torques"
        for item in examine(panda, replace(log, header=header, trials=commanded)).findings
    )


@pytest.mark.parametrize(
    ("name", "off"),
    [
        ("panda", {1: 0.3, 3: -0.4}),
        ("panda", {1: 0.3, 3: 0.3, 5: 0.4}),
        ("iiwa14", {1: 0.25, 3: 0.3, 5: 0.4}),
        ("ur10", {1: 0.3, 2: -0.4}),
        ("ur10", {1: 0.3, 2: 0.25}),
    ],
)
def test_several_zeros_are_known_as_well_as_is_said(name, off):
    """What one of them is believed to be before the others are known is no zero."""
    robot = load_robot(name)
    healthy, moved = arm_log(robot, 3, trials=2), np.zeros(robot.n_joints)
    moved[list(off)] = list(off.values())
    chart = examine(robot, changed(healthy, lambda t: replace(t, q=t.q - moved, q_cmd=t.q_cmd - moved)))
    (found,) = (one for one in chart.findings if one.severity != "note")
    assert found.kind == "zero_position" and set(found.places) <= {robot.joint_names[j] for j in off}
    assert robot.joint_names[1] in found.places
    for joint in found.places:
        size, std = found.figures[f"add_{joint}_rad"], found.figures[f"std_{joint}_rad"]
        # Bodies up to 10 % off move a zero by up to a degree; one in thirty by more than two deviations and that.
        assert abs(size - moved[robot.joint_index(joint)]) < 2.0 * std + 0.02
        assert f"± {np.degrees(std):.1g}° to {joint}" in found.text
