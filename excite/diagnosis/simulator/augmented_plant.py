"""An arm's simulator with effects in it: the nearest plant that can exist, as a MuJoCo model and as a description."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from excite.arrays import Array
from excite.diagnosis.answer.candidate import RobotChanges, in_words
from excite.diagnosis.attribution import Attribution, Scored
from excite.diagnosis.effects.effect import Effect
from excite.diagnosis.effects.form import Absence, Context, Draft, Form, InitialState, Note, Noted, Sizes
from excite.diagnosis.effects.friction import PRESLIDING, PreslidingNote
from excite.diagnosis.effects.registry import EFFECTS
from excite.diagnosis.equations.baseline import Baseline
from excite.diagnosis.equations.baseline_fit import model_phi
from excite.diagnosis.equations.dry_friction.friction_sign import sign_of_motion
from excite.diagnosis.equations.known_drives import known_terms
from excite.diagnosis.equations.own_columns import ARMATURE, CONSTANT, COULOMB, VISCOUS, own_terms
from excite.errors import InputError
from excite.identification.inertia import pseudo_inertia_matrices
from excite.regressor.kernels import joint_torque_regressor
from excite.robot.links import carried_link
from excite.simulation.mjcf import World, build_spec
from excite.simulation.true_parameters import Drives

if TYPE_CHECKING:
    import mujoco

_ROWS = 500
_TIMESTEP = 1e-3
_NO_LIMIT = 1e6
# Terms of a plant's drives, in order.
_DRIVES = (VISCOUS, COULOMB, ARMATURE)


@dataclass(frozen=True, eq=False)
class Plant:
    """A rigid-body arm with friction and rotor inertia.

    Attributes:
        phi: ``(10·n_segments,)`` inertial parameters.
        drives: ``(3, n_joints)`` viscous friction [N·m·s/rad], Coulomb friction [N·m], rotor inertia [kg·m²].
        bias: ``(n_joints,)`` constant of the torque channels [N·m].
        mismatch: RMS over rows and joints of the torque by which it differs from the fit, each joint in units of
            the fit's own residual.
    """

    phi: Array
    drives: Array
    bias: Array
    mismatch: float = 0.0


def plant_with(baseline: Baseline, forms: Iterable[tuple[str, Form]]) -> Plant:
    """The plant as fitted, with the bodies and drives of effects: possibly no physical one.

    A torque channel's factor is told from the bodies' torque; what is its joint's alone was fitted to readings.

    Args:
        baseline: the baseline as fitted together with the effects.
        forms: places and forms of the effects.
    """
    samples, terms = baseline.samples, own_terms(baseline.modelled)
    own = np.array([o[: len(terms)] for o in baseline.fit.own_coefs]).reshape(baseline.n_joints, len(terms)).T
    values = dict(zip(terms, own, strict=True))
    known = {item.term: item.values for item in known_terms(samples, baseline.modelled)}
    nothing = np.zeros(baseline.n_joints)
    drives = np.array([values.get(term, nothing) + known.get(term, 0.0) for term in _DRIVES])
    bias, phi = values.get(CONSTANT, nothing).copy(), baseline.phi.copy()
    changes = [(location, form) for location, form in forms if form.absent is None]
    joints = [(samples.joints.index(place), form) for place, form in changes if place in samples.joints]
    for j, form in joints:
        drives[:, j] /= form.reads
    for j, form in joints:
        drives[:, j] += form.viscous, form.coulomb, form.armature
        bias[j] += form.bias
    links = _body_links(baseline)
    for place, form in changes:
        if form.body is not None:
            phi.reshape(-1, 10)[links.index(place)] += form.body
    return Plant(phi, drives, bias)


def _body_links(baseline: Baseline) -> list[str]:
    """The links whose bodies the inertial parameters are, in order."""
    model = baseline.samples.robot.model
    return [carried_link(model, joint) for joint in range(1, model.njoints)]


def physical_plant(baseline: Baseline, wanted: Plant, gravity: Array | None = None) -> Plant:
    """The nearest physical plant: torques at the identification rows weigh, nominal values break ties.

    Args:
        baseline: the fitted baseline: its samples and each joint's residual σ.
        wanted: x̂.
        gravity: ``(3,)`` [m/s²] where it is not the log's.

    Returns:
        The plant, ``wanted`` itself where that is physical.
    """
    nominal, n = model_phi(baseline.samples), len(wanted.phi)
    units = np.maximum(np.abs(wanted.drives).max(axis=1, initial=0.0), 1e-3)
    bodies = PhysicalBodies(nominal, np.repeat(units, baseline.n_joints))
    wish = bodies.to_coordinates(np.concatenate([wanted.phi, wanted.drives.ravel()]))
    if bodies.is_feasible(wish):
        return wanted
    middle = bodies.to_coordinates(np.concatenate([nominal, np.maximum(wanted.drives, 0.0).ravel()]))
    rows = _scaled_regressor(baseline, gravity).reshape(-1, len(wish)) @ bodies.map
    z, off = nearest_bodies(bodies, rows, wish, middle)
    found = bodies.map @ z
    return Plant(found[:n], found[n:].reshape(3, -1), wanted.bias, off)


def _scaled_regressor(baseline: Baseline, gravity: Array | None) -> Array:
    """Torque per unit of every parameter in units of each joint's residual, ``(n_rows, n_joints, n)``."""
    s = baseline.samples
    inside = [k for k, trial in enumerate(s.trials) if trial.identification]

    def at_rows(values: Sequence[Array]) -> Array:
        stacked = np.concatenate([values[k][s.trials[k].rows] for k in inside])
        return stacked[:: max(1, len(stacked) // _ROWS)]

    motion = [at_rows([getattr(t, name) for t in s.trials]) for name in ("q", "v", "a")]
    v, a = (s.motor_values(rate) for rate in motion[1:])
    model, n = s.robot.model, len(s.joints)
    drives = np.zeros((len(v), n, 3, n))
    for j in range(n):
        dry = at_rows(s.by_trial(sign_of_motion(s, j, baseline.signs[j])))
        drives[:, j, :, j] = np.column_stack([v[:, j], dry, a[:, j]])
    if gravity is not None:
        model = model.copy()
        model.gravity.linear = gravity
    maps = s.motion_maps if len(s.motion_maps) == 1 else at_rows(s.by_trial(s.motion_maps))
    bodies = s.on_motors(joint_torque_regressor(model, *motion), maps)
    return np.concatenate([bodies, drives.reshape(len(v), n, -1)], axis=2) / baseline.fit.sigma[None, :, None]


# The MuJoCo model, and notes on what XML cannot say.


def augmented_model(baseline: Baseline, effects: Sequence[FoundEffect]) -> AugmentedModel:
    """The simulator with effects; without any, the fitted or trusted baseline.

    Args:
        baseline: the baseline as fitted together with them.

    Raises:
        InputError: the robot has joints that cannot be simulated, or MuJoCo refuses the bodies.
    """
    joints, robot = baseline.samples.joints, baseline.samples.robot
    forms = [item.mujoco_form(joints) for item in effects]
    wanted = plant_with(baseline, zip((item.location for item in effects), forms, strict=True))
    plant = physical_plant(baseline, wanted, _turn_gravity(np.array(robot.model.gravity.linear), forms))
    draft = Draft(joints, _draft_model(baseline, plant))
    draft.spec.option.gravity = _turn_gravity(np.array(draft.spec.option.gravity), forms)
    for noted in _presliding_notes(baseline):
        write_note(draft.spec, noted)
    for form in forms:
        if form.elements is not None:
            form.elements(draft)
        for noted in form.notes:
            write_note(draft.spec, noted)
    for form in forms:
        if form.finish is not None:
            form.finish(draft)
    try:
        draft.spec.compile()
    except ValueError as error:
        raise refused_model_error(error) from error
    formless = (item.reason_of_absence for item in effects)
    said = (*(text for text in formless if text is not None), *describe_mismatch(plant.mismatch, "residual"))
    return AugmentedModel(draft.spec.to_xml(), said)


def _turn_gravity(gravity: Array, forms: Sequence[Form]) -> Array:
    """Gravity ``(3,)`` as effects turn it [m/s²]."""
    for form in forms:
        gravity = gravity if form.gravity is None else form.gravity(gravity)
    return gravity


def _presliding_notes(baseline: Baseline) -> list[Noted]:
    """What is noted of the baseline's own friction: where it builds up over a deflection."""
    if not COULOMB.is_modelled(baseline.modelled):
        return []
    noted = []
    for j, (joint, sign) in enumerate(zip(baseline.samples.joints, baseline.signs, strict=True)):
        if sign.has_bristles:
            damped = (baseline.bristle_damping(j), sign.damped_below) if sign.has_damping else (None, None)
            noted.append(Noted(PRESLIDING, joint, PreslidingNote(sign.breakaway, *damped)))
    return noted


def _draft_model(baseline: Baseline, plant: Plant) -> mujoco.MjSpec:
    """Bodies, friction and rotor inertia, a motor for each joint."""
    robot, index = baseline.samples.robot, list(baseline.samples.index)
    every = np.zeros((4, robot.n_joints))
    every[:, index] = *plant.drives, plant.bias
    viscous, coulomb, armature, bias = every
    nothing = np.zeros(robot.n_joints)
    drives = Drives(
        kp=nothing + 1.0,
        kd=nothing,
        torque_limit=nothing + _NO_LIMIT,
        viscous=viscous,
        coulomb=coulomb,
        bearing_viscous=nothing,
        bearing_coulomb=nothing,
        armature=armature,
        rate_hz=1.0 / _TIMESTEP,
    )
    spec = build_spec(robot, plant.phi, drives, World(timestep=_TIMESTEP))
    for number, name in enumerate(robot.joint_names):
        motor = spec.actuator(name)
        motor.forcelimited = False
        motor.gainprm[0] = 1.0
        motor.biasprm[:3] = [-bias[number], 0.0, 0.0]
        # Positions are the record's: a range would push where the model's is narrower.
        spec.joint(name).limited = False
    return spec


# Bodies that can exist, as near to fitted inertial parameters as rows of a regressor can tell.

_PRIOR = 1e-3
_ITERATIONS = 1500
_RELAXATION = 1.6
# Steps of the coordinates, which are of order one, that nothing is left to be found in.
_DONE = 1e-12
_NOTABLE = 1.0
# Least eigenvalue of a body's pseudo-inertia, relative to its nominal trace, lengths in its own radius.
_INSIDE = 1e-4
_UPPER = np.triu_indices(4)
_WEIGHT = np.where(_UPPER[0] == _UPPER[1], 1.0, np.sqrt(2.0))


class PhysicalBodies:
    """Bodies of positive density and drive terms that are not negative, in coordinates that need no units.

    A body's coordinates are its pseudo-inertia, lengths in its radius and masses in half its nominal one, stacked
    so that their Euclidean norm is the matrix's Frobenius norm: the nearest body is then a matter of eigenvalues.

    Attributes:
        map: ``(n, n)`` from coordinates to parameters.
    """

    def __init__(self, nominal: Array, drives: Array):
        mass = np.maximum(nominal.reshape(-1, 10)[:, 0], 0.02)
        pseudo = pseudo_inertia_matrices(nominal)
        radius = np.sqrt(np.trace(pseudo[:, :3, :3], axis1=1, axis2=2) / mass)
        self.size = len(nominal)
        self.inverse_radius = 1.0 / np.maximum(radius, 0.02)
        self.mass = 0.5 * mass
        blocks = [self._stack_coordinates(np.eye(10)[k]).T for k in range(10)]
        forward = np.stack(blocks, axis=2).transpose(1, 0, 2)
        total = np.zeros((self.size + len(drives),) * 2)
        for k, block in enumerate(forward):
            total[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] = np.linalg.inv(block)
        total[self.size :, self.size :] = np.diag(drives)
        self.map = total
        self._inverse = np.linalg.inv(total)
        self.least = _INSIDE * np.trace(self._normalise_pseudo_inertias(pseudo), axis1=1, axis2=2)

    def to_coordinates(self, x: Array) -> Array:
        """Coordinates of parameters ``(n,)``."""
        return self._inverse @ x

    def is_feasible(self, y: Array) -> bool:
        """Whether these coordinates are those of bodies and drive terms that can be."""
        return bool(np.allclose(self.nearest_feasible(y), y, rtol=1e-9, atol=1e-9))

    def nearest_feasible(self, y: Array) -> Array:
        """Coordinates of the nearest bodies and drive terms."""
        out = np.maximum(y, 0.0)
        bodies = y[: self.size].reshape(-1, 10)
        full = np.zeros((len(bodies), 4, 4))
        full[:, _UPPER[0], _UPPER[1]] = full[:, _UPPER[1], _UPPER[0]] = bodies / _WEIGHT
        values, vectors = np.linalg.eigh(full)
        raised = np.maximum(values, self.least[:, None])
        near = np.einsum("kij,kj,klj->kil", vectors, raised, vectors)
        out[: self.size] = (near[:, _UPPER[0], _UPPER[1]] * _WEIGHT).ravel()
        return out

    def _normalise_pseudo_inertias(self, pseudo: Array) -> Array:
        d = np.ones((len(pseudo), 4))
        d[:, :3] = self.inverse_radius[:, None]
        return pseudo * d[:, :, None] * d[:, None, :] / self.mass[:, None, None]

    def _stack_coordinates(self, ten: Array) -> Array:
        """Coordinates ``(n_segments, 10)`` of the same ten parameters in every segment."""
        pseudo = np.tile(pseudo_inertia_matrices(ten), (len(self.mass), 1, 1))
        return self._normalise_pseudo_inertias(pseudo)[:, _UPPER[0], _UPPER[1]] * _WEIGHT


def nearest_bodies(bodies: PhysicalBodies, rows: Array, wish: Array, middle: Array) -> tuple[Array, float]:
    """Coordinates of the nearest physical bodies: rows weigh, nominal values break ties.

    Minimises ``|A (x − x̂)|²/m + λ |x − x_nominal|²`` over bodies of positive density and drive terms that are not
    negative, by the alternating direction method of multipliers (Boyd et al. 2011, section 3).

    Args:
        bodies: the set.
        rows: A ``(m, n)`` in its coordinates, each row in units of what it is known to.
        wish: x̂ ``(n,)``.
        middle: nominal values ``(n,)``.

    Returns:
        The coordinates, and by how much rows are off with them (RMS).
    """
    gram = rows.T @ rows / max(len(rows), 1)
    right = gram @ wish + _PRIOR * middle
    penalty = float(np.sqrt(_PRIOR * np.linalg.eigvalsh(gram)[-1]))
    inverse = np.linalg.inv(gram + (_PRIOR + penalty) * np.eye(len(wish)))
    z, u = bodies.nearest_feasible(wish), np.zeros(len(wish))
    for _ in range(_ITERATIONS):
        x = _RELAXATION * inverse @ (right + penalty * (z - u)) + (1.0 - _RELAXATION) * z
        last, z = z, bodies.nearest_feasible(x + u)
        u = u + x - z
        if max(np.abs(z - last).max(), np.abs(x - z).max()) < _DONE:
            break
    return z, float(np.sqrt(np.mean((rows @ (z - wish)) ** 2)))


def describe_mismatch(mismatch: float, unit: str) -> tuple[str, ...]:
    """What is to be said of bodies that are off a fit by so many times a ``unit``; nothing where that is little."""
    if mismatch <= _NOTABLE:
        return ()
    return (
        "the fitted inertial parameters are no bodies' that can exist; the nearest ones are off by "
        f"{mismatch:.1f} times the {unit}",
    )


# Accepted effects as changes of a robot's description.


def robot_changes(attribution: Attribution) -> tuple[RobotChanges, ...]:
    """What the first none, one, two … of the accepted effects change.

    Friction and rotor inertia are all that the model of the record has, with what ``modelled`` had fitted; bodies are
    the effects' alone, as near to them as bodies can be.
    """
    effects = found_effects(attribution)
    return tuple(_robot_changes(attribution.baseline_at(n), effects[:n]) for n in range(len(effects) + 1))


def _robot_changes(baseline: Baseline, effects: Sequence[FoundEffect]) -> RobotChanges:
    samples, links = baseline.samples, _body_links(baseline)
    pairs = [(item, item.mujoco_form(samples.joints)) for item in effects]
    plant = plant_with(baseline, ((item.location, form) for item, form in pairs))
    loaded = {item.location for item, form in pairs if form.body is not None}
    if loaded:
        plant = physical_plant(baseline, plant)
    viscous, coulomb, armature = (
        {name: max(float(v), 0.0) for name, v in zip(samples.joints, values, strict=True)}
        for values in plant.drives
    )
    change = (plant.phi - model_phi(samples)).reshape(-1, 10)
    bodies = {name: row for name, row in zip(links, change, strict=True) if name in loaded}
    beyond = tuple(line for item, form in pairs for line in _undescribed_parts(item, form))
    return RobotChanges(viscous, coulomb, armature, bodies, beyond)


def _undescribed_parts(item: FoundEffect, form: Form) -> list[str]:
    """Parts of an effect that a description has no place for."""
    what = in_words(item.effect.name, item.location)
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
        said.append(describe_missing(item.effect.name, item.location) if all_of_it else more)
    return said


def describe_missing(effect: str, location: str) -> str:
    """The sentence for an effect that a simulator has and no description of a robot."""
    return f"{in_words(effect, location)}: it stands in {MODEL} alone"


# The text of an augmented model: loaded by MuJoCo, and what stands in it of effects that XML cannot express.

# First part of the names of the ``<custom>`` texts in which effects stand.
NOTE = "excite"
MODEL = "augmented.xml"


@dataclass(frozen=True, eq=False)
class AugmentedModel:
    """A MuJoCo model of an arm, its actuators motors that take torques, or of a standing robot, its sensors sites.

    Attributes:
        xml: the model. What XML cannot express stands in it as ``<custom><text name="excite.EFFECT.PLACE"/>``,
            applied by :class:`excite.diagnosis.simulator.rollout.Simulator` or its twin for standing robots.
        warnings: what it could not take up, one sentence each.
    """

    xml: str
    warnings: tuple[str, ...]


def describe_left_out(left: Sequence[str]) -> tuple[str, ...]:
    """What is said where a model lacks effects, each ``NAME at PLACE``, that bring roll-outs no nearer."""
    if not left:
        return ()
    reason = "roll-outs of the identification trials are no nearer with it"
    return (f"the model is without {', '.join(left)}: {reason}",)


def load_model(xml: str) -> mujoco.MjModel:
    """The model; InputError where MuJoCo refuses it."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise refused_model_error(error) from error


def refused_model_error(error: ValueError) -> InputError:
    """What is said of a model that MuJoCo refuses."""
    said = " ".join(str(error).split())
    return InputError(f"MuJoCo refuses the model ({said})", remedy="judge by the torques or wrenches")


def model_notes(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """What follows ``excite.`` in the name of each text of an effect, and the text."""
    import mujoco

    found = []
    for k in range(model.ntext):
        head, _, rest = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, k).partition(".")
        if head == NOTE and rest:
            first, size = int(model.text_adr[k]), int(model.text_size[k])
            found.append((rest, bytes(model.text_data[first : first + size]).decode().rstrip("\0")))
    return found


# Sizes of the accepted effects as a simulator needs them.


def found_effects(attribution: Attribution) -> tuple[FoundEffect, ...]:
    """The accepted effects with their sizes as fitted together, beside a channel's gain in units of the true torque."""
    found = [_accepted_effect(item) for item in attribution.accepted]
    forms = [item.mujoco_form((item.location,)) for item in found]
    reads = {item.location: form.reads for item, form in zip(found, forms, strict=True) if form.reads != 1.0}
    return tuple(
        _read_at(item, reads[item.location]) if item.location in reads and _of_the_joint(item, form) else item
        for item, form in zip(found, forms, strict=True)
    )


def _of_the_joint(item: FoundEffect, form: Form) -> bool:
    """Whether an effect is a torque of its joint, neither a body nor of the channel that reads it."""
    return item.effect.own_joint and form.reads == 1.0 and form.bias == 0.0


def _read_at(item: FoundEffect, factor: float) -> FoundEffect:
    """An effect that a channel reads larger by a factor: its torques, and its shares of the load."""
    torques = {p.name for p in item.effect.linear if item.effect.by_load or p.unit != "1"}
    return replace(item, values={n: v / factor if n in torques else v for n, v in item.values.items()})


def _accepted_effect(item: Scored) -> FoundEffect:
    h = item.hypothesis
    return FoundEffect(
        h.effect, item.location, h.effect.to_sizes(Context(h.baseline), h.location, h.theta, h.fit)
    )


def initial_states(attribution: Attribution) -> tuple[tuple[str, InitialState], ...]:
    """By place, what the record tells of each accepted effect's own state."""
    hypotheses = [item.hypothesis for item in attribution.accepted]
    return tuple((h.location, h.effect.initial_state(h.fit_context, h.location, h.theta)) for h in hypotheses)


# An accepted effect with its sizes, as a simulator takes it up.


@dataclass(frozen=True)
class FoundEffect:
    """An accepted effect with its sizes.

    Attributes:
        effect: the effect, in the form that was fitted.
        location: its place.
        values: its parameters, SI.
    """

    effect: Effect
    location: str
    values: Mapping[str, float]

    def mujoco_form(self, joints: tuple[str, ...]) -> Form:
        """Its form in a model of an arm with torque at these joints."""
        if self.effect.behind and self.location not in joints:
            return Form(absent=Absence.BEHIND)
        return self.effect.in_mujoco(Sizes(self.location, self.values, joints))

    @property
    def reason_of_absence(self) -> str | None:
        """Why no model can have it, in a sentence; None where models can."""
        absent = self.mujoco_form((self.location,)).absent
        if absent is None:
            return None
        return f"{self.effect.name} has no form in a simulator and is left out of the model: {absent}"


# Notes of effects in a model: written as texts of it, and read again as what they are.


def write_note(spec: mujoco.MjSpec, item: Noted) -> None:
    """Leave a note in a specification."""
    spec.add_text(name=f"{NOTE}.{item.word}.{item.place}", data=item.note.to_text())


def read_notes(model: mujoco.MjModel) -> tuple[Noted, ...]:
    """The notes in a loaded model, in order.

    Raises:
        InputError: a note is of no effect that is known, or lacks a number.
    """
    return tuple(_read_note(name, text) for name, text in model_notes(model))


def _read_note(name: str, text: str) -> Noted:
    word, _, place = name.partition(".")
    kind = PreslidingNote if word == PRESLIDING else _of_effect(word)
    if kind is None or not place:
        raise InputError(
            f"the model has a note of no effect that is known ({NOTE}.{name})",
            field=word,
            remedy=f"name it {NOTE}.EFFECT.PLACE, with an effect that leaves notes",
        )
    pairs = [pair.partition("=") for pair in text.split()]
    try:
        values = {key: float(value) for key, _, value in pairs}
        note = kind.from_values(values)
    except (TypeError, ValueError) as error:
        raise _unreadable_note(name, text, kind) from error
    if set(values) - set(kind.number_names()):
        raise _unreadable_note(name, text, kind)
    return Noted(word, place, note)


def _unreadable_note(name: str, text: str, kind: type[Note]) -> InputError:
    return InputError(
        f"the note {NOTE}.{name} cannot be read ({text})",
        field=name,
        remedy=f"write NAME=NUMBER, with the names {', '.join(kind.number_names())}",
    )


def _of_effect(word: str) -> type[Note] | None:
    effect = EFFECTS.get(word)
    return None if effect is None else effect.note
