"""Which effects a written simulator ignores: those of which more moves nothing, not those that make it diverge."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from excite.diagnosis.simulator import rollout_compare
from excite.errors import InputError


@pytest.mark.parametrize(("louder", "ignored"), [(1.0, True), (1.1, False), (np.nan, False)])
def test_a_louder_effect_that_diverges_is_heard(
    louder: float, ignored: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    piece = SimpleNamespace(window=None, drive=None, keep=None)

    class Simulator:
        def __init__(self, xml: str, joints: object) -> None:
            self.position = louder if xml == "louder" else 1.0

        def run_all(self, *_: object) -> np.ndarray:
            return np.array([[[1.0, self.position]]])

    monkeypatch.setattr(rollout_compare, "Simulator", Simulator)
    monkeypatch.setattr(rollout_compare, "pieces", lambda *_: [piece])
    monkeypatch.setattr(rollout_compare, "replace", lambda item, **_: item)
    monkeypatch.setattr(rollout_compare, "augmented_model", lambda *_: SimpleNamespace(xml="louder"))
    effect = SimpleNamespace(name="load_dependent_friction")
    found = SimpleNamespace(effect=effect, location="elbow", values={"coefficient": 0.1}, formless=None)
    baseline = SimpleNamespace(samples=SimpleNamespace(joints=("elbow",)), rigid=None)
    said = rollout_compare.unheard(baseline, [found], "as it was", None)  # type: ignore[arg-type, list-item]
    assert bool(said) is ignored


def test_trials_shorter_than_a_roll_out_give_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rollout_compare, "pieces", lambda *_: [])
    samples = SimpleNamespace(joints=("elbow",))
    with pytest.raises(InputError, match="no trial is as long as a roll-out"):
        rollout_compare.errors("", samples, None, None)  # type: ignore[arg-type]
