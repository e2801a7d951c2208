"""A robot whose description is not complete yet, built with stand-ins for what only a person can say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from excite.errors import RobotError
from excite.robot.description import RobotDescription
from excite.robot.loading import build_robot
from excite.robot.robot import Robot
from excite.robot.scaffold.guesses import JointGuess
from excite.robot.shapes.collision import collision_shapes
from excite.robot.shapes.shape import Shape
from excite.robot.shapes.stand_ins import links_lacking_geometry

# Distance that links keep [m]: what hulls of a hundredth more than their meshes leave of clearances in arms of 1 m.
APART = 0.01


@dataclass(frozen=True, eq=False)
class WithGeometry:
    """A robot, and what collision geometry could be built.

    Attributes:
        robot: the robot.
        kind: ``collision``, ``visual``, or ``either`` where some links have the second alone; None where nothing
            can be built.
        fault: why not of all links, None where one can.
        lacking: links whose geometry cannot be built in whole or in part.
    """

    robot: Robot
    kind: str | None
    fault: str | None
    lacking: tuple[str, ...] = ()


@dataclass(frozen=True)
class StandIn:
    """Builds a robot with stand-ins for what a person has not said yet.

    Its loops are closed from ``posture``, the model's own [rad or m]: where all joints are at zero they may fold or
    stretch, and no motor determines what they do.
    """

    path: Path
    free: tuple[JointGuess, ...]
    locked: dict[str, float]
    faults: tuple[str, ...]
    margin: float
    tied: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    apart: float = APART
    posture: Mapping[str, float] = field(default_factory=dict)

    def with_geometry(self) -> WithGeometry:
        """The robot with the first kind of geometry that can be built, or without any."""
        reasons = []
        for kind in ("collision", "visual"):
            robot = self.robot(kind)
            try:
                shapes = collision_shapes(robot)
            except RobotError as error:
                file = self.path.name if error.source is None else Path(str(error.source)).name
                of_mesh = "" if file == self.path.name else f"{file}: "
                reasons.append(f"{kind}: {of_mesh}{error.what}")
                continue
            if not any(shape.joint for shape in shapes):
                # Nothing would be checked: no shape moves.
                reasons.append(f"{kind}: none on a link that moves")
                continue
            return self._filled(WithGeometry(robot, kind, None), shapes)
        return self._piecewise("; ".join(reasons))

    def _piecewise(self, fault: str) -> WithGeometry:
        """The same, each link with what can be built of it; ``fault`` says why that is not all."""
        lacking = links_lacking_geometry(self.robot("either"))
        robot = self.robot("either", stand_ins=lacking)
        try:
            collision_shapes(robot)
        except RobotError:
            return WithGeometry(self.robot("authored"), None, fault)
        return WithGeometry(robot, "either", fault, lacking)

    def _filled(self, found: WithGeometry, shapes: tuple[Shape, ...]) -> WithGeometry:
        """The same with what is drawn of links that have no ``collision``, if it can be built."""
        if found.kind != "collision":
            return found
        robot = self.robot("either")
        try:
            more = len(collision_shapes(robot)) > len(shapes)
        except RobotError:
            return found
        return WithGeometry(robot, "either", None) if more else found

    def _rest(self) -> dict[str, float]:
        """The model's own posture, as far as its limits let it."""
        ends = {g.name: g.position or (-np.inf, np.inf) for g in self.free if g.name in self.posture}
        return {
            name: float(np.clip(self.posture[name], low + self.margin, high - self.margin))
            for name, (low, high) in ends.items()
        }

    def robot(
        self, geometry: str, shapes: Sequence[dict[str, Any]] = (), stand_ins: Sequence[str] = ()
    ) -> Robot:
        """The robot with geometry of one kind, and authored ``shapes``, those of links in ``stand_ins`` for theirs."""
        said = "stand-in"
        one = {"default": 1.0, "source": said}
        content = {
            "schema": "excite.robot/1",
            "name": said,
            "title": said,
            "model": {
                "path": str(self.path.resolve()),
                "acknowledged": dict.fromkeys(self.faults, said),
                "source": said,
            },
            "base": "fixed",
            "locked_joints": self.locked,
            **self.tied,
            "posture": {"joints": self._rest() if self.tied else {}, "base_height": 0.0, "source": said},
            "limits": {
                "position": {
                    "joints": {g.name: (-np.pi, np.pi) for g in self.free if g.position is None},
                    "margin": self.margin,
                    "source": said,
                },
                **{name: one for name in ("velocity", "acceleration", "jerk")},
                # A joint without a torque limit is given one later that carries its load in any posture.
                "torque": {"joints": {g.name: g.torque or 1e9 for g in self.free}, "source": said},
            },
            "sensors": {
                "rate_hz": 1.0,
                "noise_position": 0.0,
                "joint_torque": "link_side",
                "source": said,
            },
            "controller": {"kp": one, "kd": one},
            "collision": {
                "geometry": geometry,
                "shapes": list(shapes),
                "stand_ins": list(stand_ins),
                "margin": self.apart,
                "table_height": None,
                "source": said,
            },
        }
        try:
            description = RobotDescription.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"])
            what = f"cannot be described: {place} {first['msg']}"
            raise RobotError(
                what, source=self.path, remedy="correct the model, or rename its file"
            ) from error
        return build_robot(description, self.path)
