"""Lines of an identification's summary."""

from __future__ import annotations

from excite.identification.judgement.changes import ChangedSegment
from excite.identification.judgement.validation import ChannelFit

# Links are no longer: a centre of mass that is known no better than this is anywhere in one [m].
_WITHIN_M = 1.0


def mass_change(item: ChangedSegment) -> str:
    """The change of mass, or that the rows say nothing of it: an arm's masses show only in combinations."""
    if item.std_kg > max(abs(item.mass_change_kg), 1.0):
        return "first moments or inertia; its mass alone is not determined"
    mass = f"{item.mass_change_kg:+.3f} ± {item.std_kg:.2g} kg"
    if item.centre_m is None or item.centre_std_m is None:
        return mass
    # Along axes that are all parallel nothing is felt of a centre of mass.
    shown = [std < _WITHIN_M for std in item.centre_std_m]
    if not any(shown):
        return f"{mass}; where is not determined"
    centre = ", ".join(f"{x:.3f}" if s else "–" for x, s in zip(item.centre_m, shown, strict=True))
    most = max(std for std, s in zip(item.centre_std_m, shown, strict=True) if s)
    hidden = "" if all(shown) else " (– is not determined)"
    return f"{mass} at ({centre}) ± {most:.2g} m from its joint{hidden}"


def fit_table(title: str, fits: dict[str, ChannelFit]) -> list[str]:
    """Lines with how well each channel is explained, by the identified model and by the nominal one."""
    width = max(len(name) for name in [*fits, "channel"])
    lines = [f"{title}, RMSE (correlation):", f"  {'channel':{width}}  {'identified':>20}  {'nominal':>20}"]
    for name, fit in fits.items():
        identified = f"{fit.rmse:.3f} {fit.unit} ({_format_correlation(fit.cc)})"
        nominal = f"{fit.reference_rmse:.3f} {fit.unit} ({_format_correlation(fit.reference_cc)})"
        lines.append(f"  {name:{width}}  {identified:>20}  {nominal:>20}")
    return lines


def _format_correlation(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
