"""A study's preregistration as Markdown, from its protocol.

It says what is fixed before anybody plays, and what is not. The sections are those of OSF's
template for a preregistration (Bowman et al. 2016, OSF Prereg).
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from humanplay.report.build import ESTIMAND
from humanplay.report.checklist import time_in_words
from humanplay.report.statistics.exclusion_sets import entry_condition, join_rule_texts
from humanplay.report.statistics.formatting import templates, utc
from humanplay.report.statistics.intervals import INTERVAL_IN_WORDS
from humanplay.report.statistics.planning import assumptions_in_words, power_in_words
from humanplay.report.statistics.study_figures import EVERYBODY_RULE
from humanplay.study.exclusion_rules import PER_PROTOCOL
from humanplay.study.folder import Study
from humanplay.study.places import cap_in_words
from humanplay.study.plausibility import labels_of
from humanplay.study.policy_episodes import tested_policies
from humanplay.study.practice import criterion
from humanplay.study.protocol import Protocol
from humanplay.study.questions import POSITIONS, in_order

RECRUITMENT = {
    "open": "Anybody who has the link may take part.",
    "invitation": "By single-use invitations: a link is used up when somebody agrees to the consent text.",
    "panel": "Through a recruiting panel: its link names each participant, and each may take part once.",
}
ATTESTATION = {
    "unattested": "no attestation is asked for",
    "attested": "the server found an input event of its own for every move",
    "supervised": "the server found an input event of its own for every move, and the operator was present",
}


def preregistration(protocol: Protocol, study: Study | None) -> str:
    """The preregistration as Markdown.

    Args:
        protocol: With its texts filled in.
        study: The frozen study; None for a draft, of which a preview is made.
    """
    words, is_score = protocol.environment.about.words, protocol.primary_metric == "score"
    environment = templates(Path(__file__).parent / "templates", is_html=False)
    environment.filters["utc"] = utc
    return environment.get_template("preregistration.md.j2").render(
        protocol=protocol,
        cap=cap_in_words(protocol),
        blocks=in_order(protocol.blocks),
        positions=POSITIONS,
        declared={name: text or "TO BE STATED" for name, text in protocol.declarations},
        config=protocol.env_config,
        study=study,
        words=words,
        design=protocol.environment.texts(protocol.env_config).design,
        time=time_in_words(protocol.environment),
        estimand=ESTIMAND,
        recruitment=RECRUITMENT[protocol.recruitment],
        attestation=ATTESTATION[protocol.required_attestation],
        per_protocol=entry_condition(protocol.per_protocol),
        everybody=EVERYBODY_RULE,
        sets={
            name: entry_condition(rules)
            for name, rules in protocol.exclusion.items()
            if name != PER_PROTOCOL
        },
        practice=f' Participants are told: "{text}"' if (text := criterion(protocol)) else "",
        flags=join_rule_texts(protocol.flags),
        labels={**labels_of(protocol), **protocol.environment.about.labels},
        rule=INTERVAL_IN_WORDS,
        policies=tested_policies(protocol),
        metric=words.score if is_score else words.steps,
        other_metric=words.steps if is_score else words.score,
        power=None if protocol.power is None else power_in_words(protocol),
        assumptions=None if protocol.power is None else assumptions_in_words(protocol),
        software=version("humanplay"),
    )
