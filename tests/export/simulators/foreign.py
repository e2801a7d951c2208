"""Readers of the written formats that share nothing with the package: each ends in a model of MuJoCo.

USD and SDF are taken apart with a few patterns and put together again body by body; configurations in Python run on
stand-ins that know the fields that the libraries document, and no others.
"""

from __future__ import annotations

import dataclasses
import re
import sys
import types
from dataclasses import field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
DEGREE = np.pi / 180.0


@dataclasses.dataclass
class Pose:
    """A place and a turn (w, x, y, z), as they stand in files."""

    at: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn: np.ndarray = field(default_factory=lambda: np.array([1.0, 0, 0, 0]))

    def times(self, other: Pose) -> Pose:
        at, turn = np.zeros(3), np.zeros(4)
        mujoco.mju_rotVecQuat(at, other.at, self.turn)
        mujoco.mju_mulQuat(turn, self.turn, other.turn)
        return Pose(self.at + at, turn)

    def inverse(self) -> Pose:
        turn, at = np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(turn, self.turn)
        mujoco.mju_rotVecQuat(at, -self.at, turn)
        return Pose(at, turn)


def assembled(bodies: dict[str, dict[str, Any]], joints: dict[str, dict[str, Any]]) -> mujoco.MjModel:
    """A model of bodies (``mass``, ``com``, ``turn``, ``moments``) and joints (``parent``, ``child``, poses, terms)."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.boundmass = spec.compiler.boundinertia = 0
    made = {"": spec.worldbody}

    def add(name: str, parent: str, pose: Pose) -> Any:
        own = bodies[name]
        made[name] = made[parent].add_body(name=name, pos=pose.at, quat=pose.turn, explicitinertial=True)
        if own["mass"]:
            body = made[name]
            body.mass, body.ipos = own["mass"], own["com"]
            body.iquat, body.inertia = own["turn"], own["moments"]
        return made[name]

    for name in set(bodies) - {joint["child"] for joint in joints.values()}:
        add(name, "", Pose()).add_freejoint(name="root")
    waiting = dict(joints)
    while waiting:
        for name, joint in list(waiting.items()):
            if joint["parent"] not in made:
                continue
            del waiting[name]
            body = add(joint["child"], joint["parent"], joint["outer"].times(joint["inner"].inverse()))
            if joint["kind"] is not None:
                axis = np.zeros(3)
                mujoco.mju_rotVecQuat(axis, np.asarray(joint["axis"], float), joint["inner"].turn)
                pin = body.add_joint(name=name, type=joint["kind"], axis=axis, pos=joint["inner"].at)
                pin.damping, pin.frictionloss = [joint["viscous"], 0, 0], joint["coulomb"]
                pin.armature = joint.get("armature", 0.0)
    return spec.compile()


def usd_model(text: str) -> tuple[mujoco.MjModel, dict[str, dict[str, float]]]:
    """A model of a USD text, and the drives' attributes by joint, in the text's own units."""
    bodies: dict[str, dict[str, Any]] = {}
    joints: dict[str, dict[str, Any]] = {}
    drives: dict[str, dict[str, float]] = {}
    text = re.sub(r'^ +def Scope "\w+"\n +\{\n', "", text, flags=re.MULTILINE)
    top = re.search(r'^def Xform "(\w+)"', text, flags=re.MULTILINE)[1]
    for kind, name, head, inside in re.findall(
        r'^ {4,8}def (\w+) "(\w+)"(?: \(\n(.*?)\n +\))?\n +\{\n(.*?)^ {4,8}\}',
        text,
        flags=re.DOTALL | re.MULTILINE,
    ):
        says = dict(re.findall(r"^ +(?:\w+(?:\[\])? )+([\w:]+) = (.*)$", inside, flags=re.MULTILINE))
        if "PhysicsRigidBodyAPI" in head:
            turn = _numbers(says.get("physics:principalAxes", "1 0 0 0"))
            bodies[f"/{top}/{name}"] = {
                "mass": float(says.get("physics:mass", 0.0)),
                "com": _numbers(says.get("physics:centerOfMass", "0 0 0")),
                "turn": turn / np.linalg.norm(turn),
                "moments": _numbers(says.get("physics:diagonalInertia", "0 0 0")),
            }
        if kind.endswith("Joint"):
            poses = [
                Pose(
                    _numbers(says.get(f"physics:localPos{side}", "0 0 0")),
                    _numbers(says.get(f"physics:localRot{side}", "1 0 0 0")),
                )
                for side in "01"
            ]
            hinge = kind == "PhysicsRevoluteJoint"
            way = "angular" if hinge else "linear"
            assert kind == "PhysicsFixedJoint" or f"PhysxJointAxisAPI:{way}" in head
            own = says.get("excite:joint", name).strip('"')
            values = {key: float(v) for key, v in says.items() if re.fullmatch(r"-?[\d.e+-]+", v)}
            drives[own] = values
            joints[own] = {
                "kind": None if kind == "PhysicsFixedJoint" else HINGE if hinge else SLIDE,
                "parent": says.get("physics:body0", "").strip("<>"),
                "child": says["physics:body1"].strip("<>"),
                "outer": poses[0],
                "inner": poses[1],
                "axis": np.eye(3)["XYZ".index(says.get("physics:axis", '"X"').strip('"'))],
                "viscous": values.get(f"physxJointAxis:{way}:viscousFrictionCoefficient", 0)
                / (DEGREE if hinge else 1),
                "coulomb": values.get(f"physxJointAxis:{way}:dynamicFrictionEffort", 0),
                "armature": values.get(f"physxJointAxis:{way}:armature", 0),
            }
    return assembled(bodies, joints), drives


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in re.findall(r"[-\d.e+]+", text)])


def sdf_model(text: str) -> mujoco.MjModel:
    """A model of an SDF text."""
    (model,) = ElementTree.fromstring(text).findall("model")
    bodies, joints = {}, {}
    for link in model.findall("link"):
        says = {
            name: link.findtext(f"inertial/inertia/{name}", "0") for name in "ixx iyy izz ixy ixz iyz".split()
        }
        xx, yy, zz, xy, xz, yz = map(float, says.values())
        moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        axes *= np.linalg.det(axes)
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, axes.ravel())
        at = _six(link.findtext("inertial/pose", "0 0 0 0 0 0"))
        assert np.allclose(at.turn, [1, 0, 0, 0])
        bodies[link.get("name")] = {
            "mass": float(link.findtext("inertial/mass", "0")),
            "com": at.at,
            "turn": turn,
            "moments": moments,
        }
    for joint in model.findall("joint"):
        fixed = joint.get("type") == "fixed"
        parent = joint.findtext("parent")
        if not fixed:
            assert joint.find("pose").get("relative_to") == parent
        joints[joint.get("name")] = {
            "kind": None if fixed else HINGE if joint.get("type") == "revolute" else SLIDE,
            "parent": "" if parent == "world" else parent,
            "child": joint.findtext("child"),
            "outer": _six(joint.findtext("pose", "0 0 0 0 0 0")),
            "inner": Pose(),
            "axis": _numbers(joint.findtext("axis/xyz", "0 0 1")),
            "viscous": float(joint.findtext("axis/dynamics/damping", "0")),
            "coulomb": float(joint.findtext("axis/dynamics/friction", "0")),
        }
    return assembled(bodies, joints)


def _six(text: str) -> Pose:
    """Place, and roll, pitch and yaw about the fixed axes."""
    x, y, z, roll, pitch, yaw = (float(word) for word in text.split())
    turn = np.zeros(4)
    mujoco.mju_euler2Quat(turn, np.array([roll, pitch, yaw]), "XYZ")
    return Pose(np.array([x, y, z]), turn)


def _fields(name: str, *names: str) -> type:
    """A class that takes these keywords and no others."""
    return dataclasses.make_dataclass(name, [(one, Any, None) for one in names], kw_only=True)


# Fields as in the wheel of Isaac Lab 3.0.0, those that it calls deprecated left out.
_ACTUATOR = (
    "joint_names_expr actuator_effort_limit actuator_velocity_limit joint_effort_limit joint_velocity_limit stiffness "
    "damping armature friction dynamic_friction viscous_friction"
).split()
# As in the wheel of mjlab 1.6.0.
_MJLAB = (
    "target_names_expr transmission_type armature frictionloss viscous_damping delay_min_lag "
    "delay_max_lag delay_hold_prob delay_update_period delay_per_env_phase stiffness damping effort_limit"
).split()


def isaaclab() -> dict[str, types.ModuleType]:
    """Stand-ins of Isaac Lab's modules."""
    articulation = _fields(
        "ArticulationCfg", "spawn", "init_state", "actuators", "soft_joint_pos_limit_factor"
    )
    articulation.InitialStateCfg = _fields("InitialStateCfg", "pos", "rot", "joint_pos", "joint_vel")
    return {
        "isaaclab": types.ModuleType("isaaclab"),
        "isaaclab.sim": _module("isaaclab.sim", UsdFileCfg=_fields("UsdFileCfg", "usd_path")),
        "isaaclab.assets": _module("isaaclab.assets", ArticulationCfg=articulation),
        "isaaclab.actuators": _module(
            "isaaclab.actuators",
            ImplicitActuatorCfg=_fields("ImplicitActuatorCfg", *_ACTUATOR),
            DelayedPDActuatorCfg=_fields("DelayedPDActuatorCfg", *_ACTUATOR, "min_delay", "max_delay"),
        ),
    }


