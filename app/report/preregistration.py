"""A study's preregistration as Markdown, from its protocol: what is fixed before anybody plays, and what is not.

The sections are those of OSF's template for a preregistration (Bowman et al. 2016, OSF Prereg).
"""

from __future__ import annotations

import time
from importlib.metadata import version
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from app.report.build import ESTIMAND
from app.statistics.exclusion_sets import rule_in_words
from app.statistics.formatting import level
from app.statistics.headline import RULES
from app.statistics.planning import plan_study
from app.statistics.sequential import Boundary, boundaries
from app.study.folder import Study
from app.study.plausibility import LABELS
from app.study.protocol import Protocol

RECRUITMENT = {
    "open": "Anybody who has the link may take part.",
    "invitation": "By single-use invitations: a link is used up when somebody agrees to the consent text.",
    "panel": "Through a recruiting panel: its link names each participant, and each may take part once.",
}
ATTESTATION = {
    "unattested": "no attestation is asked for",
    "declared": "the page called every move a key or a touch",
    "attested": "the server found an input event of its own for every move",
    "supervised": "the server found an input event of its own for every move, and the operator was present",
}
ORDERS = {
    "drawn": "Each participant meets them in an order drawn for them from the study's secret.",
    "latin-square": "Orders are rows of a Latin square, permuted in rows and labels by the study's secret and taken in turn.",
}
SECOND_ANALYSIS = {
    "none": "",
    "mixed-model": "A linear mixed model of each metric, players and terrains crossed as random effects and the trial as a "
    "covariate, fitted by REML; reported beside the primary analysis, which it does not replace.",
}


def preregistration(protocol: Protocol, study: Study | None) -> str:
    """Return the document.

    protocol  with its texts filled in
    study     the frozen study; None for a draft, of which a preview is made
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=False,  # Markdown, not HTML
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["level"] = level
    environment.filters["utc"] = lambda seconds: time.strftime(
        "%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds)
    )
    return environment.get_template("preregistration.md.j2").render(
        protocol=protocol,
        config=protocol.env_config,
        study=study,
        estimand=ESTIMAND,
        recruitment=RECRUITMENT[protocol.recruitment],
        attestation=ATTESTATION[protocol.required_attestation],
        orders=ORDERS[protocol.orders],
        sets={name: rule_in_words(rules) for name, rules in protocol.exclusion.items()},
        labels={
            name: text
            for name, text in LABELS.items()
            if protocol.labels_version != "1" or name != "no effort"
        },
        rule=RULES[protocol.interval_rule],
        second_analysis=SECOND_ANALYSIS[protocol.second_analysis],
        policies=list(dict.fromkeys((*protocol.policies, "random"))),
        plan=plan_study(protocol),
        looks=list(zip(protocol.looks, _boundaries(protocol), strict=True)),
        software=version("marsexplorer-playground"),
    )


def _boundaries(protocol: Protocol) -> tuple[Boundary, ...]:
    """Return the boundary of each planned look."""
    if protocol.spending == "none":
        return ()
    return boundaries(protocol.spending, [look / protocol.players for look in protocol.looks])
