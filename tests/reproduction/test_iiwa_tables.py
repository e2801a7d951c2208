"""Xu et al., IEEE Access 2020: what of its tables is quick to make; the rest is in ``make reproduce``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.reproduction import __main__ as command
from tests.reproduction.iiwa import grouping, iiwa, published_base, published_parameters, rows
from tests.reproduction.iiwa_excitation import OMEGA, condition, excitation
from tests.reproduction.iiwa_methods import identify
from tests.reproduction.iiwa_twins import simulated_twin
from tests.reproduction.table import Line, Table
from tests.reproduction.tables import xu_iiwa


def test_grouping_predicts_the_same_torques():
    """π_b = G π explains any torque that π does."""
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 20, 7))
    regressor, parameters = rows(q, v, a), rng.normal(size=84)
    columns = [row.column for row in published_base()]
    np.testing.assert_allclose(
        regressor[:, :, columns] @ (grouping() @ parameters), regressor @ parameters, atol=1e-9
    )


def test_first_moments_of_tables_6_and_7_are_those_of_table_4():
    ours = grouping() @ published_parameters("xu2020")
    for row, value in zip(published_base(), ours, strict=True):
        if row.name in ("MY2", "MY4", "MY6"):
            assert value == pytest.approx(row.base, abs=0.011)
    names = [row.name for row in published_base() if row.essential is None]
    assert names == ["XY5", "XY6", "MX6", "FV5"] and len(ours) == 57


def test_excitation_obeys_eq_10():
    curve, limits = excitation(), iiwa().limits
    for order in range(3):
        np.testing.assert_allclose(curve.evaluate(np.zeros(1), order), 0.0, atol=1e-9)
    amplitude, number = np.hypot(curve.a, curve.b), np.arange(1, 6)
    assert ((amplitude / number).sum(axis=1) <= OMEGA * limits.position_upper * (1 + 1e-9)).all()
    assert (amplitude.sum(axis=1) <= limits.velocity * (1 + 1e-9)).all()
    assert condition(curve) < 156.3


def test_tables_that_need_no_data_meet_their_bars():
    assert not xu_iiwa.structure().missed
    table = xu_iiwa.table_4()
    assert len(table.lines) == 57 and all(line.difference is not None for line in table.lines)


@pytest.mark.parametrize(("reason", "code"), [("", 1), ("the file is shorter than the paper's", 0)])
def test_a_missed_bar_fails_the_command_unless_its_reason_is_known(monkeypatch, capsys, reason, code):
    missed = Line("a", 1.0, 3.0, False, "≤ 2", reason)
    table = Table("t", (missed, Line("b", None, "x"), Line("c", 1, 1, True, "= 1", "no longer missed")))
    monkeypatch.setattr(xu_iiwa, "tables", lambda: [table])
    monkeypatch.setattr("sys.argv", ["reproduce", "--only", "xu_iiwa"])
    assert command.main() == code
    said = capsys.readouterr().out
    assert f"| a | 1 | 3 | +2 | ≤ 2 | {f'known: {reason}' if reason else '✗'} |" in said
    assert (
        f"| t | 3 | 1 | {1 - code} | {code} |" in said
        and f"| **together** | 3 | 1 | {1 - code} | {code} |" in said
    )
    assert (f"- known: t: a: {reason}" if reason else "- missed: t: a: 3.0 (≤ 2)") in said


@pytest.mark.slow
def test_what_is_proven_does_not_hang_on_rounding():
    """The certificate of the simulated robot, of rows that differ by rounding as those of two machines do."""
    recorded, rng = simulated_twin(1), np.random.default_rng(0)
    gaps = []
    for size in (0.0, 1e-13, 1e-11):
        scale = 1.0 + size * rng.standard_normal(recorded.tau.shape)
        gaps.append(identify(replace(recorded, tau=recorded.tau * scale)).certificate.gap)
    assert max(gaps) <= 1e-3
    np.testing.assert_allclose(gaps, gaps[0], rtol=1e-3)
