"""Torque channels that are dead, or in another unit than the others."""

from __future__ import annotations

from excite.doctor.torque_samples import TorqueSamples, modelled_gains, shares_left
from excite.finding import Finding, listed

_WEAK = 0.2


def weak_torques(samples: TorqueSamples, joints: tuple[str, ...]) -> list[Finding]:
    """Joints whose torque is far below what the nominal masses need, while that of most others is not.

    Half the nominal torque, the least that is believed, would then miss the measured one by more than nothing.

    Args:
        samples: samples of a log.
        joints: names of the joints that have a torque, in the samples' order.
    """
    gains, _ = modelled_gains(samples)
    weak = (shares_left(samples) > 1.0) & (gains < _WEAK)
    if not weak.any() or 2 * weak.sum() > len(weak):
        return []
    names = tuple(name for name, flag in zip(joints, weak, strict=True) if flag)
    text = (
        f"torques of {listed(names)} are at most {max(float(gains[weak].max()), 0.0):.2g} times what the nominal "
        "masses need, unlike the others: a dead channel, or another unit; name them under no_torque in log.yaml "
        "if they mean nothing, or they spoil what the other joints say"
    )
    return [Finding("weak_torque", text, {"joints": float(len(names))}, names)]
