"""Configurations of simulators for learning, which are Python: how they are written and how they are read."""

from __future__ import annotations

import ast
import re
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from excite.errors import InputError
from excite.export.models.mjcf import MjcfFormat
from excite.export.models.model_format import (
    JOINT_TERMS,
    LoadedModel,
    ModelFormat,
    Rendered,
    Subject,
    with_friction,
)
from excite.export.models.usd import UsdaFormat
from excite.export.models.verification import States
from excite.simulation.mjcf import GROUND

PHYSICS_DT = 0.005
"""Step of the physics that delays are counted in [s], which both libraries' own tasks take; the text says to change
it with the simulation's."""


_DELAY = """# How late the motors were found to follow [s], counted in your simulation's steps.
DELAY = {late!r}
PHYSICS_DT = {step!r}
DELAY_STEPS = round(DELAY / PHYSICS_DT)


"""


def delay_note(late: float | None) -> tuple[str, ...]:
    """What of a delay a whole number of steps leaves."""
    if late is None:
        return ()
    return (
        f"commands reach the servo {round(late / PHYSICS_DT)} steps of {PHYSICS_DT:g} s late for the {late:.3g} s that"
        " were found; what the servo measures is not late",
    )


class LabFormat(ModelFormat):
    """A configuration in Python, and the model that it is made of beside it.

    Terms of the joints stand in both: what the configuration sets takes the place of what the model has.

    Attributes:
        library: what the configuration is for.
        ending: of the module's name.
        bodies: format of the model.
        suffix: of the model's file.
        patterns: keyword of an actuator for the joints that it drives, as patterns.
    """

    library: ClassVar[str]
    ending: ClassVar[str]
    bodies: ClassVar[type[ModelFormat]]
    suffix: ClassVar[str]
    patterns: ClassVar[str]
    delay_step_s = PHYSICS_DT

    def __init__(self) -> None:
        self._model = self.bodies()

    @abstractmethod
    def write_text(self, subject: Subject, words: Mapping[str, str], late: float | None) -> str:
        """The configuration.

        Args:
            subject: the robot.
            words: for its template: names of robot, module and variable, where the model lies, lines of a delay.
            late: how late motors follow [s]; None where that is not known.
        """

    @abstractmethod
    def read_actuators(self, found: Recorded) -> Iterable[Recorded]:
        """Those of a configuration."""

    def actuator_fields(self, *, delayed: bool) -> Mapping[str, str]:
        """Keywords of an actuator by term; those of limits may depend on who runs the servo."""
        return self.held

    def render(self, subject: Subject) -> Rendered:
        """See :class:`ModelFormat`."""
        model, late = self._model.render(subject), self._late(subject)
        module = self._module(subject)
        words = {
            "robot": subject.stem,
            "module": module,
            "variable": self._variable(subject),
            "model": f"Path(__file__).resolve().parent / {Path(model.main).name!r}",
            "delay": "" if late is None else _DELAY.format(late=late, step=PHYSICS_DT),
        }
        text = self.write_text(subject, words, late)
        return Rendered({f"{module}.py": text.encode(), **model.files}, (*model.notes, *delay_note(late)))

    def load(self, subject: Subject, rendered: Rendered, states: States) -> LoadedModel:
        """The model by its reader, and the configuration run without the library."""
        found = record_configuration(rendered.files[rendered.main], self._variable(subject), self.library)
        groups = [actuator.arguments for actuator in self.read_actuators(found)]
        delayed = any(self.held["delay"] in group for group in groups)
        given = {
            term: np.array([self._value(groups, joint, name) for joint in subject.robot.joint_names])
            for term, name in self.actuator_fields(delayed=delayed).items()
        }
        given["delay"] = given["delay"] * PHYSICS_DT
        model = self._model.load(subject, rendered.files_ending(self.suffix), states)
        for term in JOINT_TERMS:
            given[term] = np.where(np.isfinite(given[term]), given[term], model.terms[term])
        more = {term: given[term] - model.terms[term] for term in JOINT_TERMS}
        return LoadedModel(with_friction(subject.robot, model.torques, states, more), given)

    def exact(self, subject: Subject) -> bool:
        """As of the model."""
        return self._model.exact(subject)

    def _value(self, groups: list[Mapping[str, Any]], joint: str, name: str) -> float:
        """A keyword of the actuator that drives a joint, a number or a table by pattern; NaN where there is none."""
        for group in groups:
            if any(re.fullmatch(pattern, joint) for pattern in group[self.patterns]):
                value = group.get(name)
                if isinstance(value, Mapping):
                    value = next((v for pattern, v in value.items() if re.fullmatch(pattern, joint)), None)
                return np.nan if value is None else float(value)
        return np.nan

    def _late(self, subject: Subject) -> float | None:
        """The one delay that all joints have; None where it is not known."""
        values = subject.servo("delay")
        return float(values[0]) if len(values) and np.isfinite(values).all() else None

    def _module(self, subject: Subject) -> str:
        return module_name(subject.stem, self.ending)

    def _variable(self, subject: Subject) -> str:
        return module_name(subject.stem, "CFG").upper()


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
        InputError: it has no such variable.
    """
    tree = ast.parse(text)
    names: dict[str, Any] = {"__file__": "robot.py", "__name__": "configuration"}
    kept: list[ast.stmt] = []
    for statement in tree.body:
        if isinstance(statement, ast.Import):
            module = statement.names[0].name
        else:
            module = (statement.module or "") if isinstance(statement, ast.ImportFrom) else ""
        if isinstance(statement, ast.Import | ast.ImportFrom) and module.split(".")[0] == library:
            names |= {item.asname or item.name: Recorded(item.name) for item in statement.names}
        else:
            kept.append(statement)
    exec(compile(ast.Module(kept, []), "configuration", "exec"), names)
    found = names.get(name)
    if not isinstance(found, Recorded):
        raise InputError(f"has no {name}", source="written model")
    return found


def module_name(stem: str, suffix: str) -> str:
    """A name that Python can import, made of a robot's."""
    plain = re.sub(r"\W", "_", stem)
    return f"robot_{plain}_{suffix}" if plain[:1].isdigit() else f"{plain}_{suffix}"


