"""The dashboard for Grafana shows every metric that a server has, and no other."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
DASHBOARD, DOCUMENT = ROOT / "deploy/grafana/humanplay.json", ROOT / "docs/deploy.md"


def test_each_metric_of_the_dashboard_exists_and_each_metric_is_on_it(server):
    panels = json.loads(DASHBOARD.read_text())["panels"]
    asked = " ".join(target["expr"] for panel in panels for target in panel["targets"])
    shown = set(re.findall(r"\b(?:humanplay|process)_\w+", asked))
    families = list(server.services.store.metrics.registry.collect())
    suffixes = ("", "_total", "_bucket", "_count")
    assert shown <= {family.name + suffix for family in families for suffix in suffixes}
    named = {re.sub(r"_(total|bucket)$", "", name) for name in shown}
    assert {family.name for family in families if family.name.startswith("humanplay")} <= named
    places = {(panel["gridPos"]["x"], panel["gridPos"]["y"]) for panel in panels}
    assert len(places) == len(panels), "none covers another"


def test_each_metric_is_in_the_documents_table_and_no_other(server):
    table = DOCUMENT.read_text().partition("|metric|meaning|\n")[2].partition("\n\n")[0]
    names = {row.split("|")[1] for row in table.splitlines()[1:]}
    named = {
        name.removesuffix("_total")
        for cell in names
        for name in re.findall(r"`(?:humanplay)?(_\w+)(?:\{\w+\})?`", cell)
    }
    families = {
        family.name
        for family in server.services.store.metrics.registry.collect()
        if family.name.startswith("humanplay")
    }
    assert {
        name for name in named if not any(family.endswith(name) for family in families)
    } == set()
    assert {family for family in families if not family.endswith(tuple(named))} == set()
