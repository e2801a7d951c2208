"""Configurations of simulators for learning, which are Python: how they are written and how they are read."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.errors import InputError
from excite.export.models.verification import States
from excite.export.simulators.mjcf import MjcfFormat
from excite.export.simulators.model_format import (
    JOINT_TERMS,
    SERVO_TERMS,
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    with_friction,
)
from excite.export.simulators.usd import UsdaFormat, read_usda
from excite.robot.robot import Robot
from excite.simulation.mjcf import GROUND

# Python text of a configuration: written with all digits, and run again without the library that it is for.

PHYSICS_DT = 0.005
"""Step of the physics that delays are counted in [s], which both libraries' own tasks take; the text says to change
it with the simulation's."""


_DELAY = """# How late the motors were found to follow [s], counted in your simulation's steps.
DELAY = {late!r}
PHYSICS_DT = {step!r}
DELAY_STEPS = round(DELAY / PHYSICS_DT)


"""


def delay_text(late: float | None) -> str:
    """Lines that say how late motors follow; none where that is not known."""
    return "" if late is None else _DELAY.format(late=late, step=PHYSICS_DT)


def delay_note(late: float | None) -> tuple[str, ...]:
    """What of a delay a whole number of steps leaves."""
    if late is None:
        return ()
    return (
        f"commands reach the servo {round(late / PHYSICS_DT)} steps of {PHYSICS_DT:g} s late for the {late:.3g} s that"
        " were found; what the servo measures is not late",
    )


@dataclass(frozen=True, eq=False)
class Recorded:
    """Anything of the library that a configuration is for: what it was called with, and nothing else.

    Attributes:
        name: as the configuration has it, dots included.
        arguments: keywords of the call.
    """

    name: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __getattr__(self, name: str) -> Recorded:
        if name.startswith("__"):
            raise AttributeError(name)
        return Recorded(f"{self.name}.{name}")

    def __call__(self, *others: Any, **arguments: Any) -> Recorded:
        return Recorded(self.name, arguments)


def record_configuration(text: bytes, name: str, library: str) -> Recorded:
    """What a configuration's text calls ``name``, run with stand-ins for all that it imports of a library.

    Args:
        text: a configuration that was written here.
        name: the variable that is asked for.
        library: package whose imports get stand-ins; all others are left as they are.

    Raises:
        InputError: it is no Python, or has no such variable.
    """
    tree = ast.parse(text)
    names: dict[str, Any] = {"__file__": "robot.py", "__name__": "configuration"}
    kept: list[ast.stmt] = []
    for statement in tree.body:
        if isinstance(statement, ast.Import | ast.ImportFrom) and _is_of(statement, library):
            names |= {item.asname or item.name: Recorded(item.name) for item in statement.names}
        else:
            kept.append(statement)
    exec(compile(ast.Module(kept, []), "configuration", "exec"), names)
    found = names.get(name)
    if not isinstance(found, Recorded):
        raise InputError(f"has no {name}", source="written model")
    return found


def _is_of(statement: ast.Import | ast.ImportFrom, library: str) -> bool:
    module = statement.names[0].name if isinstance(statement, ast.Import) else statement.module or ""
    return module.split(".")[0] == library


def joint_table(values: Mapping[str, float], *, indent: str = "    ") -> str:
    """A dictionary by joint, a line each; names are patterns, which both libraries take them for."""
    rows = [f"{indent}{re.escape(name)!r}: {float(value)!r}," for name, value in values.items()]
    return "\n".join(["{", *rows, "}"])


def by_joint(found: Any, joints: tuple[str, ...]) -> Array:
    """Values of joints out of a table by pattern, or of a number for all, ``(n_joints,)``; NaN where there is none."""
    if not isinstance(found, Mapping):
        return np.full(len(joints), np.nan if found is None else float(found))
    rows = []
    for joint in joints:
        rows.append(next((float(value) for key, value in found.items() if re.fullmatch(key, joint)), np.nan))
    return np.array(rows)


