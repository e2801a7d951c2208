"""Rules for channels that are not what the log calls them, and for machines that are not the model's, by physics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from excite.arrays import Array, Flags
from excite.display import percent
from excite.doctor.case import Case
from excite.doctor.channel_errors import (
    DELAY,
    OF_TORQUES,
    OF_WRENCHES,
    Misreading,
    find_promising,
    misreadings,
    refine_zeros,
)
from excite.doctor.channel_mapping import Reading
from excite.doctor.checks.values import never_at_end, of_unknown_unit
from excite.doctor.doubt import Doubt
from excite.doctor.inertial_prior import STRONG_ODDS
from excite.doctor.mistakes.torques import (
    ADDED,
    OtherMachine,
    best_load,
    find_delay,
    other_machine,
    take_weight,
)
from excite.doctor.samples import Correction, Mistake
from excite.doctor.thresholds import THRESHOLD
from excite.doctor.torque_samples import TorqueSamples
from excite.doctor.torque_scale import TORQUE_SCALE, name_units
from excite.doctor.wrench_samples import wrench_samples
from excite.finding import list_names
from excite.logs.log import Trial
from excite.logs.robot import robot_in_log
from excite.regressor.kernels import inverse_dynamics
from excite.regressor.tree import read_tree
from excite.rows.kinematics import in_configurations

Found = tuple[Misreading, ...]
_OF_BODIES = frozenset({Doubt.SIZE, Doubt.CLOCK, Doubt.POSITION})


def find_misreadings(case: Case) -> None:
    """Signs, order, units, zeros, clock, delay, poses by which the model explains torques or wrenches far better."""
    header, stated = case.log.header, Reading.as_stated(case.log)
    if header.free_base and header.sensors and (wrenches := wrench_samples(case.robot, case.log)) is not None:
        _correct(case, *misreadings(wrenches, stated, _possible(case, OF_WRENCHES)), wrenches.what)
    elif (torques := case.samples) is not None:
        _find_in_torques(case, torques, stated, _possible(case, OF_TORQUES))


def _possible(case: Case, mistakes: Sequence[Mistake]) -> list[Mistake]:
    """Mistakes that a log's channels can have: postures that were computed have none."""
    late = replace(DELAY, corrections=partial(find_delay, late_s=case.latest_s))
    measured = case.log.header.posture == "measured"
    return [late if one is DELAY else one for one in mistakes if measured or not one.of_posture]


def _find_in_torques(
    case: Case, samples: TorqueSamples, stated: Reading, possible: Sequence[Mistake]
) -> None:
    reading, found = misreadings(samples, stated, possible)
    beside = samples
    # Without those that are told by how large the nominal bodies' torques are, and where their centres lie.
    fewer = [one for one in possible if not (one.leaves & _OF_BODIES or one.may_surprise)]
    if found:
        # Torques in a unit that nothing tells, too small for bodies anywhere near the nominal ones, betray nothing.
        if of_unknown_unit(samples, stated) is not None:
            return
        beside, (reading, found) = _beside_load(samples, stated, possible, (reading, found))
        # The size of one torque is as little told by bodies that are not the model's as several mistakes at once.
        sized = any(item.mistake is TORQUE_SCALE and not item.correction.ask for item in found)
        ways = ((stated, ()), misreadings(beside, stated, fewer)) if len(found) > 1 - sized else ()
        for read, some in ways:
            other = _explain_by_other_machine(beside, read, reading, found)
            if other is not None and len(found) > 1 - sized + len(some):
                _doubt(case, found)
                _report_other_model(case, samples, read, other, found)
                _correct(case, read, some, samples.what)
                return
    reading, found = refine_zeros(beside, reading, found, possible)
    outside = _leaves_limits(samples, reading)
    if (outside & ~_leaves_limits(samples, stated)).any():
        # Zeros that no joint of this robot can have stand for something else, as for another robot's axes.
        possible = [one for one in possible if Doubt.POSITION not in one.leaves]
        reading, found = misreadings(beside, stated, possible)
        outside = _leaves_limits(samples, reading)
    # What goes round and round is no joint with limits, whatever the model says.
    outside &= np.ptp(_positions(samples, reading), axis=0) <= 2.0 * np.pi
    size_known = case.log.header.torque != "current" and of_unknown_unit(samples, stated) is None
    bodies = _compare_bodies(samples, reading) if size_known else None
    if bodies is not None:
        # Units, clocks, weights are told by how large the nominal bodies' torques are, and zeros by where their centres
        # lie: with those of another robot 44 times what its model needs is no unit of a wrist's torque.
        # What other bodies explain as it is logged needs no mistake at all.
        for allowed in ([], fewer):
            less = refine_zeros(samples, *misreadings(samples, stated, allowed), allowed)
            again = _compare_bodies(samples, less[0])
            if again is not None:
                bodies, (reading, found) = again, less
                break
        alone = _explain_alone(samples, reading, possible)
        _report_other_model(case, samples, reading, bodies, alone=alone)
    elif size_known and (
        _is_elsewhere(samples, reading, found, outside) or samples.needs_unlikely_bodies(reading)
    ):
        _doubt(case, found)
        _report_other_model(
            case, samples, stated, other_machine(samples, stated, stated.tick), found, outside
        )
        return
    _correct_alike(case, stated, reading, found)


