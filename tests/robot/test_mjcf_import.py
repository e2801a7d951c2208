"""MuJoCo models as URDFs: the same dynamics, and a clear refusal of what a URDF cannot say."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from excite.errors import InputError, RobotError
from excite.robot.init_robot.files import write_scaffold
from excite.robot.loading import load_robot
from excite.robot.mjcf.conversion import convert_mjcf, is_mjcf
from excite.robot.shapes.mesh_files import read_meshes

pytestmark = pytest.mark.usefixtures("readers_here")

ODD = """
<mujoco model="odd">
  <compiler angle="degree" autolimits="true"/>
  <default><geom density="900"/></default>
  <asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3  .1 .2 0"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="base" pos="0.1 0 0.4" euler="0 20 0">
      <geom type="box" size=".1 .1 .05"/>
      <body name="shoulder" pos="0 0.05 0.1" euler="30 0 10">
        <joint name="yaw" axis="0 0 1" pos="0.01 0.02 0" range="-90 120"/>
        <joint name="pitch" axis="0.1 1 0.2" pos="0 -0.03 0.04" ref="10" range="-40 60"/>
        <geom type="capsule" fromto="0 0 0 0.02 0.1 0.3" size=".03"/>
        <body name="slider" pos="0 0 0.3" quat="0.9 0.1 0.3 -0.2">
          <joint name="reach" type="slide" axis="1 0 1" pos="0.05 0 0" range="-0.1 0.2"/>
          <geom type="mesh" mesh="wedge" pos="0.02 0 0" euler="0 0 40"/>
          <body pos="0 0.1 0"><geom type="ellipsoid" size=".02 .03 .04" contype="0" conaffinity="0"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="yaw" gear="20" ctrlrange="-2 2" ctrllimited="true"/>
    <position joint="pitch" kp="50" forcerange="-12 12"/>
  </actuator>
