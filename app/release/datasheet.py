"""The datasheet of a release (after Gebru et al. 2021): why, what, how and for whom, from its protocol and its counts."""

from __future__ import annotations

import json
from collections.abc import Mapping

from app.release.columns import SUMMARIES, markdown
from app.release.header import BUNDLE_DATABASE, Header


def datasheet(header: Header, minari: Mapping[str, int], without_moves: int, citation: str, licence_url: str) -> str:
    """Return the datasheet as Markdown.

    minari         episodes by Minari dataset id
    without_moves  episodes that Minari cannot hold
    """
    counted = "\n".join(f"| {name.replace('_', ' ')} | {count} |" for name, count in header.rows.items())
    tables = "\n\n".join(f"### {name}\n{SUMMARIES[name].capitalize()}.\n\n{markdown(name)}" for name in SUMMARIES)
    loads = "\n".join(f"- `{name}`: {count} episodes" for name, count in minari.items()) or "- none"
    return f"""# Datasheet: {header.title}
Version {header.version}, {header.released}. {header.summary()}
{_warning(header)}
## Motivation
Recorded to measure how well people explore unknown terrain in MarsExplorer (Koutras et al. 2021), on terrains that policies
can be evaluated on as well. By {"; ".join(header.authors)}.

## Composition
| table | rows |
|---|---|
{counted}

{_composition(header)}

## Collection
{_collection(header)}

## Privacy
Participants, browsers and boards appear under pseudonyms drawn for this release alone. Names, addresses and the ids of
recruiting sites are not in it. Times are the server's: whoever knows when somebody took part can recognise them.

## Preprocessing
None. Positions and coverage in the tables are replayed from the actions.

## Uses
`{BUNDLE_DATABASE}` holds everything, in the schema of the software; the other files are made from it. Minari (set
`MINARI_DATASETS_PATH` to the folder `minari`):
{loads}

{without_moves} episodes without a single move cannot be kept there. An abandoned episode ends there truncated, with the
rewards of its moves; its `return` has the price of abandoning (r_invalid) taken off.

## Verify
`marsexplorer verify --dataset .` checks every file against MANIFEST.json, the manifest against its signature, and simulates
every episode again. Without the software, compare the SHA-256 of each file after
`openssl pkeyutl -verify -pubin -inkey PUBLIC_KEY.pem -rawin -in MANIFEST.json -sigfile MANIFEST.sig`.
The simulation proves that the data are consistent; the signature proves that the holder of the key made them.

## Maintenance
{_maintenance(header)} A participant who asks to be forgotten is taken out of the next version.
Licence: {header.protocol.data_licence}, {licence_url}. Cite as: {citation}

## Columns
{tables}
"""


def _warning(header: Header) -> str:
    if not header.interim:
        return ""
    return "\n> **Not for publication.** The study is open: these episodes give its terrains away to whoever has yet to play.\n"


def _composition(header: Header) -> str:
    outcomes = ", ".join(f"{count} {name}" for name, count in sorted(header.outcomes.items())) or "none"
    left = header.left_out
    return f"""Outcomes: {outcomes}. Configuration of every episode: `{json.dumps(header.protocol.config)}`.
`kind` is `human` or `script`; a script is a synthetic player and belongs into no human figure. `driver` is `human` only
where every move came from a person's own key or touch.
Left out: {left.get("open_episodes", 0)} episodes that were never finished, {left.get("without_consent", 0)} people who did
not agree to the consent text. Nothing else was removed or repaired."""


def _collection(header: Header) -> str:
    protocol = header.protocol
    return f"""In a browser, by a server that makes every move itself and keeps it before showing it. The protocol is in
`protocol.json` (SHA-256 of its canonical JSON: `{header.protocol_hash}`): {protocol.warm_up} episodes to warm up,
{protocol.ranked} that count, the same ranked terrains for everybody in an order of each one's own, scores hidden until the
end. Consent text: version {protocol.consent.version}, in the protocol.
{_secret(header)}"""


def _secret(header: Header) -> str:
    if header.interim:
        return "The study's secret is not revealed yet, so the seeds cannot be derived again."
    return f"""The study's secret, revealed when it was closed, is `{header.secret}`;
its SHA-256 is the commitment `{header.commitment}`, published before anybody played.
Seed i of a phase is the first 53 bits of HMAC-SHA256(secret, protocol hash | ranked or warm-up | i)."""


def _maintenance(header: Header) -> str:
    if header.supersedes is None:
        return "This is the first version."
    return f"""It supersedes version {header.supersedes["version"]} ({header.supersedes["reason"]}; its manifest has SHA-256
`{header.supersedes["manifest_sha256"]}`): please use this one and delete the other."""
