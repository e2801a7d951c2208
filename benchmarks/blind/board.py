"""Entries side by side: one line each, for people and as Markdown."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.blind.score import BlindScore

# Title, figure, and whether it is a share.
_COLUMNS = (
    ("everything: found by share", "everything_share_found", True),
    ("by number", "everything_found", True),
    ("named right", "everything_named_right", True),
    ("large ones right", "everything_large_named_right", True),
    ("error of shares", "everything_share_error_median", False),
    ("shares inside 90 %", "everything_share_inside", True),
    ("one effect: named", "single_named", True),
    ("placed", "single_placed", True),
    ("none kept", "none_kept", True),
    ("firm wrong", "firm_wrong", True),
    ("s a case", "seconds_median", False),
)


def score_board(scores: Mapping[str, BlindScore]) -> str:
    """A Markdown table of entries, a line each in the order given; figures without a case are a dash."""
    lines = [
        "| " + " | ".join(["entry", *(title for title, _, _ in _COLUMNS)]) + " |",
        "| " + " | ".join(["---"] * (len(_COLUMNS) + 1)) + " |",
    ]
    for name, score in scores.items():
        figures = score.figures()
        cells = [_board_cell(figures.get(figure), share) for _, figure, share in _COLUMNS]
        lines.append("| " + " | ".join([name.replace("|", "/"), *cells]) + " |")
    return "\n".join(lines)


def _board_cell(value: float | None, share: bool) -> str:
    if value is None:
        return "–"
    return f"{100.0 * value:.0f} %" if share else f"{value:.2g}"
