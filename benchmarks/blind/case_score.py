"""One diagnosis compared with what was hidden in its case."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.blind.arm_case import N_TRIALS, N_VALIDATION, PAUSE_S, TRIAL_S
from benchmarks.blind.detectability import DETECTABLE
from benchmarks.blind.documents import Answer, HiddenEffect

_SAME = {"payload": "link_inertia"}
_PAIR = frozenset({"torque_bias", "coulomb_asymmetry"})


@dataclass(frozen=True)
class CaseScore:
    """One case.

    Attributes:
        case: its name.
        kind: single, weak, double, none, unknown or everything.
        truth: hidden effects with places and forms, for people.
        said: what the diagnosis says, for people.
        named: whether a hidden effect's name, or none, or unknown, is what it says; ties that hold it count.
        placed: whether a hidden effect's place is its place or among its tied places.
        firm_wrong: a wrong name without a doubt.
        found: hidden effects that are among its effects.
        hidden: number of hidden effects.
        extras: effects that are not there.
        faults: faults of the record, by kind.
        detectable: whether all that is hidden stands far enough above the noise; where nothing is, True.
        probability: that it states for its first candidate, None where it states none.
        share_closed: of the gap, None where the answer says nothing of it.
        interval: 90 % interval of that, None where it states none.
        parameter_errors: relative error of the main parameter of each hidden effect that is found at its place,
            by its name, where it can be compared.
    """

    case: str
    kind: str
    truth: str
    said: str
    named: bool
    placed: bool
    firm_wrong: bool
    found: int
    hidden: int
    extras: int
    faults: tuple[str, ...]
    detectable: bool
    probability: float | None
    share_closed: float | None
    interval: tuple[float, float] | None
    parameter_errors: tuple[tuple[str, float], ...] = ()


def score_case(case: str, answer: Answer, document: Mapping[str, Any]) -> CaseScore:
    """Compare one diagnosis (``excite.diagnosis/1``) with its answer."""
    verdict, effects = document["verdict"], list(document["effects"])
    if not effects and document["effect"] is not None:
        effects = list(document["candidates"][:1])
    names = [_canonical_name(item.effect) for item in answer.effects]
    said = [_canonical_name(item["effect"]) for item in effects]
    options = set(said[:1])
    if verdict == "ambiguous":
        options |= {_canonical_name(item["effect"]) for item in _tied_candidates(document)}
    kind = answer.kind
    if not names or names == ["unknown"]:
        right = verdict == ("none" if not names else "unknown")
        places = {document["location"], *document["tied_locations"]}
        placed = right and (not names or answer.effects[0].location in places)
        hits, extras, wrong = int(right), len(effects), bool(effects) and verdict != "ambiguous"
    else:
        # What is truly there, in the background, is no mistake, though not what was asked for.
        there = {(_canonical_name(item.effect), item.location) for item in answer.background}
        real = [(_canonical_name(item["effect"]), item["location"]) in there for item in effects]
        hits = sum(any(_is_match(name, other) for other in said) for name in names)
        extras = sum(
            not known and not any(_is_match(name, other) for name in names)
            for other, known in zip(said, real, strict=True)
        )
        # Beside an unknown gap effects stand that are clear at their own places.
        right = bool(effects) and verdict != "none" and any(n in options for n in names)
        places = {p for item in effects for p in (item["location"], *item.get("tied_locations", []))}
        if verdict == "ambiguous":
            tied = _tied_candidates(document)
            places |= {p for item in tied for p in (item["location"], *item.get("tied_locations", []))}
        placed = any(item.location in places for item in answer.effects)
        wrong = (
            bool(effects)
            and verdict in {"effect", "unknown"}
            and not (said and (real[0] or said[0] in names))
        )
    first = document["candidates"][0] if document["candidates"] else {}
    interval = document["gap"].get("share_closed_90")
    text = f"{verdict}: " + ", ".join(f"{item['effect']}@{item['location']}" for item in effects)
    if verdict == "ambiguous":
        text += " among " + "/".join(
            f"{item['effect']}@{item['location']}" for item in _tied_candidates(document)
        )
    if verdict == "unknown":
        text += str(document["location"])
    truth = ", ".join(f"{item.effect}@{item.location} ({item.form})" for item in answer.effects) or "none"
    return CaseScore(
        case,
        kind,
        truth,
        text,
        right,
        placed,
        wrong,
        hits,
        max(len(names), 1),
        extras,
        answer.faults,
        all(item.detectability is None or item.detectability >= DETECTABLE for item in answer.effects),
        first.get("probability"),
        _closed_share(document["gap"]),
        None if interval is None or None in interval else (float(interval[0]), float(interval[1])),
        tuple(_parameter_errors(answer, effects)),
    )


def _closed_share(gap: Mapping[str, Any]) -> float | None:
    """Share closed; of a gap whose size is stated and whose closing is not known, nothing is."""
    closed = gap["share_closed"]
    return float(closed) if closed is not None else 0.0 if "before" in gap else None


def same_effect(hidden: str, said: str) -> bool:
    """Whether two names stand for one effect: bodies' inertia and a body more, a bias and friction's asymmetry."""
    return _is_match(_canonical_name(hidden), _canonical_name(said))


def _parameter_errors(answer: Answer, effects: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, float]]:
    for hidden in answer.effects:
        for item in effects:
            if _is_match(hidden.effect, item["effect"]) and hidden.location == item["location"]:
                error = parameter_error(hidden, item)
                if error is not None:
                    yield hidden.effect, error


def _tied_candidates(document: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Candidates that an ambiguous diagnosis cannot tell apart; a document that does not count them has two."""
    return list(document["candidates"][: int(document.get("n_tied", 2))])


