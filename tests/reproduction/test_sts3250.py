"""Feetech STS3250: load-dependent friction, found of commands and positions alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import excite
from tests.reproduction.sts3250 import FOLDER, JUDGED, published_error, sts3250_log


def test_friction_that_grows_with_the_load_and_an_error_below_the_published_models(
    data_dir: Path, tmp_path: Path
) -> None:
    log = sts3250_log(data_dir, tmp_path)
    assert [trial.name for trial in log.role("validation")] == [JUDGED]
    found = excite.diagnose(log, budget=True)
    best = found.candidates[0]
    assert found.verdict == "effect" and best.effect == "load_dependent_friction"
    size = best.parameters["coefficient"]
    published = json.loads((data_dir / FOLDER / "published_m6.json").read_text())["load_friction_external"]
    assert size.std is not None and abs(size.value - published) < 2.0 * size.std
    (channel,) = found.gap.per_channel.values()
    # Trained on the two other motions; the published model was fitted to all.
    assert channel.after <= published_error(data_dir)
    assert np.isfinite(channel.after)
