"""Weight that a driver takes off torques by its own model before it reports them, as UR's, Kinova's, Doosan's do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from excite.doctor.mistakes.mistake import Correction, Mistake
from excite.doctor.mistakes.model_parts import parts_in
from excite.doctor.reading import Reading
from excite.doctor.torque_samples import TorqueSamples


class Weight(Mistake[TorqueSamples]):
    """Torques hold the bodies' inertial forces, and nothing of their weight but what the driver's model had wrong."""

    name = "compensated"

    def corrections(self, samples: TorqueSamples, reading: Reading) -> Iterable[Correction]:
        if reading.weightless or not reading.gravity.any():
            return
        parts = parts_in(samples, reading)
        weights = parts.weight[np.isfinite(parts.weight)]
        # Every joint that tells is nearer to none of it than to all.
        if not len(weights) or (np.abs(weights) > 0.5).any():
            return
        text = f"a driver has taken the weight off the torques ({parts.said()})"
        yield Correction(
            self.name,
            replace(reading, weightless=True),
            text,
            ("gravity",),
            parts.figures(),
            mends="gravity is taken as [0, 0, 0], and what the rest tells is identified; "
            "`excite doctor LOG --repair DIR` adds the nominal weight instead",
        )