def _joint_table(values: Mapping[str, float], indent: str) -> str:
    """Rows of a dictionary by joint; names are patterns, which both libraries take them for."""
    return "\n".join(f"{indent}{re.escape(name)!r}: {float(value)!r}," for name, value in values.items())


def _start(subject: Subject, end: str) -> dict[str, str]:
    """Where a free base and the joints stand at first, for a template."""
    robot = subject.robot
    pos = f"pos={tuple(float(v) for v in robot.rest[:3])!r},{end}" if robot.floating else ""
    rest = dict(zip(robot.joint_names, robot.rest[robot.n_base_q :], strict=True))
    return {"pos": pos, "rest": _joint_table(rest, "            ")}


# Isaac Lab: an articulation's configuration in Python, and the USD that it spawns.

_ISAAC_TEMPLATE = '''"""{robot} as it was identified, for Isaac Lab 3.0 or newer; written by excite.

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
    spawn=sim_utils.UsdFileCfg(usd_path=str({model})),
    init_state=ArticulationCfg.InitialStateCfg({pos}joint_pos=REST),
    actuators={{
        "joints": {actuator}(
            joint_names_expr=list(ARMATURE),
{arguments}
        ),
    }},
)
'''


class IsaacLabFormat(LabFormat):
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
    tolerance = UsdaFormat.tolerance
    library, ending, bodies, suffix, patterns = "isaaclab", "cfg", UsdaFormat, ".usda", "joint_names_expr"

    def actuator_fields(self, *, delayed: bool) -> Mapping[str, str]:
        """See :class:`LabFormat`."""
        return {**self.held, "torque_limit": "actuator_effort_limit"} if delayed else self.held

    def read_actuators(self, found: Recorded) -> Iterable[Recorded]:
        """See :class:`LabFormat`."""
        groups: Mapping[str, Recorded] = found.arguments["actuators"]
        return groups.values()

    def write_text(self, subject: Subject, words: Mapping[str, str], late: float | None) -> str:
        """See :class:`LabFormat`."""
        delayed = late is not None
        fields = {
            term: name for term, name in self.actuator_fields(delayed=delayed).items() if term != "delay"
        }
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
        tables["REST"] = _start(subject, "")["rest"].replace("            ", "    ")
        return _ISAAC_TEMPLATE.format(
            **words,
            effort=fields["torque_limit"],
            older="effort_limit" if delayed else "effort_limit_sim",
            actuator="DelayedPDActuatorCfg" if delayed else "ImplicitActuatorCfg",
            tables="\n".join(f"{key} = {{\n{rows}\n}}" for key, rows in tables.items()),
            pos=_start(subject, " ")["pos"],
            arguments="\n".join(given),
        )


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

XML = {model}


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


class MjlabFormat(LabFormat):
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
    library, ending, bodies, suffix, patterns = "mjlab", "mjlab", MjcfFormat, ".xml", "target_names_expr"

    def read_actuators(self, found: Recorded) -> Iterable[Recorded]:
        """See :class:`LabFormat`."""
        several: Iterable[Recorded] = found.arguments["articulation"].arguments["actuators"]
        return several

    def write_text(self, subject: Subject, words: Mapping[str, str], late: float | None) -> str:
        """See :class:`LabFormat`; a servo without gains, which no robot.yaml gave, pulls nothing."""
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
        return _MJLAB_TEMPLATE.format(
            **words,
            ground=GROUND,
            late="" if late is None else "delay_min_lag=DELAY_STEPS, delay_max_lag=DELAY_STEPS, ",
            joints="\n".join(f"    {name!r}: dict({', '.join(row)})," for name, row in names),
            **_start(subject, "\n        "),
        )
