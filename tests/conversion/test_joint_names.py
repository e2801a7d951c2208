"""Columns whose names share words with the robot's joints, and differ: one to one, or asked about."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import excite
from excite.conversion.columns.families import clues_of
from excite.conversion.columns.joints import Placed, first_number, place_columns
from excite.conversion.columns.words import read_clue
from excite.conversion.guesses import UnclearError
from excite.conversion.recording import Column, Recording, Stream
from tests.conversion import written
from tests.conversion.test_habits import table
from tests.conversion.written import WHOLE

pytestmark = pytest.mark.usefixtures("unexamined", "readers_here")

ARMS = [f"openarm_{side}_joint{k}" for side in ("left", "right") for k in range(1, 8)]
UR = [f"ur5e_{name}_joint" for name in "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3".split()]
HAND = [f"{finger}_joint_{k}" for finger in ("index", "middle", "ring", "thumb") for k in range(4)]
LEGS = [
    f"{side}_{part}_joint"
    for side in ("left", "right")
    for part in "hip_pitch hip_roll hip_yaw knee ankle_pitch ankle_roll".split()
]
PAIR = [f"panda_{arm}_joint{k}" for arm in (1, 2) for k in range(1, 8)]
QUADRUPED = [f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("hip", "thigh", "calf")]


def placed(columns: list[str], joints: list[str]) -> Placed:
    clues = {column: read_clue(column, joints) for column in columns}
    return place_columns(columns, clues, joints, first_number(list(clues.values())))


def words(pattern: str, joints: list[str], *changes: tuple[str, str]) -> dict[str, str]:
    """Columns by joint: the joint's name without what all have, changed, in a pattern."""
    found = {}
    for joint in joints:
        name = re.sub(r"^(openarm|ur5e)_|_joint$", "", joint)
        for old, new in changes:
            name = re.sub(old, new, name)
        found[joint] = pattern.format(name)
    return found


