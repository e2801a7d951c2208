"""The report: one HTML file that needs no network."""

from __future__ import annotations

from html import escape
from pathlib import Path

from excite.atomic import write_text
from excite.report.folder import Findings, read_folder
from excite.report.html import paragraph
from excite.report.sections.registry import SECTIONS
from excite.report.theme import css_variables

_STYLE = """
:root { color-scheme: light dark; LIGHT --page: #f4f6f8; --good: #00704f; --bad: #b33a00; }
@media (prefers-color-scheme: dark) { :root { DARK --page: #12161a; --good: #3fc89f; --bad: #f39149; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
header, main, footer { max-width: 1080px; margin: 0 auto; padding: 0 16px; }
header { padding-top: 36px; }
header p { margin: 0; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0; letter-spacing: -.01em; }
h2 { font-size: 1.25rem; margin: 0 0 .3em; }
h3 { font-size: 1rem; margin: 1.4em 0 .4em; }
p { margin: .3em 0 .8em; max-width: 75ch; }
p.lead, header p, footer { color: var(--muted); }
p.note { border-left: 3px solid var(--bad); padding-left: 10px; }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; margin: 14px 0 20px; font-size: .93rem; }
a { color: var(--identified); }
section { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px;
  padding: 22px 24px; margin: 0 0 18px; }
.tiles { display: grid; gap: 12px; margin: 0 0 18px;
  grid-template-columns: repeat(auto-fit, minmax(225px, 1fr)); }
.tile { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px; padding: 14px 16px; }
.tile b { display: block; font-size: 1.4rem; line-height: 1.25; }
.tile span { color: var(--muted); font-size: .88rem; line-height: 1.4; display: block; }
.tile b span { display: inline; }
.tile b span { font-size: 1.2rem; }
.good { color: var(--good); } .tile b .good { color: var(--good); }
.bad { color: var(--bad); } .tile b .bad { color: var(--bad); }
.wide { overflow-x: auto; margin: 12px 0; }
figure { margin: 0; min-width: 660px; }
figure svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; min-width: 50%; }
th { text-align: left; font-weight: 600; color: var(--muted); vertical-align: bottom; }
th, td { padding: 4px 16px 4px 0; border-bottom: 1px solid var(--grid); }
.number { text-align: right; } td.number { white-space: nowrap; }
th:last-child, td:last-child { padding-right: 0; }
td.map { text-align: center; padding: 4px 10px; }
#effects td:not(:last-child) { white-space: nowrap; }
p.verdict { font-size: 1.15rem; color: var(--ink); }
.stack { display: flex; height: 18px; border-radius: 4px; overflow: hidden; background: var(--ground);
  max-width: 720px; margin: 6px 0 10px; }
.stack span { display: block; height: 100%; border-right: 1px solid var(--paper); }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: .88rem; color: var(--muted); max-width: none; }
.legend i { display: inline-block; width: 12px; height: 12px; border-radius: 3px; margin-right: 6px; }
details { margin: 10px 0; }
summary { cursor: pointer; color: var(--identified); }
footer { padding-bottom: 48px; font-size: .88rem; }
@media (max-width: 560px) { section { padding: 16px 14px; } header p { margin: 0; }
h1 { font-size: 1.5rem; } }
@media print { body { background: none; } section, .tile { break-inside: avoid; border: 0; }
  nav { display: none; } }
""".replace("LIGHT", css_variables(dark=False)).replace("DARK", css_variables(dark=True))


def report(folder: Path, out: Path | None = None) -> Path:
    """Write ``report.html`` from what a results folder holds; what it lacks is left out and said.

    Args:
        folder: the ``--out`` folder of another command.
        out: folder to write to; ``folder`` itself where left out.

    Returns:
        The path written.

    Raises:
        InputError: no such folder, nothing in it to report on, or a file in it that is malformed.
    """
    return write_text(Path(out or folder) / "report.html", render(read_folder(folder)))


def render(findings: Findings) -> str:
    """The page as text, the same bytes for the same findings."""
    built = [(part, part.build(findings)) for part in SECTIONS]
    shown = [(part, html) for part, html in built if html]
    links = "".join(
        f'<a href="#{part.identifier}">{escape(part.title)}</a>' for part, _ in shown if part.title
    )
    robot = robot_title(findings)
    what = "Diagnosis of the gap" if findings.of_diagnosis else "Excitation and identification"
    title = f"{robot}: {what[0].lower()}{what[1:]}"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<header><p>{what}</p><h1>{escape(robot)}</h1><nav>{links}</nav></header>\n"
        f"<main>{''.join(html for _, html in shown)}</main>\n{_footer(findings)}\n</body>\n</html>\n"
    )


def robot_title(findings: Findings) -> str:
    """The robot's full title, or the name that the files give it."""
    if findings.robot is not None:
        return findings.robot.description.title
    documents = (
        findings.plan,
        findings.refusals,
        findings.identification,
        findings.check,
        findings.diagnosis,
    )
    return next(
        (document["robot"] for document in documents if document and document.get("robot")), "a robot"
    )


def _footer(findings: Findings) -> str:
    missing = "".join(f"<li>{escape(item)}</li>" for item in findings.left_out)
    said = f"<p>Left out, because this folder does not hold it:</p><ul>{missing}</ul>" if missing else ""
    read = paragraph(f"Made by excite from {', '.join(findings.files)}. Units are SI; angles are radians.")
    return f"<footer>{said}{read}</footer>"