def common_value(values: Array) -> float | None:
    """The one value that all joints have; None where it is not known."""
    return float(values[0]) if len(values) and np.isfinite(values).all() else None


def module_name(stem: str, suffix: str) -> str:
    """A name that Python can import, made of a robot's."""
    plain = re.sub(r"\W", "_", stem)
    return f"robot_{plain}_{suffix}" if plain[:1].isdigit() else f"{plain}_{suffix}"


def variable_name(stem: str) -> str:
    """A name for a module's constant, made of a robot's."""
    return module_name(stem, "CFG").upper()


def path_beside(name: str) -> str:
    """Python that says where a file beside the configuration lies."""
    return f"Path(__file__).resolve().parent / {Path(name).name!r}"


# Isaac Lab: an articulation's configuration in Python, and the USD that it spawns.

_TEMPLATE = '''"""{robot} as it was identified, for Isaac Lab 3.0 or newer; written by excite.

    from {module} import {variable}

Every term of the joints stands here as well as in the USD: some converters of models drop friction on the way, and
what is given here is set whatever the file holds. Friction at rest and friction in motion are one, the
Coulomb friction that was found. In Isaac Lab 2
`{effort}` was called `{older}`.
"""

from pathlib import Path

import isaaclab.sim as sim_utils
from isaaclab.actuators import {actuator}
from isaaclab.assets import ArticulationCfg

{tables}

{delay}{variable} = ArticulationCfg(
    spawn=sim_utils.UsdFileCfg(usd_path=str({usd})),
    init_state=ArticulationCfg.InitialStateCfg({pos}joint_pos=REST),
    actuators={{
        "joints": {actuator}(
            joint_names_expr=list(ARMATURE),
{arguments}
        ),
    }},
)
'''
# Fields of an actuator's configuration by term; those of limits depend on who runs the servo.
_FIELDS = {
    "kp": "stiffness",
    "kd": "damping",
    "armature": "armature",
    "coulomb": "dynamic_friction",
    "viscous": "viscous_friction",
    "velocity_limit": "joint_velocity_limit",
}


class IsaacLabFormat(ModelFormat):
    """An ``ArticulationCfg`` with one group of actuators, and the robot as USD beside it.

    Where a diagnosis found motors to follow late the servo is ``DelayedPDActuatorCfg``, else the physics engine's own.
    """

    name = "isaaclab"
    summary = "Isaac Lab 3.0: ArticulationCfg with actuators, and the USD that it spawns"
    servo_terms = tuple(SERVO_TERMS)
    tolerance = UsdaFormat.tolerance
    delay_step_s = PHYSICS_DT

    def __init__(self) -> None:
        self._usda = UsdaFormat()

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        usda = self._usda.render(subject)
        module = module_name(subject.stem, "cfg")
        late, floating = common_value(subject.servo("delay")), subject.robot.floating
        delayed = late is not None
        fields = {**_FIELDS, "torque_limit": "actuator_effort_limit" if delayed else "joint_effort_limit"}
        terms = {term: subject.written(term) for term in JOINT_TERMS}
        terms |= {term: subject.servo(term) for term in SERVO_TERMS if term != "delay"}
        tables = {field.upper(): self._known(subject, terms[term]) for term, field in fields.items()}
        joints = subject.robot.rest[subject.robot.n_base_q :]
        tables["REST"] = dict(zip(subject.robot.joint_names, joints, strict=True))
        given = [
            f"            {field}={field.upper() if tables[field.upper()] else None},"
            for field in fields.values()
        ]
        given.append("            friction=DYNAMIC_FRICTION,")
        if delayed:
            given += ["            min_delay=DELAY_STEPS,", "            max_delay=DELAY_STEPS,"]
        name = variable_name(subject.stem)
        text = _TEMPLATE.format(
            robot=subject.stem,
            module=module,
            variable=name,
            effort=fields["torque_limit"],
            older="effort_limit" if delayed else "effort_limit_sim",
            actuator="DelayedPDActuatorCfg" if delayed else "ImplicitActuatorCfg",
            tables="\n".join(f"{key} = {joint_table(values)}" for key, values in tables.items() if values),
            delay=delay_text(late),
            usd=path_beside(usda.main),
            pos=f"pos={tuple(float(v) for v in subject.robot.rest[:3])!r}, " if floating else "",
            arguments="\n".join(given),
        )
        return Rendered({f"{module}.py": text.encode(), **usda.files}, (*usda.notes, *delay_note(late)))

    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """The USD by its reader, and the configuration run without Isaac Lab: its terms take the place of the USD's."""
        found = record_configuration(rendered.files[rendered.main], variable_name(subject.stem), "isaaclab")
        (group,) = found.arguments["actuators"].values()
        usda = next(content for name, content in rendered.files.items() if name.endswith(".usda"))
        given, joints = group.arguments, subject.robot.joint_names
        limit = "joint_effort_limit" if "joint_effort_limit" in given else "actuator_effort_limit"
        fields = {**_FIELDS, "torque_limit": limit}
        read = {term: by_joint(given.get(name), joints) for term, name in fields.items()}
        read["delay"] = by_joint(given.get("min_delay"), joints) * PHYSICS_DT
        return LoadedConfiguration(subject.robot, read_usda(subject.robot, usda.decode()), read)

    def _known(self, subject: Subject, values: Array) -> dict[str, float]:
        pairs = zip(subject.robot.joint_names, values, strict=True)
        return {name: float(value) for name, value in pairs if np.isfinite(value)}


