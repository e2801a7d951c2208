"""The page's style sheet: light and dark, wide and narrow, on paper."""

from __future__ import annotations

from excite.report.live import plot_style
from excite.report.theme import css_variables

_STYLE = """
:root { color-scheme: light dark; LIGHT --page: #f4f6f8; --good: #00704f; --bad: #b33a00; }
@media screen and (prefers-color-scheme: dark) { :root { DARK --page: #12161a; --good: #3fc89f; --bad: #f39149; } }
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
p, li, h1, h2, h3 { overflow-wrap: anywhere; }
p.lead, header p, footer, p.made { color: var(--muted); }
p.note { border-left: 3px solid var(--bad); padding-left: 10px; }
p.made { font-size: .88rem; margin: .5em 0 0; }
nav { display: flex; flex-wrap: wrap; gap: 4px 18px; margin: 14px 0 20px; font-size: .93rem; }
a { color: var(--identified); }
code { font: .92em ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere; }
section { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px;
  padding: 22px 24px; margin: 0 0 18px; }
.answer { border-left: 5px solid var(--muted); }
.answer.yes { border-left-color: var(--good); } .answer.no { border-left-color: var(--bad); }
.answer p { font-size: 1.12rem; max-width: 80ch; margin: 0; }
.answer p.next { font-size: 1rem; margin-top: .5em; } .answer p.made { font-size: .88rem; margin-top: .7em; }
.tiles { display: grid; gap: 12px; margin: 0 0 18px;
  grid-template-columns: repeat(auto-fit, minmax(225px, 1fr)); }
.tile { background: var(--paper); border: 1px solid var(--grid); border-radius: 10px; padding: 14px 16px; }
.tile b { display: block; font-size: 1.4rem; line-height: 1.25; }
.tile span { color: var(--muted); font-size: .88rem; line-height: 1.4; display: block; }
.tile b span { display: inline; }
.tile b span { font-size: 1.2rem; }
.good { color: var(--good); } .tile b .good { color: var(--good); }
.bad { color: var(--bad); } .tile b .bad { color: var(--bad); }
/* A shadow at an edge beyond which more follows: at an end, paper that moves with the content covers it. */
.wide { overflow-x: auto; margin: 12px 0; background:
  linear-gradient(to right, var(--paper) 30%, transparent) left / 36px 100% local no-repeat,
  linear-gradient(to left, var(--paper) 30%, transparent) right / 36px 100% local no-repeat,
  linear-gradient(to right, var(--muted), transparent) left / 6px 100% scroll no-repeat,
  linear-gradient(to left, var(--muted), transparent) right / 6px 100% scroll no-repeat; }
@media (max-width: 600px) { .wide td:nth-child(n+4):last-child:not(.number) { min-width: 13rem; } }
figure { margin: 0; min-width: 660px; }
figure svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; min-width: 50%; }
th { text-align: left; font-weight: 600; color: var(--muted); vertical-align: bottom; }
th, td { padding: 4px 16px 4px 0; border-bottom: 1px solid var(--grid); }
tfoot td { font-weight: 600; border-bottom: 0; }
.number { text-align: right; } td.number { white-space: nowrap; }
th:last-child, td:last-child { padding-right: 0; }
th.sorts { cursor: pointer; } th.sorts:hover, th.sorts:focus-visible { color: var(--identified); }
th[aria-sort=ascending]::after { content: " ↑"; } th[aria-sort=descending]::after { content: " ↓"; }
td.map { text-align: center; padding: 4px 10px; }
td.size { min-width: 22ch; }
p.verdict { font-size: 1.15rem; color: var(--ink); }
.stack { display: flex; height: 18px; border-radius: 4px; overflow: hidden; background: var(--ground);
  max-width: 720px; margin: 6px 0 10px; }
.stack span { display: block; height: 100%; border-right: 1px solid var(--paper); }
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font-size: .88rem; color: var(--muted); max-width: none; }
.legend i { display: inline-block; width: 12px; height: 12px; border-radius: 3px; margin-right: 6px; }
details { margin: 10px 0; }
summary { cursor: pointer; color: var(--identified); }
footer { padding-bottom: 48px; font-size: .88rem; }
.moving { display: none; } .live .moving { display: block; } .live .moving.plots, .live .plots { display: grid; }
.interactive.ready > .still { display: none; }
.plots { gap: 14px 18px; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); margin: 10px 0; }
.plot { min-width: 0; } .plot-title { font-size: .88rem; } .plot-note { font-size: .8rem; color: var(--muted);
  min-height: 1.3em; text-align: center; }
.plot .u-legend { font-size: .8rem; color: var(--muted); text-align: left; min-width: 0; width: 100%; }
.plot .u-legend th, .plot .u-legend td { border: 0; padding: 0 4px 0 0; }
.u-legend .quiet { display: none; }
.replay { margin: 12px 0; }
.replay-bar { display: flex; flex-wrap: wrap; gap: 8px 10px; align-items: center; margin-bottom: 8px; }
.replay-bar > select:first-child { flex: 2 1 360px; min-width: 0; max-width: 100%; }
.replay-bar input { flex: 2 1 140px; min-width: 0; accent-color: var(--identified); }
.replay-time { min-width: 8ch; text-align: right; font-variant-numeric: tabular-nums; font-size: .9rem; }
select, button { font: inherit; font-size: .9rem; color: var(--ink); background: var(--paper);
  border: 1px solid var(--muted); border-radius: 6px; padding: 4px 10px; }
button { min-width: 5.2em; cursor: pointer; background: var(--identified); color: var(--paper);
  border-color: var(--identified); }
.replay-main { display: grid; grid-template-columns: minmax(0, 1fr) 270px; gap: 16px; }
.replay-main:has(> .replay-margins[hidden]) { grid-template-columns: minmax(0, 1fr); }
.replay-stage { height: 440px; background: var(--ground); border-radius: 8px; overflow: hidden; }
.replay-stage[hidden] { display: none; }
.replay-stage canvas { display: block; cursor: grab; }
.replay-margins { font-size: .88rem; } .replay-margins[hidden] { display: none; }
.margin { display: grid; grid-template-columns: 1fr auto; gap: 1px 8px; margin: 7px 0; }
.margin-value { font-variant-numeric: tabular-nums; }
.margin-bar { grid-column: 1 / 3; height: 7px; border-radius: 4px; background: var(--ground); overflow: hidden; }
.margin-bar i { display: block; height: 100%; }
.margin-where { grid-column: 1 / 3; color: var(--muted); font-size: .8rem; min-height: 1.2em;
  white-space: nowrap; overflow: hidden; text-overflow: ellipsis; }
@media (max-width: 800px) { .replay-main { grid-template-columns: minmax(0, 1fr); }
  .replay-stage { height: min(75vw, 440px); } }
@media (max-width: 560px) { section { padding: 16px 14px; } header p { margin: 0; }
  table { font-size: .82rem; } th, td { padding-right: 9px; }
  h1 { font-size: 1.5rem; } .replay-margins { display: grid; gap: 0 14px; grid-template-columns: 1fr 1fr; }
  .replay-margins b { grid-column: 1 / 3; } }
@media print { :root { color-scheme: light; } body { background: none; }
  section, .tile { break-inside: avoid; border: 0; }
  nav, .live .moving, .live .moving.plots { display: none; } .interactive.ready > .still { display: block; }
  .wide { overflow: visible; background: none; } figure { min-width: 0; } details > *:not(summary) { display: block; }
  details::details-content { content-visibility: visible; block-size: auto; } }
""".replace("LIGHT", css_variables(dark=False)).replace("DARK", css_variables(dark=True))


def style_sheet() -> str:
    """The text of the page's ``<style>``."""
    return plot_style() + _STYLE
