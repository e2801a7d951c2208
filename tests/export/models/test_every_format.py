"""What holds for every format of a simulator: it is read elsewhere as it was meant, and what it lacks is said."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from defusedxml.ElementTree import parse

import excite
from excite.errors import InputError, NoSolutionError
from excite.export.models.model_format import JOINT_TERMS, SERVO_TERMS, Subject
from excite.export.models.simulator_model import SimulatorModel, prove_taken
from excite.export.models.subject import read_subject
from excite.export.registry import MODEL_FORMATS
from tests.export.models.foreign import (
    configuration,
    isaaclab,
    mjlab,
    mjlab_model,
    usd_model,
)
from tests.export.models.identified_folder import Known, known

pytestmark = pytest.mark.usefixtures("readers_here")

ROBOTS = ("ur10", "go2")


def joint_terms(name: str) -> list[str]:
    """Terms of joints that a format holds."""
    return [term for term in JOINT_TERMS if term in MODEL_FORMATS[name].held]


def servo_terms(name: str) -> list[str]:
    """Terms of servos that a format holds."""
    return [term for term in SERVO_TERMS if term in MODEL_FORMATS[name].held]


@pytest.fixture(scope="module", params=ROBOTS)
def given(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Known:
    # An offset, which no simulator's joint has, and a friction that came out below zero.
    name = request.param
    joint = {"ur10": "elbow_joint", "go2": "FL_hip_joint"}[name]
    return known(name, tmp_path_factory.mktemp(name), **{f"offset.{joint}": 0.7})


@pytest.fixture(scope="module", params=MODEL_FORMATS)
def written(
    request: pytest.FixtureRequest, given: Known, tmp_path_factory: pytest.TempPathFactory
) -> SimulatorModel:
    return excite.write_simulator_model(given.folder, request.param, tmp_path_factory.mktemp(request.param))


def in_mujoco(written: SimulatorModel, robot: Any) -> mujoco.MjModel:
    """The model of MuJoCo that each format's own reader makes."""
    main = written.folder / written.files[0]
    readers: dict[str, Callable[[], mujoco.MjModel]] = {
        "mjcf": lambda: mujoco.MjModel.from_xml_path(str(main)),
        "urdf": lambda: urdf_in_mujoco(main, robot),
        "usda": lambda: usd_model(main),
        "isaaclab": lambda: isaaclab_model(main),
        "mjlab": lambda: mjlab_model(configuration(main, mjlab())),
    }
    return readers[written.format]()


def urdf_in_mujoco(path: Path, robot: Any) -> mujoco.MjModel:
    root = parse(path).getroot()
    spec = mujoco.MjSpec.from_string(_without_shapes(path))
    if robot.floating:
        spec.body(robot.base_link).add_freejoint(name="root")
    model = spec.compile()
    for joint in root.findall("joint"):
        dynamics = joint.find("dynamics")
        if dynamics is not None and joint.get("name") in robot.joint_names:
            place = model.joint(joint.get("name")).dofadr[0]
            model.dof_damping[place] = float(dynamics.get("damping"))
            model.dof_frictionloss[place] = float(dynamics.get("friction"))
    return model


def _without_shapes(path: Path) -> str:
    from xml.etree import ElementTree

    root = parse(path).getroot()
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    extension = ElementTree.SubElement(root, "mujoco")
    ElementTree.SubElement(extension, "compiler", fusestatic="false", boundmass="0", boundinertia="0")
    return ElementTree.tostring(root, encoding="unicode")


def isaaclab_model(path: Path) -> mujoco.MjModel:
    """The USD that the configuration spawns, with the terms that it sets."""
    cfg = configuration(path, isaaclab())
    model = usd_model(Path(cfg.spawn.usd_path))
    group = cfg.actuators["joints"]
    for joint in group.joint_names_expr:
        place = model.joint(joint).dofadr[0]
        assert group.friction[joint] == group.dynamic_friction[joint]
        model.dof_damping[place] = group.viscous_friction[joint]
        model.dof_frictionloss[place] = group.dynamic_friction[joint]
        model.dof_armature[place] = group.armature[joint]
    return model


