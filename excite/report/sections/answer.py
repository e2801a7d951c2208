"""What was found, whether it is good enough, and what to do next: the first thing on the page."""

from __future__ import annotations

import shlex
from html import escape

from excite.report.conclusion import Conclusion, conclusion
from excite.report.folder import Findings, Origin
from excite.report.html import paragraph
from excite.report.sections.section import Section


class Answer(Section):
    """One sentence, the next command, and which command made what the page shows."""

    identifier = "answer"
    title = ""

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        answer = conclusion(findings)
        if answer is None:
            return ""
        mark = {True: " yes", False: " no", None: ""}[answer.good]
        said = paragraph(answer.found, "verdict")
        return f'<section id="{self.identifier}" class="answer{mark}">{said}{_next(answer)}{_made(findings)}</section>'


def _next(answer: Conclusion) -> str:
    if not answer.command:
        return f'<p class="next">Next: {escape(answer.purpose)}</p>' if answer.purpose else ""
    line = " ".join(["excite", *(shlex.quote(str(word)) for word in answer.command)])
    return f'<p class="next">Next: <code>{escape(line)}</code> · {escape(answer.purpose)}</p>'


def _made(findings: Findings) -> str:
    return "".join(
        f'<p class="made">{text}</p>'
        for text in dict.fromkeys(_lines(name, made) for name, made in findings.made.items())
    )


def _lines(name: str, made: Origin) -> str:
    by = (
        f"<code>{escape(made.command)}</code>, excite {escape(made.version)}, seed {made.seed}"
        if made.command
        else ""
    )
    return f"{name}.json made by {by}, {made.written}" if by else f"{name}.json written {made.written}"
