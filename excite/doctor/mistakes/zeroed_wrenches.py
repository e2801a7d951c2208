"""Contact wrenches that were zeroed while the robot stood on the sensors: what they carried then is off them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from excite.doctor.doubt import Doubt
from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.reading import Reading
from excite.doctor.wrench_samples import WrenchSamples


class ZeroedWrenches(Mistake[WrenchSamples]):
    """Constants that bring the nominal weight back; how sensors share it is told as far as their levers change."""

    name = "zeroed_wrenches"
    leaves = frozenset({Doubt.SIZE})

    def corrections(self, samples: WrenchSamples, reading: Reading) -> Iterable[Correction]:
        ratio = samples.weight_ratio(reading)
        # Nearer to no weight than to all of it.
        if reading.wrench_added.any() or abs(ratio) > 0.5:
            return
        added = samples.best_constants(reading)
        weight = float(np.linalg.norm(added[:, :3].sum(axis=0)))
        text = (
            f"wrenches weigh {ratio:.2g} times what the robot does, and its weight with constants of together "
            f"{weight:.0f} N: they were zeroed under load"
        )
        other = replace(reading, wrench_added=reading.wrench_added + added)
        yield Correction(
            self.name,
            other,
            text,
            samples.sensors,
            {"weight_ratio": ratio, "added_n": weight},
            certain=False,
            mends="the nominal weight was added to them; zero sensors that carry nothing",
        )