def inverse_dynamics(model: mujoco.MjModel, robot: Any, q: Any, v: Any, a: Any) -> np.ndarray:
    """Of the joints, by name; the base stands where the world is and does not move."""
    data = mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.gravity[:] = robot.description.gravity
    joints = [model.joint(name) for name in robot.joint_names]
    data.qpos[[joint.qposadr[0] for joint in joints]] = q
    if robot.floating:
        data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    places = [joint.dofadr[0] for joint in joints]
    data.qvel[places], data.qacc[places] = v, a
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse[places] + model.dof_frictionloss[places] * np.sign(v)


def reader_of(written: SimulatorModel, robot: Any) -> Callable[..., np.ndarray]:
    """Torques of the joints as MuJoCo finds them in what was written."""
    model = in_mujoco(written, robot)
    return lambda q, v, a: inverse_dynamics(model, robot, q, v, a)


def test_another_reader_finds_the_torques_of_what_was_identified(
    written: SimulatorModel, given: Known
) -> None:
    robot, n = given.robot, given.robot.n_joints
    torques, rng = reader_of(written, robot), np.random.default_rng(2)
    held = joint_terms(written.format)
    for _ in range(4):
        joint, v, a = rng.uniform(-2.0, 2.0, n), *rng.normal(size=(2, n))
        q, whole_v, whole_a = pin.neutral(robot.model), np.zeros(robot.model.nv), np.zeros(robot.model.nv)
        q[-n:], whole_v[-n:], whole_a[-n:] = joint, v, a
        data = robot.model.createData()
        bodies = pin.computeJointTorqueRegressor(robot.model, data, q, whole_v, whole_a) @ given.parameters
        columns = {"viscous": v, "coulomb": np.sign(v), "armature": a}
        wanted = bodies[-n:] + sum(columns[term] * given.term(term) for term in held)
        # Single precision of USD's numbers.
        room = 1e-6 if written.format in ("usda", "isaaclab") else 1e-9
        np.testing.assert_allclose(torques(joint, v, a), wanted, atol=room * np.abs(wanted).max())


def test_the_proof_counts_every_parameter_once(written: SimulatorModel, given: Known) -> None:
    proof, kind = written.proof, MODEL_FORMATS[written.format]
    bodies, joints = 10 * len(given.robot.segments), given.robot.n_joints
    # No diagnosis has said how late the motors are.
    servos = [term for term in servo_terms(kind.name) if term != "delay"]
    assert proof.felt + len(proof.unseen) == bodies + joints * (len(joint_terms(kind.name)) + len(servos))
    assert len(proof.not_held) == joints * (len(JOINT_TERMS) - len(joint_terms(kind.name)))
    assert proof.felt >= bodies // 2


def test_what_it_lacks_is_said_once_for_each(written: SimulatorModel, given: Known) -> None:
    kind = MODEL_FORMATS[written.format]
    lost = {item.parameter for item in written.lost}
    assert "offset" in lost
    assert {term for term in JOINT_TERMS if term in lost} == set(JOINT_TERMS) - set(kind.held)
    servos = set(SERVO_TERMS) - set(kind.held) - {"delay"}
    assert {term for term in SERVO_TERMS if term in lost} == servos & set(kind.lacks)
    with (written.folder / "lost.csv").open(encoding="utf-8") as stream:
        assert [row["parameter"] for row in csv.DictReader(stream)] == [
            item.parameter for item in written.lost
        ]


def test_what_changed_can_be_read_as_a_table(written: SimulatorModel, given: Known) -> None:
    with (written.folder / "changes.csv").open(encoding="utf-8") as stream:
        rows = {(row["place"], row["parameter"]): float(row["after"]) for row in csv.DictReader(stream)}
    for segment, ten in zip(given.robot.segments, given.parameters.reshape(-1, 10), strict=True):
        assert rows[segment.link, "mass"] == ten[0]
        np.testing.assert_allclose(rows[segment.link, "com_x"], ten[1] / ten[0])
    for joint, value in zip(given.robot.joint_names, given.term("viscous"), strict=True):
        assert rows[joint, "viscous"] == value
    document = json.loads((written.folder / "model.json").read_text())
    assert document["schema"] == "excite.model/1" and document["files"] == list(written.files)
    assert all((written.folder / name).is_file() for name in written.files)


