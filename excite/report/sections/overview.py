"""The figures that say at a glance how it went."""

from __future__ import annotations

from collections.abc import Iterator

from excite.report.folder import Findings
from excite.report.html import condition_value, format_number, key_figure
from excite.report.sections.section import Section
from excite.shown import count

# A segment of whose mass the data tell less is as the nominal model has it.
_TOLD = 0.5


class Overview(Section):
    """A row of key figures, each only where the folder holds it."""

    identifier = "overview"
    title = ""

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        tiles = [*_plan_tiles(findings), *_check_tiles(findings), *_conditioning_tiles(findings)]
        tiles += [*_certainty_tiles(findings), *_fit_tiles(findings), *_mass_tiles(findings)]
        return f'<div class="tiles" id="{self.identifier}">{"".join(tiles)}</div>' if tiles else ""


def _plan_tiles(findings: Findings) -> Iterator[str]:
    if findings.plan is None:
        return
    candidates = findings.plan["candidates"]
    yield key_figure(f"{candidates['accepted']} of {candidates['generated']}", "candidate motions accepted")
    selected = findings.plan["selected"]
    seconds = sum(entry["duration_s"] for entry in selected)
    yield key_figure(count(len(selected), "motion"), f"chosen, {seconds:.0f} s in all")


def _check_tiles(findings: Findings) -> Iterator[str]:
    if findings.check is not None:
        motions = findings.check["motions"]
        n_safe = sum(motion["safe"] for motion in motions)
        yield key_figure(
            f"{n_safe} of {len(motions)}", "motions pass the independent check", good=n_safe == len(motions)
        )


def _conditioning_tiles(findings: Findings) -> Iterator[str]:
    change = findings.data.conditioning
    planned = (findings.plan or {}).get("conditioning")
    if change is not None and change.full_after == change.full_before:
        label = (
            f"condition number of the base columns, of {change.before_label} and {change.after_label} alike"
        )
        yield key_figure(format_number(change.full_after), label)
    elif change is not None:
        label = f"condition number of the base columns: {change.before_label} → {change.after_label}"
        if change.full_after > change.full_before:
            # Motions are chosen for single segments: the whole may come out a little worse.
            better = int((change.after < change.before).sum())
            label += (
                f"; they are chosen by segment, and {better} of {len(change.after)} segments are better so"
            )
        yield key_figure(f"{format_number(change.full_before)} → {format_number(change.full_after)}", label)
    elif planned is not None:
        yield key_figure(
            format_number(condition_value(planned["full"])), "condition number of the base columns"
        )


def _certainty_tiles(findings: Findings) -> Iterator[str]:
    if findings.campaign is not None and findings.campaign["iterations"]:
        last = findings.campaign["iterations"][-1]
        judged = {*last["rsd_percent"], *last["not_met"]}
        n = len(judged)
        label = "parameters meet their certainty target"
        yield key_figure(f"{n - len(last['not_met'])} of {n}", label, good=findings.campaign["targets_met"])


def _fit_tiles(findings: Findings) -> Iterator[str]:
    channels = (findings.identification or {}).get("validation") or {}
    judged = [row for row in channels.values() if None not in (row["reference_rmse"], row["rmse"])]
    if judged:
        better = sum(row["rmse"] < row["reference_rmse"] for row in judged)
        label = "validation channels are predicted better than by the nominal model"
        yield key_figure(f"{better} of {len(judged)}", label, good=better == len(judged))


def _mass_tiles(findings: Findings) -> Iterator[str]:
    masses = findings.data.masses
    if masses is None:
        return
    total = float(masses.identified.sum())
    if masses.true is None or not masses.true.sum():
        label = f"total mass of the identified model; nominal {masses.nominal.sum():.2f} kg"
        if masses.determined is not None and masses.determined.min() < _TOLD:
            label += "; not all of it is told by the data, see Masses"
        yield key_figure(f"{total:.2f} kg", label)
        return
    true = float(masses.true.sum())
    label = f"total mass identified; true {true:.2f} kg, nominal {masses.nominal.sum():.2f} kg"
    off = f"{100.0 * (total - true) / true:+.2f} %".replace("+0.00", "0.00").replace("-0.00", "0.00")
    yield key_figure(f"{total:.2f} kg", f"{label} ({off})".replace("-", "−"))