def _canonical_name(name: str | None) -> str:
    return _SAME.get(name or "", name or "")


def _is_match(hidden: str, said: str) -> bool:
    return hidden == said or {hidden, said} <= _PAIR


# How far a stated parameter is from the hidden one, for effects whose size is one number.

_SESSION_S = (N_TRIALS + N_VALIDATION + 1) * (TRIAL_S + PAUSE_S) - PAUSE_S

_ONE_NUMBER = {
    "viscous_friction": "coefficient",
    "coulomb_friction": "level",
    "torque_bias": "bias",
    "coulomb_asymmetry": "bias",
    "stribeck": "excess",
    "load_dependent_friction": "coefficient",
    "armature": "inertia",
    "backlash": "width",
    "joint_elasticity": "stiffness",
    "joint_spring": "stiffness",
    "torque_gain": "gain",
    "encoder_offset": "offset",
    "time_delay": "delay",
    "payload": "mass",
    "base_tilt": "angle",
}


def parameter_error(hidden: HiddenEffect, said: Mapping[str, Any]) -> float | None:
    """Relative error of an effect's main parameter.

    Args:
        hidden: the hidden effect.
        said: an effect of the same name in a diagnosis (``excite.diagnosis/1``).

    Returns:
        The error relative to the hidden value; None where the hidden size is no single number, or the form of the
        effect has parameters that the textbook's has not.
    """
    parameters = said.get("parameters", {}).items()
    values = {name: item["value"] for name, item in parameters if item["value"] is not None}
    compared = _COMPARED.get(hidden.effect)
    pair = None if compared is None else compared(hidden, values)
    if pair is None or pair[1] is None or not pair[0]:
        return None
    return abs(pair[1] - pair[0]) / abs(pair[0])


_Pair = tuple[float, float | None]


def _plain_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    # A spring or a gear that hardens has another stiffness at every stretch.
    if hidden.form in {"hardening", "rubbing"}:
        return None
    return hidden.value, values.get(_ONE_NUMBER[hidden.effect])


def _drift_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    """What has changed at the session's end; heat that the joint makes itself is not known from the answer."""
    if hidden.form != "plain" or not hidden.details.get("time_constant"):
        return None
    grown = -math.expm1(-_SESSION_S / hidden.details["time_constant"])
    return hidden.value * grown, values.get("relative_change")


def _lag_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair:
    """Two equal lags in series have twice the time constant of either."""
    return hidden.value * (2.0 if hidden.form == "second_order" else 1.0), values.get("time_constant")


def _ripple_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    if hidden.form != "plain" or not {"cosine", "sine"} <= set(values):
        return None
    return hidden.value, math.hypot(values["cosine"], values["sine"])


def _length_pair(hidden: HiddenEffect, values: Mapping[str, float]) -> _Pair | None:
    shift = [values[name] for name in ("shift_x", "shift_y", "shift_z") if name in values]
    return (hidden.value, math.hypot(*shift)) if len(shift) == 3 else None


_COMPARED: dict[str, Callable[[HiddenEffect, Mapping[str, float]], _Pair | None]] = {
    **dict.fromkeys(_ONE_NUMBER, _plain_pair),
    "friction_drift": _drift_pair,
    "actuator_lag": _lag_pair,
    "torque_ripple": _ripple_pair,
    "link_length_error": _length_pair,
}
