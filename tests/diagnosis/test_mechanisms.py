"""Motors that turn several joints and joints that follow through loops: what each lacks is named where it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from excite.diagnosis.diagnose import diagnose
from excite.errors import InputError
from tests.benchmarks.mechanism_cases import Case, drawn, four_bar, wrist
from tests.diagnosis.few_trials import few_trials


@pytest.mark.parametrize(
    ("make", "word", "parameter"),
    [
        (wrist, "none", None),
        (wrist, "torque_gain", "gain_error"),
        (wrist, "coulomb_friction behind", "level"),
        (four_bar, "joint_spring behind", "stiffness"),
    ],
)
def test_what_a_mechanism_lacks_has_its_name_place_and_size(
    make, word: str, parameter: str | None, tmp_path: Path
) -> None:
    case = drawn(make(tmp_path), word, np.random.default_rng(41))
    found = diagnose(few_trials(case.log, 1), case.robot)
    assert (found.verdict == "none") is (parameter is None)
    assert [(item.effect, item.location) for item in found.effects] == expected(case)
    assert found.gap.after < 1.3 * found.gap.noise_floor
    if parameter is not None:
        assert found.effects[0].parameters[parameter].value == pytest.approx(case.size, rel=0.03)


def expected(case: Case) -> list[tuple[str, str]]:
    return [] if case.effect == "none" else [(case.effect, case.place)]


def test_a_mechanism_without_torques_is_refused_with_what_would_tell(tmp_path: Path) -> None:
    case = drawn(four_bar(tmp_path), "none", np.random.default_rng(1))
    header = case.log.header.model_copy(update={"torque": "none"})
    with pytest.raises(InputError, match=r"loops.*record its torques"):
        diagnose(type(case.log)(header, case.log.trials, robot_text=case.log.robot_text), case.robot)
