"""Accepted effects as changes of a robot's description."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from excite.arrays import Array
from excite.diagnosis.answer.robot_changes import RobotChanges
from excite.diagnosis.attribution.attribution import Attribution
from excite.diagnosis.effects.form import Form
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import model_phi
from excite.diagnosis.simulator.accepted_values import found_effects
from excite.diagnosis.simulator.augmented_plant import Plant, physical_plant, plant_with
from excite.diagnosis.simulator.found import Found
from excite.diagnosis.simulator.model_text import MODEL
from excite.robot.links import carried_link


def robot_changes(attribution: Attribution, baseline: Baseline) -> tuple[RobotChanges, ...]:
    """What the first none, one, two … of the accepted effects change.

    Friction and rotor inertia are all that the model of the record has, with what ``modelled`` had fitted; bodies are
    the effects' alone, as near to them as bodies can be.

    Args:
        attribution: the attribution.
        baseline: the baseline before it.
    """
    effects = found_effects(attribution)
    made = [_changes(baseline, ())]
    for count in range(1, len(effects) + 1):
        last = count == len(effects)
        beside = attribution.final if last else attribution.stages[count].context.baseline
        made.append(_changes(beside, effects[:count]))
    return tuple(made)


def _changes(baseline: Baseline, effects: Sequence[Found]) -> RobotChanges:
    samples = baseline.samples
    forms = [item.form(samples.joints) for item in effects]
    wanted = plant_with(baseline, ((item.location, form) for item, form in zip(effects, forms, strict=True)))
    said = [line for item, form in zip(effects, forms, strict=True) for line in _beyond(item, form)]
    links = {item.location for item, form in zip(effects, forms, strict=True) if form.body is not None}
    plant = physical_plant(baseline, wanted) if links else wanted
    drives = [
        {name: max(float(v), 0.0) for name, v in zip(samples.joints, values, strict=True)}
        for values in (plant.viscous, plant.coulomb, plant.armature)
    ]
    viscous, coulomb, armature = drives
    return RobotChanges(viscous, coulomb, armature, _bodies(baseline, plant, links), beyond=tuple(said))


def _bodies(baseline: Baseline, plant: Plant, links: Collection[str]) -> dict[str, Array]:
    """What each of these links has more than the nominal model, which stands where bodies have effects."""
    model = baseline.samples.robot.model
    change = (plant.phi - model_phi(baseline.samples)).reshape(-1, 10)
    names = [carried_link(model, k) for k in range(1, model.njoints)]
    return {name: row for name, row in zip(names, change, strict=True) if name in links}


def _beyond(item: Found, form: Form) -> list[str]:
    """Parts of an effect that a description has no place for."""
    what = _named(item.effect.name, item.location)
    if form.absent is not None:
        return [f"{what}: in no file, {form.absent}"]
    said = []
    if form.bias != 0.0:
        said.append(f"{what}: of the reading ({form.bias:.3g}), not of the robot; take it off the log")
    if form.gravity is not None:
        said.append(f"{what}: gravity stands in log.yaml, which is left as it is")
    if form.elements is not None or form.finish is not None or form.notes:
        all_of_it = not (form.viscous or form.coulomb or form.armature)
        more = f"{what}: how it builds up and changes stands in {MODEL} alone"
        said.append(in_no_description(item.effect.name, item.location) if all_of_it else more)
    return said


def in_no_description(effect: str, location: str) -> str:
    """The sentence for an effect that a simulator has and no description of a robot."""
    return f"{_named(effect, location)}: it stands in {MODEL} alone"


def _named(effect: str, location: str) -> str:
    return f"{effect.replace('_', ' ')} at {location}"
