"""Small pieces of HTML: escaped text, tables, figures."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from html import escape


def table(
    caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], words: bool = False, notes: Sequence[str] = ()
) -> str:
    """Return a table whose first column names the rows; cells are text and escaped, a line break in one is kept.

    words  left-aligned text instead of numbers; notes: a CSS class for each row, "" for none
    """
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in heads)
    body = []
    for place, row in enumerate(rows):
        first, *rest = (escape(cell).replace("\n", "<br>") for cell in row)
        mark = f' class="{notes[place]}"' if notes and notes[place] else ""
        body.append(f'<tr{mark}><th scope="row">{first}</th>{"".join(f"<td>{cell}</td>" for cell in rest)}</tr>')
    kind = ' class="words"' if words else ""
    label = "t" + hashlib.sha256(f"{caption}{rows}".encode()).hexdigest()[:10]
    return (
        f'<p class="caption" id="{label}">{escape(caption)}</p>'
        f'<div class="wide" role="region" tabindex="0" aria-labelledby="{label}"><table{kind} aria-labelledby="{label}">'
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div>"
    )


def figure(svg: str, caption: str) -> str:
    """Return a figure with its caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph of escaped text."""
    return f"<p{f' class={chr(34)}{kind}{chr(34)}' if kind else ''}>{escape(text)}</p>"


def bullets(lines: Sequence[str]) -> str:
    """Return a list of escaped lines; nothing for none."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>" if lines else ""
