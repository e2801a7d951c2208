"""The report: one HTML file that needs no network."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path, PosixPath

from excite.atomic import write_text
from excite.report.folder import Findings, read_folder
from excite.report.html import Shown, body_scripts, content_policy, html_paragraph, html_section, read_asset
from excite.report.sections import answers, diagnosed, identified, motions
from excite.report.theme import css_variables

# Headings of pages, by the document that a page is about, the last step first.
_TITLES = {
    "diagnosis": "Diagnosis of the gap",
    "campaign": "Campaign: excitation and identification",
    "identification": "Identification",
    "human": "A person's model",
    "plan": "Exciting motions",
    "refusals": "Exciting motions",
    "check": "Safety of motions",
    "doctor": "What is wrong with a log",
}


class Page(PosixPath):
    """Path of a page that was written; a notebook shows the page itself."""

    def _repr_html_(self) -> str:
        """The page in a frame, as it is on disk."""
        content = escape(self.read_text(encoding="utf-8"), quote=True)
        return f'<iframe srcdoc="{content}" style="width: 100%; height: 80vh; border: 0"></iframe>'


def report(folder: str | Path, out: str | Path | None = None) -> Page:
    """Write ``report.html`` from what a results folder holds; what it lacks is left out and said.

    Args:
        folder: the ``--out`` folder of another command.
        out: folder to write to; ``folder`` itself where left out.

    Returns:
        The path written, which a notebook shows as the page.

    Raises:
        InputError: no such folder, nothing in it to report on, or a file in it that is malformed.
    """
    return Page(write_text(Path(out or folder) / "report.html", render_page(read_folder(Path(folder)))))


def render_page(findings: Findings) -> str:
    """The page as text, the same bytes for the same findings."""
    built = [(name, title, html_section(name, title, show(findings))) for name, title, show in SECTIONS]
    shown = [one for one in built if one[2]]
    links = "".join(f'<a href="#{name}">{escape(title)}</a>' for name, title, _ in shown if title)
    robot = robot_title(findings)
    what = next((title for name, title in _TITLES.items() if getattr(findings, name) is not None), "Results")
    body = (
        f"<header><p>{what}</p><h1>{escape(robot)}</h1><nav>{links}</nav></header>\n"
        f"<main>{''.join(html for *_, html in shown)}</main>\n{_page_footer(findings)}\n"
    )
    return html_page(f"{robot}: {what[0].lower()}{what[1:]}", body)


def html_page(title: str, body: str) -> str:
    """A whole page, which needs no network, around a body with the scripts that it needs."""
    style = read_asset("page.css")
    for word, dark in (("LIGHT", False), ("DARK", True)):
        style = style.replace(word, css_variables(dark=dark))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n{content_policy(body)}\n'
        f"<title>{escape(title)}</title>\n<style>{read_asset('uplot.min.css')}\n{style}\n</style>\n</head>\n<body>\n"
        f"{body}{body_scripts(body)}\n</body>\n</html>\n"
    )


def robot_title(findings: Findings) -> str:
    """The robot's full title, or the name that the files give it."""
    if findings.robot is not None:
        return findings.robot.description.title
    documents = (getattr(findings, name) for name in _TITLES if name not in {"campaign", "human"})
    return next((one["robot"] for one in documents if one and one.get("robot")), "a robot")


def _page_footer(findings: Findings) -> str:
    missing = "".join(f"<li>{escape(item)}</li>" for item in findings.left_out)
    said = f"<p>Left out, because this folder does not hold it:</p><ul>{missing}</ul>" if missing else ""
    read = html_paragraph(
        f"Made by excite from {', '.join(findings.files)}. Units are SI; angles are radians."
    )
    return f"<footer>{said}{read}</footer>"


# The sections in the order of the page: anchor, heading (the text of its link, too; empty for a part without), content.
# A new one is a function in a file of ``sections`` and a line here.

SECTIONS: tuple[tuple[str, str, Callable[[Findings], Shown]], ...] = (
    ("answer", "", answers.show_answer),
    ("verdict", "", diagnosed.show_verdict),
    ("overview", "", answers.show_overview),
    ("findings", "Findings", diagnosed.show_log_findings),
    ("beside-model", "Torques beside the model", diagnosed.show_torques_beside_model),
    ("moving", "The trial in motion", motions.show_moving),
    ("effects", "Effects", diagnosed.show_effects),
    ("budget", "Where the gap goes", diagnosed.show_budget_by_channel),
    ("gap", "Gap by channel", diagnosed.show_gap_by_channel),
    ("trivial", "Beside simple predictors", diagnosed.show_trivial),
    ("where", "Where it lies", diagnosed.show_where),
    ("baseline", "What the baseline was fitted to", diagnosed.show_baseline),
    ("curves", "A trial before and after", diagnosed.show_curves),
    ("record", "What to do, and what to keep in mind", diagnosed.show_record),
    ("motions", "Motions", motions.show_motions),
    ("refused", "What refuses candidates", motions.show_refused),
    ("safety", "Safety", motions.show_safety),
    ("assumed", "Assumed", motions.show_assumed),
    ("excitation", "Excitation", motions.show_excitation),
    ("certainty", "Certainty", answers.show_certainty),
    ("forces", "Prediction of forces", identified.show_forces),
    ("masses", "Masses", identified.show_masses),
    ("person", "Person", identified.show_person),
    ("differences", "Differences", answers.show_differences),
    ("parameters", "Parameters", identified.show_parameters),
    ("sessions", "Sessions", identified.show_sessions),
    ("signals", "Signals", identified.show_signals),
    ("stages", "Time taken", answers.show_stages),
)