def mjlab() -> dict[str, types.ModuleType]:
    """Stand-ins of mjlab's modules."""
    entity = _fields("EntityCfg", "spec_fn", "init_state", "articulation", "collisions")
    entity.InitialStateCfg = _fields("InitialStateCfg", "pos", "rot", "joint_pos", "joint_vel")
    return {
        "mjlab": types.ModuleType("mjlab"),
        "mjlab.actuator": _module(
            "mjlab.actuator", BuiltinPositionActuatorCfg=_fields("BuiltinPositionActuatorCfg", *_MJLAB)
        ),
        "mjlab.entity": _module(
            "mjlab.entity",
            EntityCfg=entity,
            EntityArticulationInfoCfg=_fields(
                "EntityArticulationInfoCfg", "actuators", "soft_joint_pos_limit_factor"
            ),
        ),
    }


def _module(name: str, **members: Any) -> types.ModuleType:
    module = types.ModuleType(name)
    module.__dict__.update(members)
    return module


def configuration(path: Path, modules: dict[str, types.ModuleType]) -> Any:
    """The ``…_CFG`` that a configuration defines, run from its file with stand-ins for the library."""
    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    names: dict[str, Any] = {"__file__": str(path), "__name__": path.stem}
    try:
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    finally:
        for name, module in before.items():
            if module is None:
                del sys.modules[name]
    (found,) = (value for name, value in names.items() if re.fullmatch(r"[A-Z]\w*_CFG", name))
    return found


def mjlab_model(cfg: Any) -> mujoco.MjModel:
    """What mjlab makes of a configuration: its actuators' terms set in the model that ``spec_fn`` returns."""
    spec = cfg.spec_fn()
    assert len(spec.actuators) == 0
    for group in cfg.articulation.actuators:
        for joint in spec.joints:
            if any(re.fullmatch(pattern, joint.name) for pattern in group.target_names_expr):
                if group.armature is not None:
                    joint.armature = group.armature
                if group.frictionloss is not None:
                    joint.frictionloss = group.frictionloss
                if group.viscous_damping is not None:
                    joint.damping = [group.viscous_damping, 0, 0]
                motor = spec.add_actuator(
                    name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
                )
                motor.set_to_position(kp=group.stiffness, kv=group.damping)
                motor.forcelimited, motor.forcerange = True, [-group.effort_limit, group.effort_limit]
    return spec.compile()
