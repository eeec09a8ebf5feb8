"""The report as one self-contained HTML page: styles and pictures inside, nothing from a network, no script."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path

from app.report.checklist import CITATION
from app.report.markup import paragraph, table
from app.report.model import SYNTHETIC, Report
from app.report.sections import sections
from app.statistics.coverage_table import POPULATIONS, Cell, nearest
from app.statistics.formatting import number

STYLE = Path(__file__).with_name("report.css")

REFERENCES = (
    "Koutras et al. 2021: MarsExplorer. arXiv 2107.09996 (the task, the score, the protocol of section 3.2)",
    "Hall 1992: On the removal of skewness by transformation. J. R. Statist. Soc. B 54(1)",
    "Waudby-Smith and Ramdas 2024: Estimating means of bounded random variables by betting. J. R. Statist. Soc. B 86(1)",
    "Owen 2007: The pigeonhole bootstrap. Ann. Appl. Statist. 1(2)",
    "Agarwal et al. 2021: Deep reinforcement learning at the edge of the statistical precipice. NeurIPS 34",
    "Schuirmann 1987: A comparison of the two one-sided tests procedure. J. Pharmacokinet. Biopharm. 15(6)",
    "Wei et al. 2025: Recommendations and reporting checklist for human baselines. arXiv 2506.13776",
)


def render(report: Report) -> str:
    """Return the page."""
    mark = f'<aside class="synthetic-bar" aria-label="Warning">{escape(SYNTHETIC)}</aside>' if report.synthetic else ""
    body = [_header(report), *_groups(report), _checklist(report), _methods(report), _protocol(report)]
    title = ("SYNTHETIC — " if report.synthetic else "") + report.title
    style, kind = STYLE.read_text(encoding="utf-8"), "synthetic" if report.synthetic else "human"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><link rel="icon" href="data:,"><style>{style}</style></head>'
        f'<body class="{kind}">{mark}<main>{"".join(body)}{_footer(report)}</main></body></html>\n'
    )


def _header(report: Report) -> str:
    closed = f"closed {report.closed_at}" if report.closed_at else "still open: preliminary"
    return (
        f'<header><p class="kicker">{"Synthetic report" if report.synthetic else "Human-baseline report"}</p>'
        f"<h1>{escape(report.title)}</h1>"
        f'<p class="meta">Study <code>{escape(report.study)}</code> · protocol frozen {escape(report.frozen_at)} · '
        f'<span class="status">{escape(closed)}</span> · made {escape(report.made_at)}</p></header>'
        f'<p class="headline">{escape(report.sentence)}</p>'
    )


def _groups(report: Report) -> list[str]:
    if report.synthetic:
        return [f"<h1>Script: {escape(group.name)}</h1>{sections(report, group)}" for group in report.groups]
    left_out = sum(report.scripts.values())
    note = (
        f"{left_out} scripted participants took part ({', '.join(report.scripts)}); they enter nothing on this page."
        if left_out
        else ""
    )
    people = report.groups[0]
    if not people.figures[0].players:
        return [paragraph(note) if note else ""]
    return [paragraph(note, "note") if note else "", sections(report, people)]


def _checklist(report: Report) -> str:
    if not report.checklist:
        return ""
    missing = sum(item.source == "missing" for item in report.checklist)
    rows = [(item.number, item.name, item.answer, item.detail, item.source) for item in report.checklist]
    notes = ["missing" if item.source == "missing" else "" for item in report.checklist]
    told = f"{len(rows) - missing} of {len(rows)} items are answered by the study itself; {missing} only the authors know."
    return (
        "<h2>Reporting checklist</h2>"
        + paragraph(f"Human-baseline reporting checklist ({CITATION}). {told}")
        + table("The checklist's items", ("item", "name", "answer", "details", "from"), rows, words=True, notes=notes)
    )


def _methods(report: Report) -> str:
    players = max((group.figure.players for group in report.groups), default=0)
    cells = nearest(players) if players > 1 else []
    parts = ["<h2>Methods</h2>", paragraph(report.estimand)]
    parts.append(
        paragraph(
            "The unit of analysis is the player: each player's mean over their ranked episodes counts once. An episode "
            "that ends "
            "short of 99 % counts max_steps. The score is (return + r_invalid) / (r_invalid + r_bonus + cells), never clipped."
        )
    )
    parts.append(
        paragraph(
            f"Interval, rule {report.rule_version}: {report.rule}. Studentised bootstrap: whole players are drawn. New "
            f"terrains: the "
            "crossed bootstrap's standard error times t with min(players, terrains) − 1 degrees of freedom, never "
            "nearer than the "
            "printed interval. Guaranteed: betting on means of bounded values, whatever the distribution."
        )
    )
    if cells:
        parts.append(_coverage(cells))
    parts.append("<ul>" + "".join(f"<li>{escape(line)}</li>" for line in REFERENCES) + "</ul>")
    return "".join(parts)


def _coverage(cells: list[Cell]) -> str:
    about = {population.name: population.summary for population in POPULATIONS}
    rows = [
        (
            f"{cell.population}: {about[cell.population]}",
            f"{cell.icc:g}",
            *(
                number(share, 1)
                for share in (cell.printed, cell.t, cell.bootstrap, cell.guaranteed, cell.new_terrains, cell.pooled)
            ),
        )
        for cell in cells
    ]
    heads = ("population", "ICC", "printed", "t", "bootstrap", "guaranteed", "new terrains", "pooled episodes")
    told = (
        f"Coverage (%) of 95 % intervals in {cells[0].studies} simulated studies each, {cells[0].players} players x 30 terrains"
    )
    return table(told, heads, rows)


def _protocol(report: Report) -> str:
    protocol = json.dumps(report.protocol, indent=1, ensure_ascii=False)
    config = report.protocol["config"]
    size = f"{config['rows']} x {config['cols']}"
    return (
        "<h2>Protocol</h2>"
        + paragraph(
            f"Level {config['level']}, {size}; {report.protocol['warm_up']} warm-up and {report.protocol['ranked']} "
            f"ranked episodes; "
            f"{report.protocol['players']} players planned. Consent text version {report.protocol['consent']['version']}."
        )
        + f'<p class="hash">SHA-256 of the protocol: {escape(report.protocol_hash)}<br>commitment to the secret: '
        f"{escape(report.commitment)}</p><details><summary>The protocol in "
        f"full</summary><pre>{escape(protocol)}</pre></details>"
    )


def _footer(report: Report) -> str:
    return (
        f"<footer><p>Made {escape(report.made_at)} by MarsExplorer Playground {escape(report.software_version)}, core version "
        f"{escape(report.core_version)}, label rules {escape(report.labels_version)}.</p></footer>"
    )
