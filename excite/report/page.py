"""The report: one HTML file that needs no network."""

from __future__ import annotations

from html import escape
from pathlib import Path, PosixPath

from excite.atomic import write_text
from excite.report.folder import Findings, read_folder
from excite.report.html import body_scripts, content_policy, html_paragraph, read_asset
from excite.report.sections import answers, diagnosed, identified, motions
from excite.report.sections.section import Section
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
    built = [(part, part.build(findings)) for part in SECTIONS]
    shown = [(part, html) for part, html in built if html]
    links = "".join(
        f'<a href="#{part.identifier}">{escape(part.title)}</a>' for part, _ in shown if part.title
    )
    robot = robot_title(findings)
    what = next((title for name, title in _TITLES.items() if getattr(findings, name) is not None), "Results")
    title = f"{robot}: {what[0].lower()}{what[1:]}"
    body = (
        f"<header><p>{what}</p><h1>{escape(robot)}</h1><nav>{links}</nav></header>\n"
        f"<main>{''.join(html for _, html in shown)}</main>\n{_page_footer(findings)}\n"
    )
    return html_page(title, body)


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


# The sections in the order of the page. A new one is one file beside this one and one line here.

SECTIONS: tuple[Section, ...] = (
    answers.show_answer,
    diagnosed.show_verdict,
    answers.show_overview,
    diagnosed.show_log_findings,
    diagnosed.show_torques_beside_model,
    motions.show_moving,
    diagnosed.show_effects,
    diagnosed.show_budget_by_channel,
    diagnosed.show_gap_by_channel,
    diagnosed.show_trivial,
    diagnosed.show_where,
    diagnosed.show_baseline,
    diagnosed.show_curves,
    diagnosed.show_record,
    motions.show_motions,
    motions.show_refused,
    motions.show_safety,
    motions.show_assumed,
    motions.show_excitation,
    answers.show_certainty,
    identified.show_forces,
    identified.show_masses,
    identified.show_person,
    answers.show_differences,
    identified.show_parameters,
    identified.show_sessions,
    identified.show_signals,
    answers.show_stages,
)
