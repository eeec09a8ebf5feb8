"""The dashboard for Grafana shows every metric that a server has, and no other."""

import json
import re
from pathlib import Path

DASHBOARD = Path(__file__).parents[3] / "deploy" / "grafana" / "humanplay.json"


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
