"""What was found, whether it is good enough, and what to do next: the first thing on the page."""

from __future__ import annotations

import shlex
from html import escape

from excite.report.conclusions.conclusion import draw_conclusion
from excite.report.conclusions.result import Conclusion
from excite.report.folder import Findings, Origin
from excite.report.html import html_paragraph
from excite.report.sections.section import Section


class Answer(Section):
    """One sentence, the next command, and which command made what the page shows."""

    identifier = "answer"
    title = ""

    def build(self, findings: Findings) -> str:
        """See :class:`Section`."""
        answer = draw_conclusion(findings)
        if answer is None:
            return ""
        mark = {True: " yes", False: " no", None: ""}[answer.good]
        said = html_paragraph(answer.found, "verdict")
        return f'<section id="{self.identifier}" class="answer{mark}">{said}{_next_step(answer)}{_made_files(findings)}</section>'


def _next_step(answer: Conclusion) -> str:
    if not answer.command:
        return f'<p class="next">Next: {escape(answer.purpose)}</p>' if answer.purpose else ""
    line = " ".join(["excite", *(shlex.quote(str(word)) for word in answer.command)])
    return f'<p class="next">Next: <code>{escape(line)}</code> · {escape(answer.purpose)}</p>'


def _made_files(findings: Findings) -> str:
    """A line a command, with all that it wrote."""
    by: dict[Origin, list[str]] = {}
    for name, made in findings.made.items():
        by.setdefault(made, []).append(f"{name}.json")
    return "".join(f'<p class="made">{_command_line(names, made)}</p>' for made, names in by.items())


def _command_line(names: list[str], made: Origin) -> str:
    listed = " and ".join([*([", ".join(names[:-1])] if names[1:] else []), names[-1]])
    if not made.command:
        return f"{listed} written {made.written}"
    command = f"<code>{escape(made.command)}</code>, excite {escape(made.version)}, seed {made.seed}"
    return f"{listed} made by {command}, {made.written}"
