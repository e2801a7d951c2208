"""What a soft or loose gear does to all torques: the link behind it moves otherwise than the motor."""

from __future__ import annotations

from excite.diagnosis.effects.deflection import deflect
from excite.diagnosis.effects.effect import Context
from excite.diagnosis.effects.gear import Behind, Gear
from excite.diagnosis.effects.gear_start import first_states
from excite.robot.robot import Array


def response(context: Context, j: int, gear: Gear) -> dict[int, Array]:
    """Torques in all rows that a deflection of joint j adds, by row, ``(n_samples,)``.

    To first order in the deflection δ: ``∂τ/∂q δ + ∂τ/∂v δ̇ + M δ̈``, with δ from its own equation of
    motion, the other joints moving as logged (Spong 1987, eq. 5, with the motor's side prescribed).
    """
    behind, samples = Behind.joint(context, j), context.baseline.samples
    begin = first_states(context, j, behind, gear)
    x, s, acc = deflect(*behind, samples.starts, begin, 1.0 / samples.rate_hz, *gear)
    by_q, by_v, mass = (context.gradient(j, what) for what in ("q", "v", "a"))
    total = by_q * x[:, None] + by_v * s[:, None] + mass * acc[:, None]
    return {k: total[:, k] for k in range(total.shape[1])}
