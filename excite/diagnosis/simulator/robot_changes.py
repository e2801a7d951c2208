"""Accepted effects as changes of a robot's description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.robot_changes import RobotChanges
from excite.diagnosis.effects.form import Form
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import model_phi
from excite.diagnosis.search.attribution import Attribution
from excite.diagnosis.simulator.accepted_values import found_effects
from excite.diagnosis.simulator.augmented_plant import Plant, fitted_plant, physical_plant, with_effect
from excite.diagnosis.simulator.found import Found
from excite.diagnosis.simulator.model_text import MODEL
from excite.robot.links import carried_link

# Relative to a link's own, a change of its parameters that is rounding.
_NOTHING = 1e-9


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
    wanted, said = fitted_plant(baseline), []
    for item in effects:
        form = item.form(samples.joints)
        wanted = with_effect(wanted, baseline, item.location, form)
        said += _beyond(item, form)
    bodies = any(item.form(samples.joints).body is not None for item in effects)
    plant = physical_plant(baseline, wanted) if bodies else wanted
    drives = [
        {name: max(float(v), 0.0) for name, v in zip(samples.joints, values, strict=True)}
        for values in (plant.viscous, plant.coulomb, plant.armature)
    ]
    viscous, coulomb, armature = drives
    return RobotChanges(
        viscous, coulomb, armature, _bodies(baseline, plant) if bodies else {}, beyond=tuple(said)
    )


def _bodies(baseline: Baseline, plant: Plant) -> dict[str, Array]:
    """By link, what it has more than the nominal model; where bodies are fitted they are nobody's effect."""
    if baseline.free:
        return {}
    model = baseline.samples.robot.model
    nominal = model_phi(baseline.samples).reshape(-1, 10)
    change = plant.phi.reshape(-1, 10) - nominal
    least = _NOTHING * np.abs(nominal).max(initial=1e-3)
    return {
        carried_link(model, k + 1): row
        for k, row in enumerate(change)
        if np.abs(row).max(initial=0.0) > least
    }


def _beyond(item: Found, form: Form) -> list[str]:
    """Parts of an effect that a description has no place for."""
    what = f"{item.effect.name.replace('_', ' ')} at {item.location}"
    if form.absent is not None:
        return [f"{what}: in no file, {form.absent}"]
    said = []
    if form.bias != 0.0:
        said.append(f"{what}: of the reading ({form.bias:.3g}), not of the robot; take it off the log")
    if form.gravity is not None:
        said.append(f"{what}: gravity stands in log.yaml, which is left as it is")
    if form.elements is not None or form.finish is not None or form.notes:
        all_of_it = not (form.viscous or form.coulomb or form.armature)
        part = "it stands" if all_of_it else "how it builds up and changes stands"
        said.append(f"{what}: {part} in {MODEL} alone")
    return said