# mjlab: an entity's configuration in Python, and the MuJoCo model that it is made of.

_MJLAB_TEMPLATE = '''"""{robot} as it was identified, for mjlab 1.6 or newer; written by excite.

    from {module} import {variable}

Terms of the joints stand here as well as in the XML, since a configuration that leaves them out sets them to zero in
older versions.
"""

import re
from pathlib import Path

import mujoco
from mjlab.actuator import BuiltinPositionActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg

XML = {xml}


def get_spec() -> mujoco.MjSpec:
    """The model without motors and ground, which mjlab adds."""
    spec = mujoco.MjSpec.from_file(str(XML))
    for motor in list(spec.actuators):
        spec.delete(motor)
    for geom in [geom for geom in spec.worldbody.geoms if geom.name == {ground!r}]:
        spec.delete(geom)
    for key in list(spec.keys):
        spec.delete(key)
    return spec


{delay}JOINTS = {{
{joints}
}}

{variable} = EntityCfg(
    spec_fn=get_spec,
    init_state=EntityCfg.InitialStateCfg(
        {pos}joint_pos={{
{rest}
        }},
    ),
    articulation=EntityArticulationInfoCfg(
        actuators=tuple(
            BuiltinPositionActuatorCfg(target_names_expr=(re.escape(name),), {late}**terms)
            for name, terms in JOINTS.items()
        ),
    ),
)
'''
_LATE = "delay_min_lag=DELAY_STEPS, delay_max_lag=DELAY_STEPS, "
_MJLAB_FIELDS = {
    "kp": "stiffness",
    "kd": "damping",
    "torque_limit": "effort_limit",
    "armature": "armature",
    "coulomb": "frictionloss",
    "viscous": "viscous_damping",
}
_NEEDED = ("kp", "kd")


