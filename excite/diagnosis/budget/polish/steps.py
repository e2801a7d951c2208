"""Gauss and Newton's steps of all non-linear parameters together, what is linear projected out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from excite.arrays import Array
from excite.diagnosis.budget.fit.beside import Beside
from excite.diagnosis.budget.polish.knobs import Knob, Moved, knobs_of
from excite.diagnosis.budget.polish.state import State
from excite.diagnosis.budget.prediction import predicted

# Turns at most, step of the derivatives and longest step, both relative, and tries of a step. A gear that turns gravity
# with it takes eight turns; ripples are the reason for so small a step of the derivatives.
_STEPS, _SMALL, _LONGEST, _TRIES = 10, 1e-3, 0.5, 4
# Steps on the same predictions, and how often new ones may be no better before the search ends: that gear's third turn
# is worse than its second.
_INNER, _PATIENCE = 3, 3
# Nats by which a turn has to be better for another one.
_DONE = 0.3


@dataclass(frozen=True, eq=False)
class Steps:
    """Searches non-linear parameters from where they are.

    Attributes:
        moved: makes columns at other values.
    """

    moved: Moved

    def searched(self, state: State, joint: int | None = None) -> State:
        """Steps and new predictions by turns, until neither gains anything.

        A gear's own torque goes round: what it takes from the bodies behind it changes them, and they its load. The
        turns may swing about where they end, so Anderson's mixing (1965) of the last two bodies is what comes next.

        Args:
            state: where to begin.
            joint: index of the one whose terms' parameters are searched; None for all.
        """
        knobs, n = knobs_of(state, joint), state.rows.shared.shape[2]
        if not knobs:
            return state
        own = [term for term in state.terms if joint is None or term.own == joint]
        gears = any(term.effect.moves for term in own if not term.effect.is_body)
        state = state.remade(state.prediction, joint) if gears else state
        best, worse, x = state, 0, state.model.x[:n]
        last: tuple[Array, Array] | None = None
        for _ in range(_STEPS):
            found = self._stepped(state, knobs)
            there = found.model.x[:n]
            made = found.remade(found.prediction, joint)
            gained = best.loss - made.loss
            worse = 0 if gained > _DONE else worse + (2 if gained > -_DONE else 1)
            best = made if gained > 0.0 else best
            if worse >= (_PATIENCE if gears else 1):
                break
            upcoming = there if last is None else mixed(found.model.normal[:n, :n], there, there - x, *last)
            last, x, state = (there, there - x), upcoming, made
            if upcoming is not there:
                moved = replace(found.model, x=np.concatenate([upcoming, found.model.x[n:]]))
                state = found.remade(predicted(found.full, moved), joint)
        return best

    def _stepped(self, state: State, knobs: Sequence[Knob]) -> State:
        """The best at the predictions as they are."""
        damping = 1e-2
        for _ in range(_INNER):
            found, damping = self._step(state, knobs, damping)
            if found is None:
                break
            gained, state = state.loss - found.loss, found
            if gained < _DONE:
                break
        return state

    def _step(self, state: State, knobs: Sequence[Knob], damping: float) -> tuple[State | None, float]:
        """One step at the predictions as they are, and its damping; None where none is better."""
        information, slope = self._equations(state, knobs)
        here = np.log([knob.value(state) for knob in knobs])
        low, high = (np.log([getattr(knob, side) for knob in knobs]) for side in ("low", "high"))
        for _ in range(_TRIES):
            lifted = information + np.diag(damping * np.diag(information) + 1e-9)
            step = np.clip(np.linalg.solve(lifted, slope), -_LONGEST, _LONGEST)
            found = self._at(state, knobs, np.exp(np.clip(here + step, low, high)))
            if found is not None and found.loss < state.loss:
                return found, max(0.1 * damping, 1e-4)
            damping = max(10.0 * damping, 0.1)
        return None, damping

    def _equations(self, state: State, knobs: Sequence[Knob]) -> tuple[Array, Array]:
        """Information about the knobs' logarithms beside all that is linear, and its right side."""
        model, use = state.model, state.rows.block >= 0
        beside = Beside.of(model)
        moved = [self._change(state, knob) for knob in knobs]
        n = len(knobs)
        cross, inner, slope = np.zeros((model.layout.size, n)), np.zeros((n, n)), np.zeros(n)
        for j in range(state.rows.n_joints):
            d = np.column_stack([change[j] if j in change else np.zeros(int(use.sum())) for change in moved])
            if d.any():
                w = model.weight[j]
                cross[model.layout.numbers[j]] += w * (beside.joint(j).columns @ d)
                inner += w * d.T @ d
                slope += w * (d.T @ model.residual[j][use])
        return inner - cross.T @ (beside.inverse @ cross), slope

    def _change(self, state: State, knob: Knob) -> dict[int, Array]:
        """Change of what is fitted per unit of a knob's logarithm, by joint, at the rows that are fitted."""
        value, use = knob.value(state), state.rows.block >= 0
        way = _SMALL if value * (1.0 + _SMALL) <= knob.high else -_SMALL
        new = self.moved.at(state, [knob], [value * (1.0 + way)])
        change: dict[int, Array] = {}
        if new is None:
            return change
        _, rows, terms = new
        n, x = state.rows.shared.shape[2], state.model.x
        for j, (old, own) in enumerate(zip(state.rows.own, rows.own, strict=True)):
            if own is not old:
                number = state.model.layout.numbers[j][n : n + own.shape[1]]
                change[j] = (own - old) @ x[number]
        for k, (old_term, term) in enumerate(zip(state.terms, terms, strict=True)):
            if term is old_term or term.kept != old_term.kept:
                continue
            before = state.model.parameters(k)
            # The same parameters in the units of the new columns.
            after = before if term.known else before * old_term.scale / term.scale
            for j, block in term.columns.items():
                old_rows = old_term.columns[j] @ before if j in old_term.columns else 0.0
                change[j] = change.get(j, 0.0) + block @ after - old_rows
        return {j: values[use] / np.log1p(way) for j, values in change.items()}

    def _at(self, state: State, knobs: Sequence[Knob], values: Array) -> State | None:
        """Fitted at other values of the knobs; None where they cannot be."""
        new = self.moved.at(state, knobs, values.tolist())
        if new is None:
            return None
        full, rows, terms = new
        found = state.changed(terms, full, rows)
        return found if all(found.can_be(knob.term) for knob in knobs if knob.term >= 0) else None


def mixed(metric: Array, there: Array, change: Array, before: Array, change_before: Array) -> Array:
    """Between ``there`` and ``before``, where the steps that led to them would cancel (Anderson 1965)."""
    turn = change - change_before
    size = float(turn @ metric @ turn)
    share = float(turn @ metric @ change) / size if size > 0.0 else 0.0
    return there - np.clip(share, -1.0, 0.8) * (there - before)