</mujoco>
"""


# The motor that the slide of the odd arm lacks.
REACH = '<motor joint="reach" ctrlrange="-3 3"/>'


def saved(text: str, folder: Path, name: str = "odd.xml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def inverse_dynamics_agree(mjcf: Path, urdf: str, base: pin.JointModel | None = None) -> None:
    """Torques of MuJoCo and of pinocchio, at random states of both models."""
    theirs = mujoco.MjModel.from_xml_path(str(mjcf))
    theirs.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    theirs.dof_damping[:], theirs.dof_armature[:], theirs.dof_frictionloss[:] = 0.0, 0.0, 0.0
    ours = pin.buildModelFromXML(urdf) if base is None else pin.buildModelFromXML(urdf, base)
    state, data = mujoco.MjData(theirs), ours.createData()
    rng = np.random.default_rng(1)
    first, free = (0, 0) if base is None else (7, 6)
    order = [ours.joints[ours.getJointId(theirs.joint(j).name)].idx_v for j in range(bool(free), theirs.njnt)]
    assert sorted(order) == list(range(free, ours.nv))
    places = [int(address) for address in theirs.jnt_qposadr[bool(free) :]]
    for _ in range(5):
        q, v, a = pin.neutral(ours), rng.normal(size=ours.nv), rng.normal(size=ours.nv)
        q[first:] = rng.uniform(-0.5, 0.5, ours.nq - first)
        state.qpos[places] = q[np.array(order) + first - free] + theirs.qpos0[places]
        state.qvel[free:], state.qacc[free:] = v[order], a[order]
        if free:
            q[:3] = rng.normal(size=3)
            state.qpos[:7] = np.r_[q[:3], 1.0, 0.0, 0.0, 0.0]
            state.qvel[:6], state.qacc[:6] = v[:6], a[:6]
            # MuJoCo's linear acceleration of a free body is in the world, without ω × v of the turning frame.
            state.qacc[:3] += np.cross(v[3:6], v[:3])
        mujoco.mj_inverse(theirs, state)
        tau = pin.rnea(ours, data, q, v, a)
        np.testing.assert_allclose(state.qfrc_inverse[free:], tau[order], atol=1e-9)
        np.testing.assert_allclose(state.qfrc_inverse[:free], tau[:free], atol=1e-9)


def test_joints_that_share_a_body_keep_the_dynamics(tmp_path: Path) -> None:
    path = saved(ODD, tmp_path)
    conversion = convert_mjcf(path)
    inverse_dynamics_agree(path, conversion.urdf)
    assert not conversion.floating
    assert any("'pitch' has ref" in note for note in conversion.notes)


def test_a_free_base_keeps_the_dynamics(tmp_path: Path) -> None:
    text = ODD.replace('<geom type="box"', '<freejoint name="root"/><geom type="box"')
    path = saved(text.replace('euler="0 20 0"', 'euler="0 0 20"'), tmp_path)
    conversion = convert_mjcf(path)
    assert conversion.floating
    inverse_dynamics_agree(path, conversion.urdf, pin.JointModelFreeFlyer())


def test_limits_geometry_and_torques_are_carried_over(tmp_path: Path) -> None:
    conversion = convert_mjcf(saved(ODD, tmp_path))
    urdf = conversion.write(tmp_path / "odd.urdf")
    model = pin.buildModelFromUrdf(str(urdf))
    order = [model.getJointId(name) - 1 for name in ("yaw", "pitch", "reach")]
    np.testing.assert_allclose(np.degrees(model.lowerPositionLimit[order[:2]]), [-90.0, -50.0])
    np.testing.assert_allclose(np.degrees(model.upperPositionLimit[order[:2]]), [120.0, 50.0])
    np.testing.assert_allclose(model.effortLimit[order[:2]], [40.0, 12.0])
    assert list(conversion.meshes) == ["meshes/wedge.stl"]
    # The mesh is stored about its own centre: its extents are those of the corners given.
    path = tmp_path / "meshes" / "wedge.stl"
    points = read_meshes([path])[path]
    assert len(np.unique(points.round(6), axis=0)) == 5
    assert np.linalg.norm(points.max(axis=0) - points.min(axis=0)) > 0.3
    text = conversion.urdf
    assert text.count("<visual>") == 1 and text.count("<cylinder") == 1 and text.count("<sphere") == 2


def test_a_file_of_a_collection_becomes_a_robot(data_dir: Path, tmp_path: Path) -> None:
    source = data_dir / "robot_models" / "iiwa14_menagerie.xml"
    conversion = convert_mjcf(source)
    bare = [line for line in source.read_text().splitlines() if "mesh" not in line or "compiler" in line]
    inverse_dynamics_agree(saved("\n".join(bare), tmp_path), conversion.urdf)
    written = write_scaffold(source, tmp_path / "mine")
    assert written.urdf.name == "iiwa14_menagerie.urdf" and "13 mesh files" in written.notes[0]
    robot = load_robot(written.description)
    assert robot.n_joints == 7 and robot.mass == pytest.approx(25.61)
    np.testing.assert_allclose(robot.limits.torque, [320, 320, 176, 176, 110, 40, 40])


def test_a_coupled_joint_becomes_a_mimic_joint(tmp_path: Path) -> None:
    equality = '<equality><joint joint1="reach" joint2="yaw" polycoef="0.1 -2 0 0 0"/></equality></mujoco>'
    conversion = convert_mjcf(saved(ODD.replace("</mujoco>", equality), tmp_path))
    assert '<mimic joint="yaw" multiplier="-2.0" offset="0.1"' in conversion.urdf


def test_objects_about_a_robot_are_no_part_of_it(tmp_path: Path) -> None:
    ball = '<body name="ball"><freejoint/><geom size=".1"/></body></worldbody>'
    conversion = convert_mjcf(saved(ODD.replace("</worldbody>", ball), tmp_path))
    assert conversion.urdf == convert_mjcf(saved(ODD, tmp_path, "alone.xml")).urdf
    assert not conversion.floating and "'ball'" in " ".join(conversion.notes)


def test_bodies_that_stand_for_joints_which_are_not_there_are_left_out(tmp_path: Path) -> None:
    text = ODD.replace('<geom type="box"', '<freejoint name="root"/><geom type="box"')
    spare = '<body name="spare" pos="0 0 20"><inertial pos="0 0 0" mass="1e-3" diaginertia="1e-3 1e-3 1e-3"/>'
    dummy = f'{spare}<joint name="waist"/></body></worldbody>'
    conversion = convert_mjcf(saved(text.replace("</worldbody>", dummy), tmp_path))
    assert conversion.floating and "waist" not in conversion.urdf and "'spare'" in " ".join(conversion.notes)


def with_loop(crank: str = "crank", more: str = "") -> str:
    """The odd arm with a bar on a crank and a link on that, which is pinned to the slider again."""
    link = '<body name="link" pos="0 .1 0"><joint name="link" axis="1 0 0"/><geom size=".02"/>{}</body>'
    bar = f'<body name="bar" pos="0 .2 0"><joint name="{crank}" axis="1 0 0"/><geom size=".03"/>'
    third = '<body name="end" pos="0 0 .1"><joint name="end" axis="1 0 0"/><geom size=".02"/></body>'
    text = ODD.replace('<body pos="0 0.1 0">', f'{bar}{link.format(third)}</body><body pos="0 0.1 0">')
    loop = '<equality><connect body1="end" body2="slider" anchor="0 .1 0"/></equality></mujoco>'
    return text.replace("</mujoco>", loop).replace("</actuator>", f"{more}</actuator>")


def test_joints_of_a_closed_loop_without_enough_motors_are_held_still(tmp_path: Path) -> None:
    written = write_scaffold(saved(with_loop(more=REACH), tmp_path), tmp_path / "out")
    assert any("fewer motors than freedoms are held still (crank, link, end)" in n for n in written.notes)
    assert set(load_robot(written.description).joint_names) == {"yaw", "pitch", "reach"}


def test_joints_of_a_closed_loop_follow_its_motor(tmp_path: Path) -> None:
    motor = '<motor joint="crank" ctrlrange="-3 3"/>'
    written = write_scaffold(saved(with_loop(more=motor), tmp_path), tmp_path / "out")
    robot = load_robot(written.description)
    assert set(robot.joint_names) - set(robot.driven_names) == {"link", "end"}
    assert robot.mechanism is not None and robot.mechanism.closure_gaps(robot.rest[None])[0] < 1e-9


FOLDED = """<mujoco model="folded"><compiler angle="radian"/><default><geom density="900" size=".01"/></default>
 <worldbody><body name="base"><geom type="box" size=".02 .02 .02"/>
  <body name="thigh"><joint name="thigh" axis="0 1 0" range=".2 1.2"/>
   <geom fromto="0 0 0 0 0 -.3" type="capsule"/>
   <body name="shank" pos="0 0 -.3"><joint name="shank" axis="0 1 0" range=".4 2.4"/>
    <geom fromto="0 0 0 0 0 .28" type="capsule"/></body></body>
  <body name="foot"><joint name="length" type="slide" axis="0 0 -1" range=".1 .58"/><geom/></body></body></worldbody>
 <equality><connect body1="foot" body2="shank" anchor="0 0 0"/></equality>
 <actuator><motor joint="length" ctrlrange="-300 300"/></actuator>
 <keyframe><key name="init" qpos=".841 1.459 .4"/></keyframe></mujoco>"""


def test_a_loop_folded_at_zero_is_closed_from_the_models_own_posture(tmp_path: Path) -> None:
    """As the legs of PAL's Kangaroo, whose motors change their length."""
    robot = load_robot(write_scaffold(saved(FOLDED, tmp_path), tmp_path / "out").description)
    assert robot.driven_names == ("length",)
    assert robot.mechanism is not None and robot.mechanism.closure_gaps(robot.rest[None])[0] < 1e-9


