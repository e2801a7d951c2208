"""What keeps an identification from being good enough, however well it predicts."""

from __future__ import annotations

from excite.report.folder import Document
from excite.report.html import format_number

_SPOILS = {"fatal", "spoils"}


def describe_doubt(found: Document, judged: int) -> str:
    """Why it is not good enough though each of so many channels is predicted better; empty where it is."""
    for finding in found["findings"]:
        if finding["severity"] in _SPOILS and not finding["repaired"]:
            return f"{finding['text']}; not to be relied on before that is cleared up"
    gaps = sum(finding["kind"] == "validation_gap" for finding in found["findings"])
    both = found["fit"].keys() & found["validation"].keys()
    fits = [(found["validation"][name]["rmse"], found["fit"][name]["rmse"]) for name in both]
    times = [judging / fitted for judging, fitted in fits if judging is not None and fitted]
    if 2 * gaps < judged or not times:
        return ""
    return (
        f"{gaps} of them leave up to {format_number(max(times))} times what they leave on the trials that were fitted to; not "
        "to be relied on for other motions"
    )
