"""Configurations of simulators for learning, which are Python, and the models that they are made of."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from excite.export.models.mjcf import MjcfFormat
from excite.export.models.model_format import JOINT_TERMS, ModelFormat, Rendered, Subject
from excite.export.models.usd import UsdaFormat
from excite.simulation.mjcf import GROUND

PHYSICS_DT = 0.005
"""Step of the physics that delays are counted in [s], which both libraries' own tasks take; the text says to change
it with the simulation's."""


_DELAY = """# How late the motors were found to follow [s], counted in your simulation's steps.
DELAY = {late!r}
PHYSICS_DT = {step!r}
DELAY_STEPS = round(DELAY / PHYSICS_DT)


"""


def _add_configuration(
    model: Rendered, subject: Subject, ending: str, template: str, **words: str
) -> Rendered:
    """A model with a configuration, a file of Python before it.

    Args:
        model: files of the robot.
        template: file with its text.
        words: for the template, beside names of robot, module and variable, where the model lies, lines of a delay.
    """
    module, late = module_name(subject.stem, ending), subject.delay_s
    text = (
        Path(__file__)
        .with_name(template)
        .read_text(encoding="utf-8")
        .format(
            robot=subject.stem,
            module=module,
            variable=module_name(subject.stem, "CFG").upper(),
            model=f"Path(__file__).resolve().parent / {Path(model.main).name!r}",
            delay="" if late is None else _DELAY.format(late=late, step=PHYSICS_DT),
            **words,
        )
    )
    notes = (
        ()
        if late is None
        else (
            f"commands reach the servo {round(late / PHYSICS_DT)} steps of {PHYSICS_DT:g} s late for the {late:.3g} s"
            " that were found; what the servo measures is not late",
        )
    )
    files = {f"{module}.py": text.encode(), **model.files}
    return Rendered(files, (*model.notes, *notes), model.changed, model.main)


def module_name(stem: str, suffix: str) -> str:
    """A name that Python can import, made of a robot's."""
    plain = re.sub(r"\W", "_", stem)
    return f"robot_{plain}_{suffix}" if plain[:1].isdigit() else f"{plain}_{suffix}"


def _joint_table(values: Mapping[str, float], indent: str) -> str:
    """Rows of a dictionary by joint; names are patterns, which both libraries take them for."""
    return "\n".join(f"{indent}{re.escape(name)!r}: {float(value)!r}," for name, value in values.items())


def _start_state(subject: Subject, end: str) -> dict[str, str]:
    """Where a free base and the joints stand at first, for a template."""
    robot = subject.robot
    pos = f"pos={tuple(float(v) for v in robot.rest[:3])!r},{end}" if robot.floating else ""
    rest = dict(zip(robot.joint_names, robot.rest[robot.n_base_q :], strict=True))
    return {"pos": pos, "rest": _joint_table(rest, "            ")}


# Isaac Lab: an articulation's configuration in Python, and the USD that it spawns.


class IsaacLabFormat(UsdaFormat):
    """An ``ArticulationCfg`` with one group of actuators, and the robot as USD beside it.

    Where a diagnosis found motors to follow late the servo is ``DelayedPDActuatorCfg``, else the physics engine's own.
    """

    name = "isaaclab"
    summary = "Isaac Lab 3.0: ArticulationCfg with actuators, and the USD that it spawns"
    held: ClassVar[Mapping[str, str]] = {
        "kp": "stiffness",
        "kd": "damping",
        "armature": "armature",
        "coulomb": "dynamic_friction",
        "viscous": "viscous_friction",
        "velocity_limit": "joint_velocity_limit",
        "torque_limit": "joint_effort_limit",
        "delay": "min_delay",
    }
    lacks: ClassVar[Mapping[str, str]] = {}

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        delayed = subject.delay_s is not None
        fields = {term: name for term, name in self.held.items() if term != "delay"}
        if delayed:
            # Who runs the servo cuts its torques.
            fields["torque_limit"] = "actuator_effort_limit"
        tables, given = {}, []
        for term, name in fields.items():
            known = zip(subject.robot.joint_names, subject.written(term), strict=True)
            values = {joint: float(value) for joint, value in known if np.isfinite(value)}
            if values:
                tables[name.upper()] = _joint_table(values, "    ")
            given.append(f"            {name}={name.upper() if values else None},")
        given.append("            friction=DYNAMIC_FRICTION,")
        if delayed:
            given += ["            min_delay=DELAY_STEPS,", "            max_delay=DELAY_STEPS,"]
        tables["REST"] = _start_state(subject, "")["rest"].replace("            ", "    ")
        return _add_configuration(
            super().render(subject),
            subject,
            "cfg",
            "isaaclab.py.txt",
            effort=fields["torque_limit"],
            older="effort_limit" if delayed else "effort_limit_sim",
            actuator="DelayedPDActuatorCfg" if delayed else "ImplicitActuatorCfg",
            tables="\n".join(f"{key} = {{\n{rows}\n}}" for key, rows in tables.items()),
            pos=_start_state(subject, " ")["pos"],
            arguments="\n".join(given),
        )


# mjlab: an entity's configuration in Python, and the MuJoCo model that it is made of.


class MjlabFormat(MjcfFormat):
    """An ``EntityCfg`` with a position servo a joint, and the MuJoCo model of :class:`MjcfFormat` beside it."""

    name = "mjlab"
    summary = "mjlab 1.6: EntityCfg with actuators, and the MuJoCo model that it is made of"
    held: ClassVar[Mapping[str, str]] = {
        "kp": "stiffness",
        "kd": "damping",
        "torque_limit": "effort_limit",
        "armature": "armature",
        "coulomb": "frictionloss",
        "viscous": "viscous_damping",
        "delay": "delay_min_lag",
    }
    lacks: ClassVar[Mapping[str, str]] = {"velocity_limit": MjcfFormat.lacks["velocity_limit"]}

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`; a servo without gains, which no robot.yaml gave, pulls nothing."""
        rows: list[list[str]] = [[] for _ in subject.robot.joint_names]
        for term, name in self.held.items():
            # A text that is kept has terms of its own where nothing was found, which mjlab leaves as they are.
            kept = subject.template is not None and term in JOINT_TERMS
            for row, value in zip(rows, subject.term(term) if kept else subject.written(term), strict=True):
                if np.isfinite(value) and term != "delay":
                    row.append(f"{name}={float(value)!r}")
                elif term in ("kp", "kd"):
                    row.append(f"{name}=0.0")
        names = zip(subject.robot.joint_names, rows, strict=True)
        late = "" if subject.delay_s is None else "delay_min_lag=DELAY_STEPS, delay_max_lag=DELAY_STEPS, "
        return _add_configuration(
            super().render(subject),
            subject,
            "mjlab",
            "mjlab.py.txt",
            ground=GROUND,
            late=late,
            joints="\n".join(f"    {name!r}: dict({', '.join(row)})," for name, row in names),
            **_start_state(subject, "\n        "),
        )

    def servo(self, subject: Subject) -> tuple[str, ...]:
        """The configuration has servos of its own, whatever the model beside it has."""
        return ModelFormat.servo(self, subject)