def test_more_motors_than_freedoms_are_held_still(tmp_path: Path) -> None:
    motors = "".join(f'<motor joint="{name}" ctrlrange="-3 3"/>' for name in ("crank", "link"))
    written = write_scaffold(saved(with_loop(more=motors), tmp_path), tmp_path / "out")
    assert any("more motors than freedoms are held still" in note for note in written.notes)


def test_joints_tied_by_a_fixed_tendon_or_a_polynomial_move_together(tmp_path: Path) -> None:
    """Against MuJoCo's own residual of these equalities at the configurations that were closed."""
    tip = '<body name="bar" pos="0 .2 0"><joint name="crank" axis="1 0 0"/><geom size=".03"/></body>'
    text = ODD.replace('<body pos="0 0.1 0">', f'{tip}<body pos="0 0.1 0">')
    tendon = '<tendon><fixed name="belt"><joint joint="crank" coef="2"/><joint joint="yaw" coef="-1"/></fixed></tendon>'
    ties = '<equality><tendon tendon1="belt" polycoef="0.05 0 0 0 0"/>'
    ties += '<joint joint1="reach" joint2="pitch" polycoef="0.01 0.05 0.1 0 0"/></equality>'
    path = saved(text.replace("</mujoco>", f"{tendon}{ties}</mujoco>"), tmp_path)
    robot = load_robot(write_scaffold(path, tmp_path / "out").description)
    assert set(robot.driven_names) == {"yaw", "pitch"}
    assert robot.mechanism is not None
    limits = robot.limits
    drawn = robot.mechanism.draw_configurations(
        np.random.default_rng(0), limits.position_lower, limits.position_upper, 5
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for q in drawn:
        for name, value in zip(robot.joint_names, q, strict=True):
            address = model.joint(name).qposadr[0]
            data.qpos[address] = value + model.qpos0[address]
        mujoco.mj_forward(model, data)
        kinds = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        assert kinds.sum() == 2
        assert np.abs(data.efc_pos[: data.nefc][kinds]).max() < 1e-9


def test_a_base_that_lies_in_its_own_axes_stands_upright_in_the_urdf(tmp_path: Path) -> None:
    text = ODD.replace('euler="0 20 0">', 'euler="90 0 0"><freejoint/>')
    conversion = convert_mjcf(saved(text, tmp_path))
    model = pin.buildModelFromXML(conversion.urdf, pin.JointModelFreeFlyer())
    base = model.frames[model.getFrameId("base", pin.BODY)].placement.rotation
    np.testing.assert_allclose(base, pin.rpy.rpyToMatrix(np.pi / 2, 0.0, 0.0), atol=1e-9)


FAULTS = {
    "ball joint": (
        '<joint name="yaw" axis="0 0 1" pos="0.01 0.02 0" range="-90 120"/>',
        "yaw.*is a ball joint",
    ),
    "loop": ("</mujoco>", "has no joint that moves"),
    "welded base": ("</mujoco>", "equality.*welds two bodies between which no joint moves"),
    "tendon": ("</mujoco>", "tendon 'rope'.*path in space"),
    "two robots": ("</worldbody>", "2 bodies that move on their own: 'base', 'other'"),
    "mesh": (
        'vertex="0 0 0  .1 0 0  0 .2 0  0 0 .3  .1 .2 0"',
        "'gone.stl' is not there, and the inertia of",
    ),
    "nonsense": ("<worldbody>", "MuJoCo cannot compile it"),
    "radians": (' range="-90 120"', r"no hinge turns further than 2.0 degrees: .* angle=\"radian\""),
}
FAULTY = {
    "ball joint": '<joint name="yaw" type="ball"/>',
    "loop": '<equality><weld body1="slider" body2="base"/></equality></mujoco>',
    "welded base": '<equality><weld body1="base"/></equality></mujoco>',
    "tendon": '<worldbody><site name="a"/><site name="b" pos="1 0 0"/></worldbody>'
    '<tendon><spatial name="rope"><site site="a"/><site site="b"/></spatial></tendon></mujoco>',
    "two robots": '<body name="other"><freejoint/><geom size=".1"/><body><joint/><geom size=".1"/></body></body>'
    "</worldbody>",
    "mesh": 'file="gone.stl"',
    "nonsense": "<worldbody><bodies/>",
    "radians": ' range="-1.6 2"',
}


@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_what_a_urdf_cannot_say_is_refused_by_name(fault: str, tmp_path: Path) -> None:
    old, message = FAULTS[fault]
    text = ODD.replace(old, FAULTY[fault])
    if fault == "ball joint":
        text = text.replace('<motor joint="yaw" gear="20" ctrlrange="-2 2" ctrllimited="true"/>', "")
        text = "\n".join(line for line in text.splitlines() if 'name="pitch"' not in line)
        text = "\n".join(line for line in text.splitlines() if 'joint="pitch"' not in line)
    if fault == "radians":
        text = text.replace('ref="10" range="-40 60"', 'range="-0.7 1"')
    if fault == "two robots":
        text = text.replace('<geom type="box"', '<freejoint name="root"/><geom type="box"')
    path = saved(text, tmp_path)
    with pytest.raises(RobotError, match=message):
        write_scaffold(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_ball_that_no_motor_turns_is_held_still_and_said(tmp_path: Path) -> None:
    """A caster: pinocchio finds the same masses at the same places as MuJoCo."""
    caster = '<body name="caster" pos="0 .1 -.2"><joint name="roll" type="ball"/><geom size=".05" mass=".3"/></body>'
    text = ODD.replace("</worldbody>", f"{caster}</worldbody>")
    path = saved(text, tmp_path)
    conversion = convert_mjcf(path)
    assert any("ball joints that no motor turns are held still (roll)" in note for note in conversion.notes)
    model = pin.buildModelFromXML(conversion.urdf)
    assert "roll" not in list(model.names)
    truth = mujoco.MjModel.from_xml_path(str(path))
    assert sum(i.mass for i in model.inertias) == pytest.approx(float(truth.body_mass.sum()), rel=1e-6)


def test_a_joint_that_no_motor_drives_is_held_still_and_said(tmp_path: Path) -> None:
    """An acrobot's shoulder: no command moves it, so that no motion of it can be safe."""
    written = write_scaffold(saved(ODD, tmp_path), tmp_path / "out")
    assert any("joints that no motor drives are held still (reach)" in note for note in written.notes)
    assert load_robot(written.description).joint_names == ("yaw", "pitch")


def test_joints_are_free_where_a_model_does_not_tell_its_motors(tmp_path: Path) -> None:
    bare = ODD[: ODD.index("<actuator>")] + "</mujoco>"
    of_body = ODD.replace("</actuator>", '<adhesion body="slider" ctrlrange="0 1"/></actuator>')
    for number, text in enumerate((bare, of_body)):
        written = write_scaffold(saved(text, tmp_path, f"odd_{number}.xml"), tmp_path / str(number))
        assert load_robot(written.description).joint_names == ("yaw", "pitch", "reach")


def test_the_keyframe_of_rest_is_the_posture(tmp_path: Path) -> None:
    """Angles count from the reference position, 10 degrees of the second joint."""
    key = '<keyframe><key name="other" qpos="0 0 0"/><key name="home" qpos="0.3 -0.2 0.1"/></keyframe>'
    path = saved(ODD.replace("</mujoco>", f"{key}</mujoco>"), tmp_path)
    found = convert_mjcf(path).posture
    assert found == pytest.approx({"yaw": 0.3, "pitch": -0.2 - np.radians(10.0), "reach": 0.1})


def test_a_joint_that_damping_locks_is_held_still_and_said(tmp_path: Path) -> None:
    text = ODD.replace('name="yaw"', 'name="yaw" damping="1e11"').replace(
        "</actuator>", f"{REACH}</actuator>"
    )
    path = saved(text, tmp_path)
    written = write_scaffold(path, tmp_path / "out")
    assert any("damping lets nothing move them are held still (yaw)" in note for note in written.notes)
    robot = load_robot(written.description)
    assert robot.joint_names == ("pitch", "reach")


def test_a_joint_whose_motor_moves_it_is_left_free_though_it_carries_nothing_yet(tmp_path: Path) -> None:
    """The last joint of an arm whose hand is another file's: its flange weighs next to nothing."""
    flange = (
        '<body name="flange"><joint name="turn" axis="0 0 1" damping="0.01"/>'
        '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>'
    )
    motor = '<actuator><motor joint="turn" ctrllimited="true" ctrlrange="-6.8 6.8"/></actuator></mujoco>'
    carried = ODD.replace("</worldbody>", flange)
    free = convert_mjcf(saved(carried.replace("</mujoco>", motor), tmp_path))
    assert not any("damping" in note for note in free.notes)
    held = convert_mjcf(saved(carried, tmp_path))
    assert any("damping lets nothing move them are held still (turn)" in note for note in held.notes)


def test_a_body_that_a_program_moves_ties_nothing(tmp_path: Path) -> None:
    """Models made for learning lead a hand by a weld to a mocap body."""
    extra = '<body name="hand" mocap="true"><geom size=".01" contype="0" conaffinity="0"/></body></worldbody>'
    weld = '<equality><weld body1="hand" body2="slider"/></equality></mujoco>'
    path = saved(ODD.replace("</worldbody>", extra).replace("</mujoco>", weld), tmp_path)
    conversion = convert_mjcf(path)
    assert not conversion.loops
    assert any("mocap" in note for note in conversion.notes)
    assert set(pin.buildModelFromXML(conversion.urdf).names) == {"universe", "yaw", "pitch", "reach"}


def test_files_that_are_there_stay(tmp_path: Path) -> None:
    path = saved(ODD, tmp_path)
    saved("<robot/>", tmp_path, "odd.urdf")
    with pytest.raises(InputError, match=r"odd\.urdf: exists already"):
        write_scaffold(path, tmp_path)
    assert (tmp_path / "odd.urdf").read_text() == "<robot/>"
    written = write_scaffold(path, tmp_path, overwrite=True)
    assert "joint of a MuJoCo" not in written.description.read_text() and written.urdf.stat().st_size > 1000
    # The second joint of a body has no mass of its own, and the description says so.
    assert "shoulder_before_1" in written.description.read_text()


def test_what_is_no_mujoco_model_is_told_apart(tmp_path: Path) -> None:
    assert is_mjcf(saved(ODD, tmp_path))
    assert not is_mjcf(saved("<robot name='x'/>", tmp_path, "a.xml"))
    assert not is_mjcf(saved("no xml", tmp_path, "b.xml")) and not is_mjcf(tmp_path / "c.xml")


def test_rotor_inertias_that_the_model_states_are_written(tmp_path: Path) -> None:
    """They turn with the joint: a heavy rotor leaves less acceleration, and nobody is asked for it."""
    plain = write_scaffold(saved(ODD, tmp_path), tmp_path / "plain")
    heavy = ODD.replace('name="yaw"', 'name="yaw" armature="4.5"', 1)
    written = write_scaffold(saved(heavy, tmp_path, "heavy.xml"), tmp_path / "heavy")
    assert not any("armature" in note for note in written.notes)
    robot, bare = load_robot(written.description), load_robot(plain.description)
    armature = robot.description.drives.armature
    assert armature is not None and armature.joints == {"yaw": 4.5}
    assert bare.description.drives.armature is None
    yaw = robot.joint_index("yaw")
    assert robot.limits.acceleration[yaw] == pytest.approx(0.3 * 40.0 / 4.5, rel=0.15)
    assert robot.limits.acceleration[yaw] < bare.limits.acceleration[yaw]
