"""The report: one HTML file that needs no network, its first sections, and the list of all."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path, PosixPath

from excite.atomic import write_text
from excite.display import count
from excite.report.conclusions import draw_conclusion
from excite.report.folder import Findings, Origin, read_folder
from excite.report.html import (
    Shown,
    body_scripts,
    condition_value,
    content_policy,
    format_number,
    html_paragraph,
    html_section,
    key_figure,
    read_asset,
)
from excite.report.sections import diagnosed, identified, motions
from excite.report.theme import css_variables

# Headings of pages, by the document that a page is about, the last step first.
_TITLES = {
    "diagnosis": "Diagnosis of the gap",
    "campaign": "Campaign: excitation and identification",
    "identification": "Identification",
    "human": "A person's model",
    "plan": "Exciting motions",
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


# What was found, whether it is good enough, and what to do next: the first thing on the page.


def show_answer(findings: Findings) -> Shown:
    """One sentence, the next command, and a line a command with all that it wrote."""
    answer = draw_conclusion(findings)
    if answer is None:
        return ""
    line = " ".join(["excite", *(shlex.quote(str(word)) for word in answer.command)])
    command = f"<code>{escape(line)}</code> · " if answer.command else ""
    following = f'<p class="next">Next: {command}{escape(answer.purpose)}</p>' if answer.purpose else ""
    by: dict[Origin, list[str]] = {}
    for name, made in findings.made.items():
        by.setdefault(made, []).append(f"{name}.json")
    lines = "".join(f'<p class="made">{_command_line(names, made)}</p>' for made, names in by.items())
    mark = {True: " yes", False: " no", None: ""}[answer.good]
    said = html_paragraph(answer.found, "verdict")
    return f'<section id="answer" class="answer{mark}">{said}{following}{lines}</section>'


def _command_line(names: list[str], made: Origin) -> str:
    listed = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    if not made.command:
        return f"{listed} written {made.written}"
    command = f"<code>{escape(made.command)}</code>, excite {escape(made.version)}, seed {made.seed}"
    return f"{listed} made by {command}, {made.written}"


# The figures that say at a glance how it went.

# A segment of whose mass the data tell less is as the nominal model has it.
_TOLD = 0.5


def show_overview(findings: Findings) -> Shown:
    """A row of key figures, each only where the folder holds it."""
    tiles = "".join(_key_figures(findings))
    return f'<div class="tiles" id="overview">{tiles}</div>' if tiles else ""


def _key_figures(findings: Findings) -> Iterator[str]:
    plan, campaign, change = findings.plan or {}, findings.campaign or {}, findings.data.conditioning
    if plan:
        candidates, seconds = plan["candidates"], sum(one["duration_s"] for one in plan["selected"])
        yield key_figure(
            f"{candidates['accepted']} of {candidates['generated']}", "candidate motions accepted"
        )
        yield key_figure(count(len(plan["selected"]), "motion"), f"chosen, {seconds:.0f} s in all")
    what, planned = "condition number of the base columns", plan.get("conditioning")
    if change is not None and change.full_after == change.full_before:
        label = f"{what}, of {change.before_label} and {change.after_label} alike"
        yield key_figure(format_number(change.full_after), label)
    elif change is not None:
        # Motions are chosen for single segments: the whole may come out a little worse.
        values = f"{format_number(change.full_before)} → {format_number(change.full_after)}"
        better = f"{(change.after < change.before).sum()} of {len(change.after)} segments are better so"
        yield key_figure(values, f"{what}: {change.before_label} → {change.after_label}; {better}")
    elif planned is not None:
        yield key_figure(format_number(condition_value(planned["full"])), what)
    last = campaign["iterations"][-1] if campaign.get("iterations") else {"rsd_percent": (), "not_met": ()}
    fits = ((findings.identification or {}).get("validation") or {}).values()
    errors = [(row["rmse"], row["reference_rmse"]) for row in fits]
    for label, passed in {
        "motions pass the independent check": [
            m["safe"] for m in (findings.check or {"motions": ()})["motions"]
        ],
        "parameters meet their certainty target": [
            name not in last["not_met"] for name in {*last["rsd_percent"], *last["not_met"]}
        ],
        "validation channels are predicted better than by the nominal model": [
            after < before for after, before in errors if None not in (after, before)
        ],
    }.items():
        if passed:
            yield key_figure(f"{sum(passed)} of {len(passed)}", label, all(passed))
    masses = findings.data.masses
    if masses is not None:
        total, label = float(masses.identified.sum()), "total mass of the identified model"
        if masses.true is not None and masses.true.sum():
            true = float(masses.true.sum())
            off = f"{100.0 * (total - true) / true:+.2f} %".replace("+0.00", "0.00").replace("-0.00", "0.00")
            label += f"; true {true:.2f} kg ({off})".replace("-", "−")
        elif masses.determined is not None and masses.determined.min() < _TOLD:
            label += "; not all of it is told by the data, see Masses"
        yield key_figure(f"{total:.2f} kg", f"{label}; nominal {masses.nominal.sum():.2f} kg")


# The sections in the order of the page: anchor, heading (the text of its link, too; empty for a part without), content.
# A new one is a function in a file of ``sections`` and a line here.

SECTIONS: tuple[tuple[str, str, Callable[[Findings], Shown]], ...] = (
    ("answer", "", show_answer),
    ("verdict", "", diagnosed.show_verdict),
    ("overview", "", show_overview),
    ("findings", "Findings", diagnosed.show_log_findings),
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
    ("certainty", "Certainty", identified.show_certainty),
    ("forces", "Prediction of forces", identified.show_forces),
    ("masses", "Masses", identified.show_masses),
    ("person", "Person", identified.show_person),
    ("differences", "Differences", identified.show_differences),
    ("parameters", "Parameters", identified.show_parameters),
    ("sessions", "Sessions", identified.show_sessions),
)