CASES = {
    "a slash for the arm": (ARMS, words("{}.pos", ARMS, ("_joint", "/joint_"))),
    "a letter for the side": (ARMS, words("q_{}", ARMS, ("left_joint", "l_"), ("right_joint", "r_"))),
    "the side at the end": (ARMS, words("{}_pos", ARMS, (r"(\w+)_joint(\d)", r"j\2_\1"))),
    "counted from zero": (ARMS, words("{}_pos", ARMS, (r"joint(\d)", lambda m: f"j{int(m[1]) - 1}"))),
    "without the model's name": (UR, words("{}", UR)),
    "written together": (UR, words("{}_pos", UR, ("_", ""))),
    "a capital a word": (UR, words("q {}", UR, (r"(^|_)([a-z])", lambda m: m[2].upper()))),
    "short words": (UR, words("{}_pos", UR, ("shoulder", "sh"), ("wrist_", "wr"), ("elbow", "el"))),
    "two letters a leg": (LEGS, words("{}_pos", LEGS, (r"(l|r)\w+?_(.*)", r"\2_\1"))),
    "first letters of axes": (LEGS, words("{}_pos", LEGS, ("pitch", "p"), ("roll", "r"), ("yaw", "y"))),
    "two numbers": (PAIR, words("{}", PAIR, ("panda_", "arm"), ("joint", "q"))),
    "two numbers, from zero": (
        PAIR,
        words("{}", PAIR, (r"panda_(\d)_joint(\d)", lambda m: f"arm{int(m[1]) - 1}_q{int(m[2]) - 1}")),
    ),
    "legs by the word": (
        QUADRUPED,
        words("q {}", QUADRUPED, ("F", "front "), ("R([LR])", r"rear \1"), ("L_", "left_"), ("R_", "right_")),
    ),
    "a word in front of all": (QUADRUPED, words("follower_{}_pos", QUADRUPED)),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("share", [1.0, 0.6])
def test_words_and_numbers_tell_the_joints_in_any_order_and_of_a_part_of_them(case, share):
    joints, columns = CASES[case]
    pairs = list(columns.items())
    rng = np.random.default_rng(3)
    for _ in range(10):
        # The first is among them: without a 0 nobody knows that numbers are counted from it.
        others = 1 + rng.permutation(len(pairs) - 1)
        chosen = [pairs[k] for k in rng.permutation([0, *others[: round(share * len(others))]])]
        found = placed([column for _, column in chosen], joints)
        # What is placed is right; of a part, what is then open is said to be.
        assert {joint: column for joint, column in found.columns.items()}.items() <= dict(chosen).items()
        assert {c for doubt in found.doubts for c in doubt.columns} == set(found.left_over)
        if share == 1.0:
            assert found.columns == dict(chosen) and found.named


def test_an_arm_of_two_is_not_taken_for_the_first_one():
    found = placed([f"right/joint_{k}.pos" for k in range(1, 8)], ARMS)
    assert found.columns == {f"openarm_right_joint{k}": f"right/joint_{k}.pos" for k in range(1, 8)}


def test_fingers_of_which_some_are_called_otherwise_are_not_left_out():
    columns = [f"{joint}_pos" for joint in HAND[:8]] + [f"ring_{k}_pos" for k in range(4)]
    found = placed([*columns, *(f"pollex_{k}_pos" for k in range(4))], HAND)
    assert [found.columns[joint] for joint in HAND[8:12]] == columns[8:12]
    mixed = placed([f"pollex_{k}_pos" for k in (1, 0, 3)] + columns[:8], HAND)
    (doubt,) = mixed.doubts
    assert doubt.columns == ("pollex_1_pos", "pollex_0_pos", "pollex_3_pos")
    assert doubt.joints == tuple(HAND[8:])


def test_hands_beside_arms_of_models_without_hands_are_nobodys():
    """An Inspire hand's fingers were asked about: they might be the hips'."""
    arms = [f"left_{part}_joint" for part in ("shoulder_pitch", "elbow", "hip_pitch", "hip_roll", "knee")]
    columns = ["kLeftShoulderPitch", "kLeftElbow", "kLeftHandPinky", "kLeftHandThumbBend"]
    found = placed(columns, arms)
    assert found.columns == {arms[0]: columns[0], arms[1]: columns[1]}
    assert found.left_over == () and found.doubts == ()
    # Where the model has a hand they are its.
    thumb = [*arms, "left_hand_thumb_joint"]
    assert placed(columns[:2] + columns[3:], thumb).columns[thumb[-1]] == columns[3]


def test_columns_that_may_be_two_joints_are_none():
    found = placed(["hip_pitch_pos", "left_knee_pos"], LEGS)
    assert found.columns == {"left_knee_joint": "left_knee_pos"}
    assert found.doubts[0].joints == ("left_hip_pitch_joint", "right_hip_pitch_joint")


def test_two_columns_of_one_joint_are_none():
    found = placed(["left_knee_a_pos", "left_knee_b_pos", "right_knee_pos"], LEGS)
    assert found.columns == {"right_knee_joint": "right_knee_pos"}
    assert found.doubts[0].columns == ("left_knee_a_pos", "left_knee_b_pos")


def test_words_of_two_joints_in_one_name_are_none():
    found = placed(["wrist_pan_pos", "elbow_pos"], UR)
    assert found.columns == {"ur5e_elbow_joint": "elbow_pos"} and found.doubts


def tree(path: Path, joints: list[str]) -> Path:
    """Joints one after the other on one trunk."""
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="0.1 0 0"/><mass value="1"/>{inertia}</inertial>'
    text = ['<robot name="tree"><link name="trunk"/>']
    for k, joint in enumerate(joints):
        above = "trunk" if k == 0 else f"link_{joints[k - 1]}"
        text.append(f'<link name="link_{joint}">{inertial}</link>')
        text.append(
            f'<joint name="{joint}" type="revolute"><parent link="{above}"/><child link="link_{joint}"/>'
            f'<origin xyz="0.2 0 0"/><axis xyz="0 {k % 2} {1 - k % 2}"/>'
            '<limit lower="-3" upper="3" effort="60" velocity="9"/></joint>'
        )
    path.write_text("\n".join([*text, "</robot>"]))
    return path


def recording(path: Path, columns: list[str], torques: list[str] | None = None) -> Path:
    time = np.arange(400) / 100.0
    data = {"time": time} | {c: 0.5 * np.sin(2.0 * time + 0.3 * k) for k, c in enumerate(columns)}
    data |= {c: 5.0 * np.cos(2.0 * time + 0.3 * k) for k, c in enumerate(torques or [])}
    return table(path, data)


def test_a_conversion_says_what_it_took_for_what(tmp_path):
    names = [f"{side}/joint_{k}" for side in ("left", "right") for k in range(1, 8)]
    file = recording(tmp_path / "a.csv", [f"{n}.pos" for n in names], [f"{n}.torque" for n in names])
    done = excite.convert([file], tree(tmp_path / "r.urdf", ARMS), tmp_path / "log", WHOLE)
    assert done.columns["q.openarm_right_joint3"][0] == "right/joint_3.pos"
    assert done.columns["tau.openarm_left_joint7"][0] == "left/joint_7.torque"
    (said,) = (source for what, source, _ in done.guesses if what == "joints of q")
    assert "right/joint_3.pos = openarm_right_joint3" in said


@pytest.mark.parametrize("shape", ["a struct a joint", "a struct a signal"])
def test_structs_of_a_mat_go_by_their_names_whatever_their_order(shape, tmp_path):
    data, order = written.motion(), [2, 0, 1]
    names = [written.JOINTS[k] for k in order]
    if shape == "a struct a joint":
        rows = [(names[k], data["q"][:, at], data["tau"][:, at]) for k, at in enumerate(order)]
        fields = [("name", object), ("q", object), ("tau", object)]
    else:
        rows = [
            (f"{names[k]}_{kind}", data[kind][:, at]) for kind in ("q", "tau") for k, at in enumerate(order)
        ]
        fields = [("signalName", object), ("values", object)]
    savemat(tmp_path / "a.mat", {"time": data["time"], "parts": np.array(rows, dtype=fields)})
    arm = written.arm_urdf(tmp_path / "r.urdf")
    trial = excite.convert([tmp_path / "a.mat"], arm, tmp_path / "log", WHOLE).log.trials[0]
    np.testing.assert_allclose(trial.q, data["q"])
    np.testing.assert_allclose(trial.tau, data["tau"])


def test_bare_words_of_joints_are_positions(tmp_path):
    names = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3".split()
    file = recording(tmp_path / "a.csv", names, [f"{name}_effort" for name in names])
    done = excite.convert([file], tree(tmp_path / "r.urdf", UR), tmp_path / "log", WHOLE)
    assert [done.columns[f"q.{joint}"][0] for joint in UR] == names


def test_names_left_open_are_asked_about_and_a_map_of_those_alone_settles_it(tmp_path):
    names = [f"index_joint_{k}" for k in range(4)] + ["middle_x", "middle_z"]
    joints = HAND[:6]
    file = recording(tmp_path / "a.csv", ["middle_x_pos", *(f"{n}_pos" for n in names[:4]), "middle_z_pos"])
    robot = tree(tmp_path / "r.urdf", joints)
    with pytest.raises(UnclearError) as error:
        excite.convert([file], robot, tmp_path / "log")
    assert (
        "middle_x_pos, middle_z_pos are of cannot be told by their names: they may be middle_joint_0, middle_joint_1"
        in str(error.value)
    )
    stated = {"columns": {"q.middle_joint_0": "middle_z_pos", "q.middle_joint_1": "middle_x_pos"}}
    whole = WHOLE.model_dump(exclude_defaults=True)
    done = excite.convert([file], robot, tmp_path / "log", type(WHOLE).model_validate(whole | stated))
    assert [done.columns[f"q.{joint}"][0] for joint in joints] == [
        *(f"{n}_pos" for n in names[:4]),
        "middle_z_pos",
        "middle_x_pos",
    ]


@pytest.mark.parametrize("pattern", ["ang_{}_deg", "{}.pos", "q {} [rad]", "M_{}_Nm"])
@pytest.mark.parametrize(
    ("joints", "labels"),
    [
        (UR, ["sp", "sl", "el", "w1", "w2", "w3"]),
        (["base_yaw", "shoulder_pitch", "elbow_pitch", "wrist_roll"], ["by", "sp", "ep", "wr"]),
        (["shoulder_pitch", "shoulder_roll", "elbow"], ["sp", "sr", "elbow"]),
    ],
)
def test_a_word_that_means_something_else_is_a_joints_beside_labels_of_all_others(pattern, joints, labels):
    """``sp`` is a set point, elsewhere."""
    columns = tuple(Column(pattern.format(label), np.zeros(3)) for label in labels)
    clues = clues_of(Recording("x.csv", "x", (Stream("x", columns),)), joints)
    told = place_columns([column.name for column in columns], clues, joints, 1)
    assert told.columns == {joint: pattern.format(label) for joint, label in zip(joints, labels, strict=True)}
    assert not any(said.commanded for said in clues.values())


@pytest.mark.parametrize("unit", [("rad", "rpm"), ("deg", "deg_s"), ("deg", "rad_s")])
def test_a_rate_is_told_by_velocities_in_the_units_that_names_state(unit, tmp_path):
    time = np.arange(0.0, 8.0, 0.02)
    size = {"rad": 1.0, "deg": np.degrees(1.0), "rpm": 30.0 / np.pi, "deg_s": np.degrees(1.0), "rad_s": 1.0}
    columns = {}
    for k, joint in enumerate(written.JOINTS):
        columns[f"{joint}_pos_{unit[0]}"] = size[unit[0]] * np.sin((1.0 + 0.3 * k) * time)
        columns[f"{joint}_vel_{unit[1]}"] = size[unit[1]] * (1.0 + 0.3 * k) * np.cos((1.0 + 0.3 * k) * time)
    source = tmp_path / "log.csv"
    np.savetxt(
        source, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments=""
    )
    with pytest.raises(UnclearError) as told:
        excite.convert([source], written.arm_urdf(tmp_path / "arm.urdf"), tmp_path / "log", WHOLE)
    assert "rate_hz: 50}" in str(told.value) and "as the velocities say" in str(told.value)
