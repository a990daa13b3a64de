"""The proof as one HTML file that needs nothing else: what was missed first, then part by part. It prints.

Knows nothing of how anything was shown.
"""

import json
from collections.abc import Iterator, Sequence
from html import escape
from importlib import resources
from typing import Any, Final

from tests.proof.outcome import Outcome, missed, word
from tests.proof.proof import Bar, Proof, Table

_WIDTH: Final = 920  # px
_STYLE: Final = f"""
@page {{ size: A4; margin: 12mm; }}
* {{ box-sizing: border-box; }}
html {{ background: #fff; -webkit-print-color-adjust: exact; print-color-adjust: exact; }}
body {{ width: {_WIDTH}px; max-width: 100%; margin: 28px auto 60px; padding: 0 8px; color: #22262e;
  font: 14px/1.45 Helvetica, Arial, sans-serif; overflow-wrap: break-word; }}
h1 {{ font-size: 21px; margin: 0 0 2px; }}
h2 {{ font-size: 17px; margin: 38px 0 6px; border-bottom: 1px solid #d5d8de; padding-bottom: 3px; break-after: avoid; }}
h3 {{ font-size: 14px; margin: 20px 0 2px; break-after: avoid; }}
p {{ margin: 6px 0; }}
.muted {{ color: #636a75; font-size: 12.5px; }}
.scroll {{ overflow-x: auto; }}
table {{ border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; margin: 6px 0; }}
th {{ text-align: left; font-weight: 600; color: #636a75; font-size: 12.5px; }}
th, td {{ padding: 3px 14px 3px 0; border-bottom: 1px solid #e4e6ea; vertical-align: top; }}
td.n {{ white-space: nowrap; }}
td.of {{ padding-left: 18px; }}
tr, figure {{ break-inside: avoid; }}
figure {{ margin: 10px 0 0; }}
.held, .missed, .failed {{ font-weight: 700; white-space: nowrap; }}
.held {{ color: #14708c; }}
.missed, .failed {{ color: #b3411a; }}
nav a {{ margin-right: 14px; color: #14708c; }}
@media print {{ body {{ margin: 0; width: auto; }} nav {{ display: none; }} .scroll {{ overflow: visible; }} }}
"""
_LAYOUT: Final[dict[str, Any]] = {
    "width": _WIDTH, "paper_bgcolor": "#fff", "plot_bgcolor": "#fff",
    "font": {"family": "Helvetica, Arial, sans-serif", "size": 12, "color": "#22262e"},
}
_AXIS: Final = {"gridcolor": "#e4e6ea", "linecolor": "#b9bec6", "zerolinecolor": "#b9bec6", "showline": True}
_DRAW: Final = """
for (const [id, figure] of Object.entries(JSON.parse(document.getElementById("figures").textContent)))
  Plotly.newPlot(id, figure.data, figure.layout, {displayModeBar: false});
"""


def page(outcomes: Sequence[Outcome], about: str) -> str:
    """The page. `about`: what was run, in a sentence."""
    pictures: dict[str, Any] = {}
    body = "".join(_sections(outcomes, pictures))
    plotly = (resources.files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
    drawn = json.dumps(pictures, separators=(",", ":")).replace("<", "\\u003c")
    links = "".join(f'<a href="#{each.name}">{escape(_title(each))}</a>' for each in outcomes)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>The proof</title><style>{_STYLE}</style></head>\n<body><header><h1>The proof</h1>"
        f'<p class="muted">{escape(about)}</p><nav>{links}</nav></header>\n{body}\n<script>{plotly}</script>\n'
        f'<script type="application/json" id="figures">{drawn}</script>\n<script>{_DRAW}</script></body></html>\n'
    )


def _sections(outcomes: Sequence[Outcome], pictures: dict[str, Any]) -> Iterator[str]:
    yield _summary(outcomes)
    for outcome in outcomes:
        yield f'<section id="{outcome.name}"><h2>{escape(_title(outcome))}</h2>'
        if outcome.proof is None:
            yield f'<p class="failed">{escape(outcome.failed)}</p>'
        else:
            yield from _proof(outcome.proof, pictures)
        yield "</section>\n"


def _title(outcome: Outcome) -> str:
    return outcome.proof.title if outcome.proof else outcome.name


def _summary(outcomes: Sequence[Outcome]) -> str:
    asked = [bar for each in outcomes if each.proof for bar in each.proof.bars if bar.held is not None]
    held = sum(bool(bar.held) for bar in asked)
    rows = "".join(
        f'<tr><td class="missed">MISSED</td><td>{escape(proof.title)}</td><td>{escape(bar.what.strip())}</td>'
        f'<td class="n">{escape(bar.asked)}</td><td class="n">{escape(bar.figure)}</td></tr>'
        for proof, bar in missed(outcomes)
    )
    failed = "".join(f'<p class="failed">{escape(each.failed)}</p>' for each in outcomes if each.proof is None)
    missing = "".join(
        f"<p><strong>{escape(each.proof.title)}:</strong> {escape(each.proof.missing)}</p>"
        for each in outcomes if each.proof and each.proof.missing
    )
    table = f'<div class="scroll"><table>{rows}</table></div>' if rows else ""
    return (
        f"<section><h2>Held and missed</h2><p>{held} of {len(asked)} bars are held.</p>{failed}{table}"
        f"{missing}</section>\n"
    )


def _proof(proof: Proof, pictures: dict[str, Any]) -> Iterator[str]:
    yield f"<p>{escape(proof.said)}</p>"
    if proof.missing:
        yield f'<p class="failed">Missing: {escape(proof.missing)}</p>'
    if proof.bars:
        yield '<div class="scroll"><table><tr><th></th><th>Measure</th><th>Asked</th><th>Is</th></tr>'
        yield from map(_bar, proof.bars)
        yield "</table></div>"
    for k, figure in enumerate(proof.pictures):
        name = f"{proof.name}-{k}"
        pictures[name] = shown = _drawn(figure)
        height = shown["layout"]["height"]
        yield f'<figure><div id="{name}" style="width:{_WIDTH}px;height:{height}px"></div></figure>'
    for table in proof.tables:
        yield _table(table)


def _bar(bar: Bar) -> str:
    sort = {True: "held", False: "missed", None: "muted"}[bar.held]
    indented = ' class="of"' if bar.what.startswith(" ") else ""
    return (
        f'<tr><td class="{sort}">{word(bar)}</td><td{indented}>{escape(bar.what.strip())}</td>'
        f'<td class="n">{escape(bar.asked)}</td><td>{escape(bar.figure)}</td></tr>'
    )


def _table(table: Table) -> str:
    heads = "".join(f"<th>{escape(head)}</th>" for head in table.heads)
    rows = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in table.rows)
    return f'<h3>{escape(table.title)}</h3><div class="scroll"><table><tr>{heads}</tr>{rows}</table></div>'


def _cell(text: str) -> str:
    return f'<td{" class=" + chr(34) + "n" + chr(34) if len(text) <= 24 else ""}>{escape(text)}</td>'


def _drawn(figure: Any) -> dict[str, Any]:
    """A plotly figure in the page's look, as plain values."""
    plain: dict[str, Any] = json.loads(figure.to_json())
    layout: dict[str, Any] = plain["layout"]
    layout.pop("template", None)
    for name in [name for name in layout if name.startswith(("xaxis", "yaxis"))]:
        layout[name] = _AXIS | layout[name]
    for name in ("xaxis", "yaxis"):
        layout.setdefault(name, dict(_AXIS))
    return {"data": plain["data"], "layout": _LAYOUT | {"height": 360} | layout | {"width": _WIDTH}}
