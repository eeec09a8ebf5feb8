"""The dashboard for Grafana shows metrics that a server has, and every one that it has."""

import json
import re
from pathlib import Path

DASHBOARD = Path(__file__).parents[3] / "deploy" / "grafana" / "marsexplorer.json"


def test_each_metric_of_the_dashboard_exists_and_each_metric_is_on_it(server):
    panels = json.loads(DASHBOARD.read_text())["panels"]
    shown = {
        name
        for panel in panels
        for target in panel["targets"]
        for name in re.findall(r"\b(?:marsexplorer|process)_\w+", target["expr"])
    }
    families = list(server.services.store.metrics.registry.collect())
    made = {
        family.name + suffix
        for family in families
        for suffix in ("", "_total", "_bucket", "_count")
    }
    assert shown - made == set()
    assert {family.name for family in families if family.name.startswith("marsexplorer")} == {
        re.sub(r"_(total|bucket)$", "", name) for name in shown if name.startswith("marsexplorer")
    }
    assert len({(panel["gridPos"]["x"], panel["gridPos"]["y"]) for panel in panels}) == len(
        panels
    ), "none covers another"