@pytest.mark.parametrize("name", MODEL_FORMATS)
def test_each_term_is_held_or_its_lack_has_a_sentence(name: str) -> None:
    kind = MODEL_FORMATS[name]
    assert kind.name == name and len(kind.summary) > 10
    assert set(JOINT_TERMS) <= set(kind.held) | set(kind.lacks)
    # Limits that a file keeps from its author are no loss.
    assert {"kp", "kd", "delay"} <= set(kind.held) | set(kind.lacks)


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    folder = tmp_path_factory.mktemp("subject")
    known("ur10", folder)
    return read_subject(folder, folder / "out")


def _other(subject: Subject, inertial: np.ndarray | None = None, **drives: float) -> Subject:
    """A subject of which other values were found."""
    own = subject.drives | drives
    found = replace(
        subject.found,
        inertial=subject.parameters if inertial is None else inertial,
        drive_names=tuple(own),
        drives=np.array(list(own.values())),
    )
    return replace(subject, found=found)


@pytest.mark.parametrize("name", MODEL_FORMATS)
def test_a_writer_that_drops_a_parameter_is_found_out(name: str, subject: Subject) -> None:
    model_format, friction = MODEL_FORMATS.make(name), "coulomb.elbow_joint"
    # The last link's moment of inertia about its own axis, which hardly any torque shows, by a hundredth.
    turned = subject.parameters.copy()
    turned[59] *= 0.99
    slipped = _other(subject, **{friction: 1.01 * subject.drives[friction]})
    for written, what in ((_other(subject, turned), "wrist_3_link.Izz"), (slipped, friction)):
        with pytest.raises(NoSolutionError, match=rf"{re.escape(what)} is not what was found"):
            prove_taken(model_format, subject, model_format.render(written))


@pytest.mark.parametrize("name", [name for name in MODEL_FORMATS if servo_terms(name)])
def test_a_servo_that_is_not_what_was_said_is_found_out(
    name: str, subject: Subject, monkeypatch: pytest.MonkeyPatch
) -> None:
    model_format, term, original = MODEL_FORMATS.make(name), servo_terms(name)[0], Subject.servo
    with monkeypatch.context() as patch:
        patch.setattr(Subject, "servo", lambda own, one: original(own, one) * (0.9 if one == term else 1.0))
        misled = model_format.render(subject)
    with pytest.raises(NoSolutionError, match=rf"{term}\.shoulder_pan_joint.* not what was found"):
        prove_taken(model_format, subject, misled)


def test_nothing_is_written_of_what_was_not_proved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known("ur10", tmp_path)
    kind = MODEL_FORMATS["usda"]
    original = kind.render
    monkeypatch.setattr(
        kind, "render", lambda self, given: original(self, _other(given, 1.1 * given.parameters))
    )
    with pytest.raises(NoSolutionError, match=r"its torques are .* off"):
        excite.write_simulator_model(tmp_path, "usda", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", MODEL_FORMATS)
def test_the_same_result_gives_the_same_bytes(name: str, subject: Subject) -> None:
    first, second = (MODEL_FORMATS.make(name).render(subject).files for _ in range(2))
    assert dict(first) == dict(second)


def test_a_result_without_numbers_is_one_line(tmp_path: Path) -> None:
    given = known("ur10", tmp_path)
    file = given.folder / "identification.json"
    document = json.loads(file.read_text())
    document["standard_parameters"]["forearm_link"]["mass"] = None
    file.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"forearm_link.*a parameter is null"):
        excite.write_simulator_model(given.folder, "usda", tmp_path / "out")


@pytest.mark.parametrize("name", MODEL_FORMATS)
def test_a_joint_that_the_robot_holds_still_is_no_joint_of_the_model(name: str, tmp_path: Path) -> None:
    """Panda's fingers are held: what is made anew has no such joint, what is kept of its author has it."""
    given = known("panda", tmp_path)
    assert given.robot.description.locked_joints
    proof = excite.write_simulator_model(tmp_path, name, tmp_path / "out").proof
    assert proof.torque_error <= MODEL_FORMATS[name].tolerance
    assert proof.felt + len(proof.unseen) >= 10 * len(given.robot.segments)