def _is_elsewhere(samples: TorqueSamples, reading: Reading, found: Found, outside: Flags) -> bool:
    """Whether two witnesses agree that no mistake alone brings into line: where joints were, and what moved them."""
    spoilt = len(found) > 1 or any(item.mistake.of_posture for item in found)
    return bool(outside.any()) and (spoilt or _unexplained(samples, reading) > THRESHOLD.in_place)


def _positions(samples: TorqueSamples, reading: Reading) -> Array:
    """Positions of the log's joints as the reading has them, ``(n, n_joints)``."""
    q, v, _ = samples.motion(reading)
    return q[:, samples.places + q.shape[1] - v.shape[1]]


def _leaves_limits(samples: TorqueSamples, reading: Reading) -> Flags:
    """Which joints would be outside their limits, whole turns and a margin aside, ``(n_joints,)``."""
    q, limits = _positions(samples, reading), samples.robot.limits
    index = [samples.robot.joint_index(joint) for joint in samples.joints]
    lower, upper = limits.position_lower[index], limits.position_upper[index]
    apart = 0.5 * (q.max(axis=0) + q.min(axis=0) - lower - upper)
    apart -= 2.0 * np.pi * np.round(apart / (2.0 * np.pi))
    return np.asarray(
        np.abs(apart) + 0.5 * np.ptp(q, axis=0) > (0.5 + THRESHOLD.beyond_range) * (upper - lower)
    )


def _correct(case: Case, reading: Reading, found: Found, what: str) -> None:
    """Report what was found and put the log right, but for what a person has to say first."""
    _doubt(case, found)
    for item in found:
        _report_misreading(case, item, what)
        back = item.correction.as_logged if item.correction.ask else None
        reading = reading if back is None else back(reading)
    if not all(item.correction.ask for item in found):
        case.log = reading.of(case.log)
    if reading.is_compensated and any(item.correction.mends == ADDED for item in found):
        put_weight_back(case, reading)


