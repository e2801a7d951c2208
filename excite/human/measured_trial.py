"""A recording of a person as a trial: postures, plates, and what stood on them."""

from __future__ import annotations

from typing import Any, NamedTuple

from excite.finding import Finding
from excite.human.body import Body
from excite.human.log_folder import MeasuredTrial
from excite.human.markers.calibration import Calibration
from excite.human.plates.force_plates import plate_readings
from excite.human.plates.support import find_support
from excite.human.posture.joint_angles import joint_angles, near_singular
from excite.human.posture.skeleton import place_segments
from excite.human.posture.trial_poses import trial_poses
from excite.human.recording import Recording


class Measured(NamedTuple):
    """A trial, what is reported of it, and what was found on the way."""

    trial: MeasuredTrial
    report: dict[str, Any]
    findings: tuple[Finding, ...]


def measured_trial(
    body: Body, calibration: Calibration, recording: Recording, cutoff_hz: float | None
) -> Measured:
    """Postures, plates and spans of a recording; ``cutoff_hz`` of the markers' low-pass, None for none [Hz]."""
    poses = trial_poses(calibration, recording, cutoff_hz)
    placement = place_segments(poses.pose, body.offsets)
    readings, odd = plate_readings(recording, placement, body, cutoff_hz)
    held = find_support(body, placement, readings, recording.rate_hz, recording.source)
    name = recording.source.stem
    trial = MeasuredTrial(name, poses, readings, held.frames, recording.rate_hz)
    span = held.frames
    report = {
        "seconds": (span.stop - span.start) / recording.rate_hz,
        "rate_hz": recording.rate_hz,
        "plates_kg": held.mass,
        "marker_rms_m": dict(poses.marker_rms),
        "plates": [
            {"plate": r.name, "foot": r.foot, "pressure_center_distance_m": r.distance} for r in readings
        ],
    }
    singular = near_singular(joint_angles(poses.pose), name)
    return Measured(trial, report, (*poses.findings, *odd, *held.findings, *singular))
