"""Isaac Lab: an articulation's configuration in Python, and the USD that it spawns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from excite.arrays import Array
from excite.export.models.verification import States
from excite.export.simulators.labs.script import (
    PHYSICS_DT,
    by_joint,
    common_value,
    delay_note,
    delay_text,
    joint_table,
    module_name,
    path_beside,
    record_configuration,
    variable_name,
)
from excite.export.simulators.model_format import LoadedModel, ModelFormat, Rendered
from excite.export.simulators.subject import JOINT_TERMS, SERVO_TERMS, Subject
from excite.export.simulators.tree.read import LoadedTree
from excite.export.simulators.usd.reading import read_usda
from excite.export.simulators.usd.usda import UsdaFormat

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
        return LoadedIsaacLab(subject, read_usda(subject.robot, usda.decode()), group.arguments)

    def _known(self, subject: Subject, values: Array) -> dict[str, float]:
        pairs = zip(subject.robot.joint_names, values, strict=True)
        return {name: float(value) for name, value in pairs if np.isfinite(value)}


class LoadedIsaacLab(LoadedModel):
    """The bodies of a USD with the joints' terms that a configuration sets."""

    def __init__(self, subject: Subject, tree: LoadedTree, given: Mapping[str, Any]) -> None:
        self._tree, joints = tree, subject.robot.joint_names
        fields = {**_FIELDS, "torque_limit": "actuator_effort_limit"}
        if "joint_effort_limit" in given:
            fields["torque_limit"] = "joint_effort_limit"
        read = {term: by_joint(given.get(name), joints) for term, name in fields.items()}
        read["delay"] = by_joint(given.get("min_delay"), joints) * PHYSICS_DT
        drives = {
            term: np.where(np.isfinite(read[term]), read[term], tree.drives[term]) for term in JOINT_TERMS
        }
        super().__init__(drives, {term: read[term] for term in SERVO_TERMS})

    def torques(self, states: States) -> Array:
        """See :class:`LoadedModel`."""
        return self._tree.torques(states, self.drives)