def find_scales_set_aside(case: Case) -> None:
    """Take torques back that were set aside, and look for another scale of theirs alone."""
    aside = case.set_aside
    case.change_header(no_torque=tuple(j for j in case.log.header.no_torque if j not in aside))
    samples, stated = case.samples, Reading.as_stated(case.log)
    if not aside or samples is None or case.is_strange:
        return

    def theirs(samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        return (one for one in TORQUE_SCALE.corrections(samples, reading) if {*one.places} <= {*aside})

    _correct(case, *misreadings(samples, stated, [replace(TORQUE_SCALE, corrections=theirs)]), samples.what)


# Trials that are not like the others.


def _correct_alike(case: Case, stated: Reading, reading: Reading, found: Found) -> None:
    """Correct the torques of all trials, unless that makes those of one of them much less likely."""
    several = len(case.log.trials) > 1 and not all(item.correction.ask for item in found)
    for part in case.trial_samples.values() if several else ():
        before = part.judged(stated)
        case.differing |= before.odds(part.judged(reading, before.counts)) < -STRONG_ODDS
    if not case.differing:
        _correct(case, reading, found, TorqueSamples.what)


def find_unexplained_torques(case: Case) -> None:
    """Trials whose torques neither likely bodies nor friction explain: not those of this motion, or spoilt.

    Bodies are fitted to each trial alone, so that one that differs from the others shows by itself; mistakes that
    explain it are looked for in it alone.
    """
    stated, header = Reading.as_stated(case.log), case.log.header
    if case.samples is None or header.torque == "current" or case.is_strange:
        return
    # What is cut off of a torque nothing explains.
    parts = case.trial_samples if never_at_end(case.log, case.samples).all() else {}
    lost = _unlike_others(parts, stated)
    possible, named = _possible(case, OF_TORQUES), set[str]()
    for name in parts if case.differing else lost if len(lost) < len(parts) else ():
        part = parts[name]
        reading, found = refine_zeros(part, *misreadings(part, stated, possible), possible)
        if found and part.unexplained_beside(reading, part.judged(reading).left) < THRESHOLD.in_place:
            text = "; ".join(item.correction.text for item in found)
            figures = {key: size for item in found for key, size in item.correction.figures.items()}
            places = tuple(dict.fromkeys(place for item in found for place in item.correction.places))
            sure, more = min(item.sure for item in found), {"severity": "spoils", "trials": (name,)}
            case.add("unexplained_torques", f"in {name} alone: {text}", figures, places, sure=sure, **more)
            named.add(name)
    if silent := tuple(name for name in lost if name not in named):
        text = (
            f"neither bodies near the model's nor friction explain the torques of {list_names(silent)}: they are not "
            "those of this motion, have lost their sign or place, or are another quantity"
        )
        figures = {"left": max(lost[name] for name in silent)}
        case.add("unexplained_torques", text, figures, case.samples.channels, trials=silent)


def _unlike_others(parts: Mapping[str, TorqueSamples], reading: Reading) -> dict[str, float]:
    """Trials of whose torques half stays unexplained, or far more than elsewhere, and that share, by name."""
    left = {name: part.judged(reading).left for name, part in parts.items()}
    whole = {name: float(np.exp(2.0 * left[name]) @ part.power(reading)) for name, part in parts.items()}
    beside = {name: part.unexplained_beside(reading, left[name]) for name, part in parts.items()}
    usual = [part.zeros_are_usual(reading) for part in parts.values()]
    return {
        name: whole[name]
        for name, part in parts.items()
        if whole[name] > THRESHOLD.unexplained
        # Beside much friction nearly all of every torque may be explained, and little of what the bodies make.
        or min(beside[name], np.exp(2.0 * left[name].max()))
        > THRESHOLD.in_place
        > min(beside.values()) / beside[name]
        or part.needs_unlikely_bodies(reading)
        or (any(usual) and not part.zeros_are_usual(reading))
    }


def find_zeroed_torques(case: Case) -> None:
    """Torques that were zeroed while they held the robot's weight: what they carried then is off them.

    They are next to nothing as a trial begins, where the bodies' weight is not. What is off them is told by the mean of
    each trial, in which inertial forces and friction cancel; trials of which some begin otherwise were zeroed at once.
    A first row that a logger filled with zeros is another thing: the other rows agree with the model as they are.
    """
    samples, header = case.samples, case.log.header
    if samples is None or header.torque == "current" or header.coupling:
        return
    mechanics, places = samples.robot, samples.places[samples.measured]
    tree, into = read_tree(mechanics.model), [header.joints.index(joint) for joint in samples.channels]
    off: dict[str, Array] = {}
    zeroed: list[bool] = []
    for trial in case.log.trials:
        if trial.tau is not None:
            some = slice(None, None, max(1, int(trial.n_samples / THRESHOLD.torque_samples)))
            q = in_configurations(mechanics, header.joints, trial.q[some])
            rest = np.zeros((len(q), tree.nv))
            weight, tau = inverse_dynamics(tree, q, rest, rest)[:, places], trial.tau[some][:, into]
            off[trial.name] = (weight - tau).mean(axis=0)
            first = np.linalg.norm([tau[0], weight[0]], axis=1)
            zeroed.append(bool(first[0] < THRESHOLD.next_to_nothing * first[1]))
    if not any(zeroed):
        return
    mean = np.mean(list(off.values()), axis=0)
    added = off if all(zeroed) else {name: mean for name in off}

    def add(trial: Trial) -> Trial:
        tau = None if trial.tau is None else trial.tau.copy()
        if tau is not None:
            tau[:, into] += added[trial.name]
        return replace(trial, tau=tau)

    mended = Case(case.robot, replace(case.log, trials=tuple(map(add, case.log.trials))))
    stated, then = Reading.as_stated(case.log), mended.samples
    ways = [(samples, stated), (samples, take_weight(stated, stated.gravity)), (then or samples, stated)]
    whole, bare, left = (one.measured_torque(way) - one.predicted(way).torque for one, way in ways)
    # Torques off which the weight was taken begin with next to nothing, too, whatever constants are in them.
    least = min(float((whole**2).sum()), float(((bare - bare.mean(axis=0)) ** 2).sum()))
    if float((left**2).sum()) > THRESHOLD.explained * least:
        return
    case.log = mended.log
    case.doubts.add(Doubt.SIZE)
    most = int(np.argmax(np.abs(mean)))
    text = (
        f"torques are zero as {sum(zeroed)} of {len(zeroed)} trials begin, where the bodies' weight is not: they were "
        f"zeroed under load, and lack a constant ({samples.channels[most]} {mean[most]:.3g} N·m)"
    )
    each = {f"added.{joint}": float(x) for joint, x in zip(samples.channels, mean, strict=True)}
    case.add("zeroed_torques", text, each, samples.channels)


def put_weight_back(case: Case, reading: Reading) -> None:
    """Add the weight that a driver took off torques by the nominal model.

    What is identified then are weights by the model that the driver has, as far as the nominal one is that. Of
    currents, or motors that are coupled, the share of a weight is not known: these joints are left out.
    """
    log, header, remedy = case.log, case.log.header, ADDED
    if header.torque == "current" or header.coupling:
        if not any(header.gravity):
            return
        some = reading.taken.any(axis=1) | reading.absent.any()
        case.ignore_torques(np.array(header.torque_joints)[some].tolist())
        remedy = "these joints are treated as no_torque; list them there, or log the measured torques"
    else:
        mechanics = robot_in_log(case.robot, header, log.folder)
        tree, joints = read_tree(mechanics.model), header.torque_joints
        columns = np.array([mechanics.n_base_v + mechanics.joint_index(joint) for joint in joints])
        into = [header.joints.index(joint) for joint in joints]

        def add(trial: Trial) -> Trial:
            tau = None if trial.tau is None else trial.tau.copy()
            if tau is not None:
                tau[:, into] += reading.taken_weight(
                    tree, in_configurations(mechanics, header.joints, trial.q), columns
                )
            return replace(trial, tau=tau)

        case.change_header(gravity=tuple(reading.gravity.tolist()))
        case.change_trials(add)
    case.findings = [
        replace(one, remedy=remedy) if one.kind == "compensated" else one for one in case.findings
    ]


def _beside_load(
    samples: TorqueSamples, stated: Reading, possible: Sequence[Mistake], found: tuple[Reading, Found]
) -> tuple[TorqueSamples, tuple[Reading, Found]]:
    """What torques betray beside a load where that explains them better than the first mistake would.

    A load of a robot's own weight is no likely body: torques of an arm that carried one were scaled, and without that
    its clock looked fast.
    """
    load = best_load(samples, stated)
    if load is not None:
        loaded = replace(samples, carried=load.parameters)
        before = samples.judged(stated)
        if before.odds(loaded.judged(stated, before.counts)) > found[1][0].gain:
            return loaded, misreadings(loaded, stated, possible)
    return samples, found


def _explain_by_other_machine(
    samples: TorqueSamples, read: Reading, mended: Reading, found: Found
) -> OtherMachine | None:
    """Another machine that explains the log as ``read``; None where all mistakes that were found explain more.

    One mistake is as likely as another model. Put into a Panda's log, mistakes of seven kinds explain 2.7 to 15 nat
    more than any bodies do; a UR10e's log with the model of a UR3 is explained by other bodies as well as by a unit of
    its own at every joint together with a clock that is too fast.
    """
    clock = any(item.mistake.name == "clock" and item.correction.ask for item in found)
    other = other_machine(samples, read, mended.tick if clock else read.tick)
    then = samples.judged(mended, samples.judged(read).counts)
    return other if float(then.counts @ (other.left - then.left)) - then.cost < STRONG_ODDS else None


def _unexplained(samples: TorqueSamples, reading: Reading) -> float:
    """Share of the torques' power beside drives that nominal bodies leave, and a load no heavier than they.

    A load is one body: of a robot that is not the model's it explains some, of its own robot nearly all that is left.
    """
    load, masses = best_load(samples, reading), samples.under(reading.gravity).phi[::10]
    left = samples.unexplained(reading)
    if load is None or load.mass > masses.sum():
        return left
    beside = samples.unexplained(reading, samples.felt(reading) @ load.parameters)
    return beside if beside < THRESHOLD.in_place * left else left


def _compare_bodies(samples: TorqueSamples, reading: Reading) -> OtherMachine | None:
    """Other bodies that leave next to nothing of a tenth or more that the nominal ones leave; None elsewhere."""
    left = _unexplained(samples, reading)
    if left < THRESHOLD.in_place:
        return None
    likely = OtherMachine(samples.judged(reading).left, 1.0)
    best = min((likely, other_machine(samples, reading, reading.tick)), key=lambda one: float(one.left.sum()))
    told = samples.unexplained_beside(reading, best.left) < THRESHOLD.in_place * min(left, 1.0)
    return best if told else None


def _explain_alone(samples: TorqueSamples, reading: Reading, possible: Sequence[Mistake]) -> list[Correction]:
    """Of each mistake what leaves next to nothing alone, with the fewest changes: no less likely than other bodies."""
    least = THRESHOLD.in_place * min(samples.unexplained(reading), 1.0)
    found: dict[str, Correction] = {}
    for mistake, one in sorted(
        find_promising(samples, reading, possible)[1], key=lambda item: item[1].changes
    ):
        if samples.unexplained(one.reading) < least:
            found.setdefault(mistake.name, one)
    return list(found.values())


def _report_other_model(
    case: Case,
    samples: TorqueSamples,
    reading: Reading,
    other: OtherMachine,
    found: Found = (),
    outside: Flags | None = None,
    alone: Sequence[Correction] = (),
) -> None:
    """A model that is not the robot's, in the place of mistakes that would explain the log as well.

    ``outside``: joints beyond their limits, which no mistake explains, ``(n_joints,)``; ``alone``: of which each one
    would explain it.
    """
    gains, shares, *_ = samples.gains(reading)
    told = np.flatnonzero((shares > THRESHOLD.telling_share) & (gains > 0.0))
    joints = tuple(samples.channels[j] for j in told)
    left = (samples.unexplained(reading), samples.unexplained_beside(reading, other.left))
    model, others = (percent(100.0 * max(1.0 - share, 0.0)) for share in left)
    each = ", ".join(f"{joint} {gains[j]:.2g}" for joint, j in zip(joints, told, strict=True))
    size = "" if other.length == 1.0 else f", about {other.length:.2g} times as long,"
    text = (
        f"the model's bodies explain {model} of the torques' power beside friction and rotors, other bodies on its "
        f"joints{size} {others}: masses, lengths, axes or zeros of positions are not this robot's (torques per "
        f"what the model needs: {each or 'none tells'})"
    )
    if len(told) > 1 and np.ptp(np.log(gains[told])) < THRESHOLD.scale_stands_out * abs(
        np.log(gains[told]).mean()
    ):
        times = float(np.exp(np.log(gains[told]).mean()))
        text += (
            f", or all torques are {times:.2g} times what they should be, in another unit{name_units(times)}"
        )
    load = best_load(samples, reading)
    text += "" if load is None else f", or it carries a load: {load.sentence()}"
    kinds = list_names(list(dict.fromkeys(item.mistake.name.replace("_", " ") for item in found)))
    if outside is not None and outside.any():
        places = list_names(case.joints(outside))
        text += f"; positions of {places} lie outside the model's limits, whatever else is mended"
    elif len(found) > 1:
        text += f"; the only other explanation is {len(found)} mistakes in the log at once ({kinds})"
    elif found:
        text += f"; or {found[0].correction.text.partition(' (')[0]}"
    elif alone:
        text += "; or " + ", or ".join(one.text.partition(" (")[0] for one in alone)
    more = {"severity": "spoils"} if found else {}
    figures = {f"factor.{joint}": float(gains[j]) for joint, j in zip(joints, told, strict=True)}
    figures |= {"left_before": left[0], "left_after": left[1], "length": other.length}
    case.add("other_model", text, figures, joints, **more)


def _doubt(case: Case, found: Found) -> None:
    """What the mistakes that were found leave in doubt."""
    for item in found:
        case.doubts |= set() if item.correction.certain else item.mistake.leaves


def _report_misreading(case: Case, item: Misreading, what: str) -> None:
    one = item.correction
    before, after = (percent(min(100.0, 100.0 * share)) for share in (item.before, item.after))
    right = "" if one.certain else f" as far as the {what} determine it"
    case.add(
        item.mistake.name,
        f"{one.text} (with bodies near the model's {before} of the {what}' power is unexplained, {after} corrected)",
        {**one.figures, "left_before": item.before, "left_after": item.after},
        one.places,
        severity="spoils",
        sure=item.sure,
        repaired=not one.ask,
        remedy=one.ask or one.mends or f"it was corrected{right}; correct the log as well",
    )
