"""The look of a report: quiet type, tables that align, pages that print."""

STYLE = """
:root { --ink: #1b1f24; --quiet: #57606a; --line: #d0d7de; --shade: #f6f8fa; --accent: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; color: var(--ink); background: #fff;
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
main { max-width: 66rem; margin: 0 auto; padding: 2.5rem 1.5rem; }
header { border-bottom: 2px solid var(--ink); margin-bottom: 1.5rem; }
header p { color: var(--quiet); margin: 0 0 .8rem; overflow-wrap: anywhere; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0 0 .4rem; letter-spacing: -.01em; }
h2 { font-size: 1.3rem; margin: 2.4rem 0 .6rem; }
h3 { font-size: 1.05rem; margin: 1.6rem 0 .4rem; }
h3 code { font: 400 .85em ui-monospace, "DejaVu Sans Mono", monospace; color: var(--quiet);
  margin-left: .5em; overflow-wrap: anywhere; }
p { max-width: 44rem; margin: .5rem 0; }
dl.facts { display: grid; grid-template-columns: repeat(auto-fill, minmax(9.5rem, 1fr));
  gap: .5rem 1.4rem; margin: 0 0 .8rem; font-size: .9rem; }
dl.facts dt { color: var(--quiet); font-size: .78rem; }
dl.facts dd { margin: 0; overflow-wrap: break-word; }
dl.facts dd.unstated { color: #57606a; font-style: italic; }
table.files { font-size: .82rem; margin-bottom: 1.6rem; max-width: 100%; }
table.files th { border-bottom-color: var(--line); font-weight: 400; color: var(--quiet); }
table.files td { overflow-wrap: anywhere; }
code.sha { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: .95em; }
code.sha span { display: none; }
code.sha:hover span { display: inline; }
.wide { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
caption { text-align: left; color: var(--quiet); padding-bottom: .3rem; }
th, td { padding: .28rem .8rem .28rem 0; text-align: left; vertical-align: baseline; }
th, thead td { font-weight: 600; border-bottom: 1px solid var(--ink); white-space: nowrap; }
td { border-bottom: 1px solid var(--line); }
td.long { overflow-wrap: anywhere; min-width: 6rem; }
td.number, th.number { text-align: right; padding-left: .8rem; white-space: nowrap; }
dl.key { display: flex; flex-wrap: wrap; gap: .8rem 2.2rem; margin: 1rem 0; }
dl.key div { min-width: 6rem; }
dl.key dt { color: var(--quiet); font-size: .85rem; }
dl.key dd { margin: 0; font-size: 1.5rem; font-variant-numeric: tabular-nums; }
dl.key small { font-size: .9rem; color: var(--quiet); }
ul.notes { list-style: none; margin: .8rem 0; padding: .5rem .9rem; background: var(--shade);
  border-left: 3px solid var(--accent); max-width: 44rem; }
ul.warning { border-color: #d55e00; }
figure { margin: 1rem 0; break-inside: avoid; }
svg.still { display: none; width: 100%; max-width: 46rem; height: auto; }
.panels { display: grid; gap: .4rem 1.6rem; grid-template-columns:
  repeat(auto-fit, minmax(min(19rem, 100%), 1fr)); }
.panels figure { min-width: 0; }
figcaption { color: var(--quiet); font-size: .9rem; max-width: 44rem; margin-top: .3rem; }
footer { max-width: 66rem; margin: 0 auto; padding: 0 1.5rem 2rem; color: var(--quiet);
  font-size: .85rem; }
@page { margin: 15mm; }
@media print {
  body { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  footer { display: none; }
  h2, h3 { break-after: avoid; }
  tr, ul.notes, dl.key { break-inside: avoid; }
  thead { display: table-header-group; }
  svg.still { display: block; max-height: 96mm; width: auto; max-width: 100%; }
  figure[data-space] > div { display: none; }
  .modebar { display: none !important; }
  .wide { overflow: visible; }
  .wide table { font-size: 8pt; }
  th, td, td.number, th.number { padding: .2rem .5rem .2rem 0; white-space: normal; }
  code.sha span { display: inline; }
}
"""
