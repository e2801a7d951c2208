"""Consumers' own readers of the written formats: each ends in a model of MuJoCo.

USD is read by Pixar's library; configurations in Python run on stand-ins that know the fields that the libraries
document, and no others.
"""

from __future__ import annotations

import dataclasses
import re
import sys
import types
from dataclasses import field
from pathlib import Path
from typing import Any

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


def usd_model(path: Path) -> mujoco.MjModel:
    """A model of what Pixar's own library finds in a USD file."""
    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    bodies, joints = {}, {}

    def value(prim: Any, name: str) -> Any:
        return prim.GetAttribute(name).Get()

    for prim in stage.Traverse():
        if prim.HasAPI(UsdPhysics.RigidBodyAPI):
            mass = UsdPhysics.MassAPI(prim) if prim.HasAPI(UsdPhysics.MassAPI) else None
            bodies[str(prim.GetPath())] = {
                "mass": mass.GetMassAttr().Get() if mass else 0.0,
                "com": np.array(mass.GetCenterOfMassAttr().Get()) if mass else np.zeros(3),
                "turn": _quaternion(mass.GetPrincipalAxesAttr().Get()) if mass else Pose().turn,
                "moments": np.array(mass.GetDiagonalInertiaAttr().Get()) if mass else np.zeros(3),
            }
        joint = UsdPhysics.Joint(prim)
        if prim.IsA(UsdPhysics.Joint):
            hinge, fixed = prim.IsA(UsdPhysics.RevoluteJoint), prim.IsA(UsdPhysics.FixedJoint)
            way = "angular" if hinge else "linear"
            assert fixed or (
                prim.HasAPI(UsdPhysics.DriveAPI, way)
                and f"PhysxJointAxisAPI:{way}" in str(prim.GetMetadata("apiSchemas"))
            )
            parent, child = (
                [str(path) for path in relation.GetTargets()]
                for relation in (joint.GetBody0Rel(), joint.GetBody1Rel())
            )
            per_angle = DEGREE if hinge else 1.0
            joints[value(prim, "excite:joint") or prim.GetName()] = {
                "kind": None if fixed else HINGE if hinge else SLIDE,
                "parent": parent[0] if parent else "",
                "child": child[0],
                "outer": Pose(
                    np.array(joint.GetLocalPos0Attr().Get()), _quaternion(joint.GetLocalRot0Attr().Get())
                ),
                "inner": Pose(
                    np.array(joint.GetLocalPos1Attr().Get()), _quaternion(joint.GetLocalRot1Attr().Get())
                ),
                "axis": np.eye(3)["XYZ".index(value(prim, "physics:axis") or "X")],
                "viscous": (value(prim, f"physxJointAxis:{way}:viscousFrictionCoefficient") or 0.0)
                / per_angle,
                "coulomb": value(prim, f"physxJointAxis:{way}:dynamicFrictionEffort") or 0.0,
                "armature": value(prim, f"physxJointAxis:{way}:armature") or 0.0,
            }
    return assembled(bodies, joints)


def _quaternion(read: Any) -> np.ndarray:
    turn = np.array([read.GetReal(), *read.GetImaginary()])
    return turn / np.linalg.norm(turn)


def usd_values(text: str, joint: str) -> dict[str, float]:
    """Numbers that a USD text states of a joint, in the text's own units."""
    block = text.partition(f'Joint "{joint}"')[2].partition("}")[0]
    return {name: float(number) for name, number in re.findall(r"float ([\w:]+) = (\S+)", block)}


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
