"""Small random arms: the same URDF for the check and for MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

import excite
from excite.robot.robot import Robot
from tests.corpus.arm import YAML

# Clearance that the description asks for [m].
MARGIN_M = 0.01


@dataclass(frozen=True)
class Arm:
    """A chain of links, each with a ball at its end, as read by excite and by MuJoCo.

    Attributes:
        robot: for the check.
        model: for the second judge; its geoms are the balls of base and links in their order.
        radii: of the balls [m].
    """

    robot: Robot
    model: mujoco.MjModel
    radii: tuple[float, ...]


def draw_arm(rng: np.random.Generator, folder: Path) -> Arm:
    """A chain of two or three joints that turn or slide, written to a folder."""
    n = int(rng.integers(2, 4))
    radii = rng.uniform(0.03, 0.07, n + 1)
    lengths, parts, ends = rng.uniform(0.15, 0.3, n), [_link("base", radii[0], np.zeros(3), rng)], np.zeros(3)
    names = [f"j{k}" for k in range(n)]
    for k in range(n):
        slides = bool(rng.random() < 0.2)
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        parts.append(
            f'<joint name="{names[k]}" type="{"prismatic" if slides else "revolute"}">'
            f'<parent link="{"base" if k == 0 else f"link{k - 1}"}"/><child link="link{k}"/>'
            f'<origin xyz="{_text(ends)}" rpy="{_text(rng.uniform(-1, 1, 3))}"/><axis xyz="{_text(axis)}"/>'
            '<limit lower="-3" upper="3" velocity="5" effort="100"/></joint>'
        )
        ends = np.array([0.0, 0.0, lengths[k]])
        parts.append(_link(f"link{k}", radii[k + 1], ends, rng))
    urdf = f'<robot name="arm">{"".join(parts)}</robot>'
    (folder / "arm.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(
        YAML.replace("elbow: 0.3", f"{names[-1]}: 0.3").replace(
            "margin: 0.01,", "margin: 0.01, table_height: null,"
        )
    )
    compiler = '<mujoco><compiler fusestatic="false" strippath="false"/></mujoco></robot>'
    model = mujoco.MjModel.from_xml_string(urdf.replace("</robot>", compiler))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    return Arm(excite.load_robot(folder / "robot.yaml"), model, tuple(radii))


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in values)


def _link(name: str, radius: float, end: np.ndarray, rng: np.random.Generator) -> str:
    """A link with a ball at its end; its inertia is that of a box, about any axes."""
    mass, (a, b, c) = rng.uniform(0.5, 3.0), rng.uniform(0.05, 0.2, 3) ** 2
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    inertia = turn @ np.diag([b + c, a + c, a + b]) @ turn.T * mass / 12.0
    values = " ".join(
        f'i{"xyz"[i]}{"xyz"[j]}="{float(inertia[i, j])!r}"' for i in range(3) for j in range(i, 3)
    )
    return (
        f'<link name="{name}"><inertial><origin xyz="{_text(0.5 * end + rng.uniform(-0.03, 0.03, 3))}"/>'
        f'<mass value="{mass!r}"/><inertia {values}/></inertial><collision><origin xyz="{_text(end)}"/>'
        f'<geometry><sphere radius="{float(radius)!r}"/></geometry></collision></link>'
    )
