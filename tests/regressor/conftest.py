"""Models and trajectories that exercise every kind of joint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import pytest

from excite.robot.catalogue import example_robot_data
from excite.robot.loading import load_robot


@dataclass(frozen=True, eq=False)
class Sampled:
    """A model with random samples of q, v, a."""

    model: pin.Model
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def panda_arm() -> pin.Model:
    """The Panda of the data wheel, its fingers locked."""
    full = pin.buildModelFromUrdf(str(example_robot_data() / "panda_description/urdf/panda.urdf"))
    fingers = [full.getJointId(name) for name in full.names if "finger" in name]
    return pin.buildReducedModel(full, fingers, pin.neutral(full))


def odd_tree(root: bool) -> pin.Model:
    """A branching tree with prismatic, oblique, and unbounded joints, and a root that stands askew."""
    random = np.random.default_rng(3)
    pin.seed(7)
    model = pin.Model()
    model.gravity.linear = np.array([1.0, -2.0, -9.0])
    kinds = [
        pin.JointModelRevoluteUnaligned(np.array([1.0, 2.0, -3.0]) / np.sqrt(14.0)),
        pin.JointModelPY(),
        pin.JointModelRUBZ(),
        pin.JointModelPrismaticUnaligned(np.array([3.0, 0.0, 4.0]) / 5.0),
        pin.JointModelRX(),
        pin.JointModelRUBX(),
    ]
    joint = 0
    if root:
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Random(), "root")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
    joints = [joint]
    for index, kind in enumerate(kinds):
        parent = joints[int(random.integers(len(joints)))]
        joint = model.addJoint(parent, kind, pin.SE3.Random(), f"joint{index}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Random())
        joints.append(joint)
    return model


def continuous_chain() -> pin.Model:
    """Two continuous joints about oblique axes, which pinocchio stores as cosine and sine."""
    link = '<link name="{}"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>'
    link += '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0"/></inertial></link>'
    joint = '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/>'
    joint += '<origin xyz="0.3 0 0.1" rpy="0.4 0.5 0.6"/><axis xyz="{3}"/></joint>'
    return pin.buildModelFromXML(
        '<robot name="chain"><link name="world"/>'
        + link.format("a")
        + link.format("b")
        + joint.format("j1", "world", "a", "0 0.6 0.8")
        + joint.format("j2", "a", "b", "-0.48 0.6 0.64")
        + "</robot>"
    )


def sample(model: pin.Model, n: int, seed: int = 0) -> Sampled:
    """Random configurations far from neutral, with velocities and accelerations."""
    random = np.random.default_rng(seed)
    neutral = pin.neutral(model)
    q = np.array([pin.integrate(model, neutral, 2.0 * random.normal(size=model.nv)) for _ in range(n)])
    return Sampled(model, q, random.normal(size=(n, model.nv)), 5.0 * random.normal(size=(n, model.nv)))


MODELS: dict[str, Callable[[], pin.Model]] = {
    "g1": lambda: load_robot("g1").model,
    "panda": panda_arm,
    "odd_fixed": lambda: odd_tree(root=False),
    "odd_floating": lambda: odd_tree(root=True),
    "continuous": continuous_chain,
}


@pytest.fixture(params=list(MODELS))
def sampled(request: pytest.FixtureRequest) -> Sampled:
    """Each model with 130 samples: more than two passes of the kernels."""
    return sample(MODELS[request.param](), 130)
