"""USD models are read by Pixar's library: what this package writes, and files of other conventions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import excite
from excite.errors import RobotError
from excite.export.models.simulator_model import write_simulator_model
from excite.regressor.kernels import inverse_dynamics
from tests.export.models.identified_folder import known


@pytest.mark.parametrize("name", ["ur10", "panda", "go2"])
def test_a_robot_comes_back_from_usd_with_its_torques(name: str, tmp_path: Path) -> None:
    given = known(name, tmp_path)
    write_simulator_model(tmp_path, "usda", tmp_path / "out")
    found = excite.load_robot(next((tmp_path / "out").glob("*.usda")))
    assert found.joint_names == given.robot.joint_names and found.floating == given.robot.floating
    rng = np.random.default_rng(1)
    q = np.array([pin.randomConfiguration(found.model, *_box(found.model)) for _ in range(5)])
    v, a = rng.standard_normal((2, 5, found.model.nv))
    want = inverse_dynamics(given.robot.model, q, v, a, given.parameters)
    np.testing.assert_allclose(inverse_dynamics(found.model, q, v, a), want, atol=1e-4 * np.abs(want).max())


def _box(model: pin.Model) -> tuple[np.ndarray, np.ndarray]:
    low = np.where(np.isfinite(model.lowerPositionLimit), model.lowerPositionLimit, -1.0)
    return np.maximum(low, -3.0), np.minimum(model.upperPositionLimit, 3.0)


# An arm in centimetres and grams, its joint turned round (the arm is body 0) and given in degrees.
ARM = """#usda 1.0
(
    metersPerUnit = 0.01
    kilogramsPerUnit = 0.001
    upAxis = "Z"
)
def Xform "arm" ( prepend apiSchemas = ["PhysicsArticulationRootAPI"] ) {{
    def Xform "base" ( prepend apiSchemas = ["PhysicsRigidBodyAPI"] ) {{}}
    def Xform "fore" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"] ) {{
        double3 xformOp:translate = (0, 0, 50)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        float physics:mass = 2000
        point3f physics:centerOfMass = (0, 0, 10)
        float3 physics:diagonalInertia = {moments}
        def Cube "box" ( prepend apiSchemas = ["PhysicsCollisionAPI"] ) {{
            double size = 20
            double3 xformOp:translate = (0, 0, 10)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }}
    }}
    def PhysicsFixedJoint "hold" {{
        rel physics:body1 = </arm/base>
    }}
    def {kind} "elbow" {{
        rel physics:body0 = </arm/fore>
        rel physics:body1 = </arm/base>
        uniform token physics:axis = "Y"
        point3f physics:localPos0 = (0, 0, 0)
        point3f physics:localPos1 = (0, 0, 50)
        float physics:lowerLimit = -90
        float physics:upperLimit = 45
    }}
}}
"""


def _arm(folder: Path, moments: str = "(1e5, 1e5, 1e5)", kind: str = "PhysicsRevoluteJoint") -> Path:
    file = folder / "arm.usda"
    file.write_text(ARM.format(moments=moments, kind=kind))
    return file


def test_units_of_the_stage_and_a_joint_the_other_way_round(tmp_path: Path) -> None:
    robot = excite.load_robot(_arm(tmp_path))
    limits = robot.description.limits.position.margin
    np.testing.assert_allclose(robot.limits.position_lower - limits, -np.pi / 2, atol=1e-6)
    np.testing.assert_allclose(robot.limits.position_upper + limits, np.pi / 4, atol=1e-6)
    # Turned by q about −y, the centre 0.1 m above the elbow comes to x = −0.1 sin q.
    tau = inverse_dynamics(robot.model, *np.array([[[0.5]], [[0.0]], [[0.0]]]))
    np.testing.assert_allclose(tau, -2.0 * 9.81 * 0.1 * np.sin(0.5), rtol=1e-5)
    np.testing.assert_allclose(robot.model.inertias[1].inertia, 0.01 * np.eye(3), rtol=1e-5)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"moments": "(0, 0, 0)"}, "has a mass and no moments of inertia"),
        ({"kind": "PhysicsSphericalJoint"}, "is a PhysicsSphericalJoint"),
    ],
)
def test_what_no_urdf_can_say_is_one_line(changed: dict[str, str], said: str, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=said):
        excite.load_robot(_arm(tmp_path, **changed))


def test_what_is_no_usd_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "arm.usda").write_text("#usda 1.0\ndef Xform {{{")
    with pytest.raises(RobotError, match="USD cannot read it") as caught:
        excite.load_robot(tmp_path / "arm.usda")
    assert "pxrInternal" not in str(caught.value)
    with pytest.raises(RobotError, match="no such file"):
        excite.load_robot(tmp_path / "other.usda")
