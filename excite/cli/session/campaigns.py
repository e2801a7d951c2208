"""Folders of a campaign on a real robot, which waits for recordings: what is made for an iteration belongs into it."""

from __future__ import annotations

from pathlib import Path


def log_folder(plan: Path) -> Path:
    """Where the log of a plan's motions goes: into the campaign's iteration that the plan is of, else anywhere.

    Args:
        plan: folder of the plan.
    """
    return plan / "log" if (plan.parent / "journal.json").is_file() else Path("log")


def campaign_of(log: Path) -> Path | None:
    """The campaign that waits for a log; None where none does.

    Args:
        log: folder of the log.
    """
    campaign = log.parent.parent
    return campaign if log == log_folder(log.parent) and (campaign / "journal.json").is_file() else None
