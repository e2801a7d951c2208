"""mjlab: an entity's configuration in Python, and the MuJoCo model that it is made of."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from excite.arrays import Array
from excite.export.models.verification import States
from excite.export.simulators.friction import with_friction
from excite.export.simulators.labs.script import (
    PHYSICS_DT,
    common_value,
    delay_note,
    delay_text,
    module_name,
    path_beside,
    record_configuration,
    variable_name,
)
from excite.export.simulators.mjcf import MjcfFormat
from excite.export.simulators.model_format import LoadedModel, ModelFormat, Rendered
from excite.export.simulators.subject import JOINT_TERMS, SERVO_TERMS, Subject
from excite.simulation.mjcf_shapes import GROUND

_TEMPLATE = '''"""{robot} as it was identified, for mjlab 1.6 or newer; written by excite.

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
_FIELDS = {
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
        columns = {name: term(name) if name in JOINT_TERMS else subject.servo(name) for name in _FIELDS}
        joints = [
            f"    {name!r}: dict(" + ", ".join(self._terms(columns, index)) + "),"
            for index, name in enumerate(robot.joint_names)
        ]
        rest = zip(robot.joint_names, robot.rest[robot.n_base_q :], strict=True)
        text = _TEMPLATE.format(
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
        return LoadedMjlab(subject, self._mjcf.load(subject, model), [one.arguments for one in actuators])

    def exact(self, subject: Subject) -> bool:
        """As of the model."""
        return self._mjcf.exact(subject)

    @staticmethod
    def _terms(columns: Mapping[str, Array], index: int) -> list[str]:
        """Keywords of a joint's actuator; a servo without gains, which no robot.yaml gave, pulls nothing."""
        found = []
        for term, name in _FIELDS.items():
            value = float(columns[term][index])
            if np.isfinite(value):
                found.append(f"{name}={value!r}")
            elif term in _NEEDED:
                found.append(f"{name}=0.0")
        return found


class LoadedMjlab(LoadedModel):
    """A MuJoCo model with what actuators' configurations set in it."""

    def __init__(self, subject: Subject, model: LoadedModel, actuators: list[Mapping[str, Any]]) -> None:
        self._robot, self._model = subject.robot, model
        rows = [_actuator_of(name, actuators) for name in subject.robot.joint_names]
        read = {
            term: np.array([np.nan if row.get(name) is None else float(row[name]) for row in rows])
            for term, name in _FIELDS.items()
        }
        lags = [float(row.get("delay_min_lag", np.nan)) for row in rows]
        drives = {
            term: np.where(np.isfinite(read[term]), read[term], model.drives[term]) for term in JOINT_TERMS
        }
        servos = {term: read[term] for term in SERVO_TERMS if term in read}
        super().__init__(drives, {**servos, "delay": np.array(lags) * PHYSICS_DT})

    def torques(self, states: States) -> Array:
        """MuJoCo's own, with the difference that the configuration makes."""
        more = {term: self.drives[term] - self._model.drives[term] for term in JOINT_TERMS}
        return with_friction(self._robot, self._model.torques(states), states, more)


def _actuator_of(joint: str, actuators: list[Mapping[str, Any]]) -> Mapping[str, Any]:
    """The actuator that drives a joint."""
    for one in actuators:
        if any(re.fullmatch(pattern, joint) for pattern in one["target_names_expr"]):
            return one
    return {}
