"""Sizes of the accepted effects as a simulator needs them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.attribution.attribution import Attribution, Scored
from excite.diagnosis.effects.context import Context
from excite.diagnosis.effects.form import Form, Told
from excite.diagnosis.simulator.found import Found


def found_effects(attribution: Attribution) -> tuple[Found, ...]:
    """The accepted effects with their sizes as fitted together, beside a channel's gain in units of the true torque."""
    sizes = fitted_sizes(attribution)
    found = [_found(item, beta) for item, beta in zip(attribution.accepted, sizes, strict=True)]
    forms = [item.form((item.location,)) for item in found]
    reads = {item.location: form.reads for item, form in zip(found, forms, strict=True) if form.reads != 1.0}
    return tuple(
        _read_at(item, reads[item.location]) if item.location in reads and _of_the_joint(item, form) else item
        for item, form in zip(found, forms, strict=True)
    )


def _of_the_joint(item: Found, form: Form) -> bool:
    """Whether an effect is a torque of its joint, neither a body nor of the channel that reads it."""
    return item.effect.own_joint and form.reads == 1.0 and form.bias == 0.0


def _read_at(item: Found, factor: float) -> Found:
    """An effect that a channel reads larger by a factor: its torques, and its shares of the load."""
    torques = {p.name for p in item.effect.linear if item.effect.by_load or p.unit != "1"}
    return replace(item, values={n: v / factor if n in torques else v for n, v in item.values.items()})


def fitted_sizes(attribution: Attribution) -> tuple[Array, ...]:
    """Linear parameters of each accepted effect, ``(n_linear,)``, as fitted all together."""
    last, place, made = attribution.final, 0, []
    columns = last.solver.equations.shared
    first = attribution.stages[0].context.baseline.basis.shape[1]
    for item in attribution.accepted:
        extra, direction = item.hypothesis.fitted, item.hypothesis.direction
        count = 0 if extra is None else extra.shape[2]
        here = slice(first + place, first + place + count)
        beta = item.hypothesis.fit.extra
        if extra is not None:
            size = np.linalg.norm(extra, axis=(0, 1))
            scale = np.linalg.norm(columns[:, :, here], axis=(0, 1)) / np.where(size > 0.0, size, 1.0)
            beta = last.fit.shared[here] * scale
            beta = beta if direction is None else beta * direction
        place += count
        made.append(beta)
    return tuple(made)


def _found(item: Scored, beta: Array) -> Found:
    h = item.hypothesis
    values = h.effect.sizes(Context(h.baseline), h.location, h.theta, replace(h.fit, extra=beta))
    return Found(h.effect, item.location, values)


def told_states(attribution: Attribution) -> tuple[tuple[str, Told], ...]:
    """By place, what the record tells of each accepted effect's own state."""
    hypotheses = [item.hypothesis for item in attribution.accepted]
    return tuple((h.location, h.effect.told(h.context, h.location, h.theta)) for h in hypotheses)