class MjlabFormat(ModelFormat):
    """An ``EntityCfg`` with a position servo a joint, and the MuJoCo model of :class:`MjcfFormat` beside it."""

    name = "mjlab"
    summary = "mjlab 1.6: EntityCfg with actuators, and the MuJoCo model that it is made of"
    servo_terms = ("kp", "kd", "torque_limit", "delay")
    lacks: ClassVar[Mapping[str, str]] = {"velocity_limit": MjcfFormat.lacks["velocity_limit"]}
    delay_step_s = PHYSICS_DT

    def __init__(self) -> None:
        self._mjcf = MjcfFormat()

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        xml = self._mjcf.render(subject)
        module = module_name(subject.stem, "mjlab")
        late, robot = common_value(subject.servo("delay")), subject.robot
        # A text that is kept has terms of its own where nothing was found, which mjlab leaves as they are.
        term = subject.written if subject.template is None else subject.term
        columns = {name: term(name) if name in JOINT_TERMS else subject.servo(name) for name in _MJLAB_FIELDS}
        joints = [
            f"    {name!r}: dict(" + ", ".join(self._terms(columns, index)) + "),"
            for index, name in enumerate(robot.joint_names)
        ]
        rest = zip(robot.joint_names, robot.rest[robot.n_base_q :], strict=True)
        text = _MJLAB_TEMPLATE.format(
            robot=subject.stem,
            module=module,
            variable=variable_name(subject.stem),
            xml=path_beside(xml.main),
            ground=GROUND,
            delay=delay_text(late),
            late="" if late is None else _LATE,
            joints="\n".join(joints),
            pos=f"pos={tuple(float(v) for v in robot.rest[:3])!r},\n        " if robot.floating else "",
            rest="\n".join(f"            {re.escape(name)!r}: {float(value)!r}," for name, value in rest),
        )
        return Rendered({f"{module}.py": text.encode(), **xml.files}, (*xml.notes, *delay_note(late)))

    def load(self, subject: Subject, rendered: Rendered) -> LoadedModel:
        """The model by MuJoCo, and the configuration run without mjlab: its terms take the place of the model's."""
        found = record_configuration(rendered.files[rendered.main], variable_name(subject.stem), "mjlab")
        actuators = found.arguments["articulation"].arguments["actuators"]
        model = Rendered({name: text for name, text in rendered.files.items() if name.endswith(".xml")})
        rows = [_actuator_of(name, [a.arguments for a in actuators]) for name in subject.robot.joint_names]
        fields = {**_MJLAB_FIELDS, "delay": "delay_min_lag"}
        read = {
            term: np.array([np.nan if row.get(name) is None else float(row[name]) for row in rows])
            for term, name in fields.items()
        }
        read["delay"] = read["delay"] * PHYSICS_DT
        return LoadedConfiguration(subject.robot, self._mjcf.load(subject, model), read)

    def exact(self, subject: Subject) -> bool:
        """As of the model."""
        return self._mjcf.exact(subject)

    @staticmethod
    def _terms(columns: Mapping[str, Array], index: int) -> list[str]:
        """Keywords of a joint's actuator; a servo without gains, which no robot.yaml gave, pulls nothing."""
        found = []
        for term, name in _MJLAB_FIELDS.items():
            value = float(columns[term][index])
            if np.isfinite(value):
                found.append(f"{name}={value!r}")
            elif term in _NEEDED:
                found.append(f"{name}=0.0")
        return found


class LoadedConfiguration(LoadedModel):
    """A robot's bodies as their own file has them, with the joints' terms that a configuration sets.

    Args:
        robot: the robot.
        bodies: what was read of the file with the bodies.
        given: terms of the joints and servos, ``(n_joints,)`` each; NaN where the configuration sets none.
    """

    def __init__(self, robot: Robot, bodies: LoadedModel, given: Mapping[str, Array]) -> None:
        self._robot, self._bodies = robot, bodies
        drives = {
            term: np.where(np.isfinite(given[term]), given[term], bodies.drives[term]) for term in JOINT_TERMS
        }
        super().__init__(drives, {term: given[term] for term in SERVO_TERMS if term in given})

    def torques(self, states: States) -> Array:
        """Those of the file, with the difference that the configuration makes."""
        more = {term: self.drives[term] - self._bodies.drives[term] for term in JOINT_TERMS}
        return with_friction(self._robot, self._bodies.torques(states), states, more)


def _actuator_of(joint: str, actuators: list[Mapping[str, Any]]) -> Mapping[str, Any]:
    """The actuator that drives a joint."""
    for one in actuators:
        if any(re.fullmatch(pattern, joint) for pattern in one["target_names_expr"]):
            return one
    return {}
