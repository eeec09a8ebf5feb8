"""A study in other languages: what freezing fixes, and what people read."""

import csv
import gettext
import io
import json
import re

import pytest

from humanplay.study import wording
from humanplay.study.folder import Folder
from humanplay.study.language_counts import count_languages
from humanplay.study.outcome import Outcome
from humanplay.study.progress import QUESTIONS_FIRST
from humanplay.study.protocol import StudyError, default_protocol, protocol_hash
from humanplay.study.texts import ERASURE
from humanplay.study.translation import (
    collect,
    localized,
    own_sentence,
    own_texts,
    path_of,
    write_missing,
)
from humanplay.study.wording import OPENING, preferred
from humanplay.task.registration import environment_of
from humanplay.task.sentences import Sentence
from marsexplorer.config import EnvConfig
from tests.support.command import command
from tests.support.declared import DECLARATIONS
from tests.support.recorded import ask
from tests.support.study import Person, freeze, write_own
from tests.support.translated import KEPT, OFFERED, RETENTION, pseudo

GERMAN = {"accept-language": "de-AT,de;q=0.9,en;q=0.5"}
BLOCKS = ("demographics", "remark")


@pytest.fixture
def root(tmp_path):
    return tmp_path / "playground.db-studies"


def draft(root, **rest):
    """A draft, and the folder of studies."""
    folder = Folder(root)
    config = EnvConfig.of("random", (7, 9))
    folder.create(default_protocol("small", config, declarations=DECLARATIONS, **rest))
    return folder


def person(serve, root, headers=GERMAN, join=None, **rest):
    """A participant of a frozen study in three languages, whose browser asks for one."""
    freeze(root, **{**OFFERED, **rest})
    server = serve()
    client = server.client()
    client.headers.update(headers)
    return Person(server, client=client, **(join or {}))


def test_freezing_copies_every_text_in_each_language_into_the_hashed_protocol(root):
    study = freeze(root, blocks=BLOCKS, **OFFERED)
    texts = study.protocol.texts
    assert set(texts) == set(study.protocol.languages) == {"en", "de", "es"}
    for words in texts.values():
        assert {ident for ident in wording.english() if "picture." not in ident} <= set(words)
        assert not any(ident.startswith("picture.") for ident in words)
    assert texts["en"]["consent.agree"] == "I agree and take part"
    assert texts["de"]["consent.agree"] == "Ich stimme zu und nehme teil"
    assert texts["de"]["refused.no_invitation"].startswith("diese Studie ist nur mit Einladung")
    assert "zehn Jahre" in texts["de"]["protocol.consent.text"]
    assert texts["de"]["protocol.blocks[0].title"] == "Über Sie"
    other = {**texts, "de": {**texts["de"], "consent.agree": "Ja"}}
    changed = study.protocol.model_copy(update={"texts": other})
    assert protocol_hash(changed) != study.protocol_hash


@pytest.fixture
def update(tmp_path, monkeypatch):
    """`update()` puts catalogues with other words in place of the software's."""

    def change():
        newer = tmp_path / "newer"
        newer.mkdir()
        texts = json.dumps(dict.fromkeys(wording.english(), "NEW"))
        (newer / "messages.json").write_text(texts, encoding="utf-8")
        monkeypatch.setattr(wording, "CATALOGUES", newer)
        forget()

    def forget():
        for cached in (wording.english, wording.page_texts, wording.catalogue):
            cached.cache_clear()

    yield change
    monkeypatch.undo()
    forget()


def test_an_update_of_the_software_changes_no_word_of_a_frozen_study(serve, root, update):
    me = person(serve, root)
    before = me.where
    refusal = me.refused("advance", {"from": "tutorial"})
    page = me.client.get("/study/small").text
    update()
    assert me.me()["consent"] == before["consent"]
    assert me.refused("advance", {"from": "tutorial"}) == refusal
    assert me.client.get("/study/small").text == page


def test_the_browser_preselects_the_choice_is_kept_and_the_consent_ends_it(serve, root):
    me = person(serve, root, blocks=BLOCKS)
    assert me.where["languages"] == ["en", "de", "es"]
    assert me.where["settings"]["language"] == "de"
    assert "Wir zeichnen jeden Zug" in me.where["consent"]["text"]
    assert '<html lang="de"' in me.client.get("/study/small").text
    del me.client.headers["accept-language"]
    assert '<html lang="de"' in me.client.get("/study/small").text, "it is the person's"
    assert me.call("settings", {"language": "es"})["settings"]["language"] == "es"
    assert '<html lang="es"' in me.client.get("/study/small").text
    assert "expected one of en, de, es" in me.refused("settings", {"language": "fr"}, 422)
    me.client.headers["accept-language"] = "es"
    agreed = me.call("consent", {"version": "1", "agree": True})
    assert agreed["block"]["title"] == "Sobre usted"
    assert me.refused("settings", {"language": "de"}).startswith("el idioma se elige antes")


@pytest.mark.parametrize(
    ("read", "counts"),
    [
        ("en en en de de de", {"en": 3, "de": 3}),
        ("en en en de de es", {"en": 3, "another language": 3}),
        ("en en en en de de de es", {"en": 4, "another language": 4}),
        ("en en en de", {}),
        ("en en", {}),
        ("", {}),
        ("en en en - - -", {"en": 3, "another language": 3}),
    ],
)
def test_a_language_of_few_is_joined_until_three_share_it(read, counts):
    assert count_languages(None if name == "-" else name for name in read.split()) == counts


def test_release_and_report_name_no_language_that_few_people_read(serve, root, tmp_path, capsys):
    freeze(root, **OFFERED, warm_up=0, ranked=1, outside_ids=(), blocks=("demographics",))
    server = serve()
    for number, language in enumerate(("de", "de", "de", "en", "en", "es")):
        reader = Person(server, joins=False)
        reader.client.headers["accept-language"] = language
        reader.call("join")
        reader.call("settings", {"palette": "standard"})
        reader.call("consent", {"version": "1", "agree": True})
        answers = {"age": 30, "gender": int(number in (2, 4, 5)), "education": 0}
        reader.call("block", {"block": "demographics", "turn": 0, "answers": answers})
        while reader.me()["stage"] != "complete":
            reader.take_step()
    server.stop()
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", *database)[0] == 0
    report = tmp_path / "report.html"
    assert command(capsys, "report", "--study", "small", "--html", report, *database)[0] == 0
    table = report.read_text().split("Who took part: the language that they read")[1]
    assert re.findall(r">(en|de|es|another language|\d)<", table)[:4] == [
        *("de", "3"), *("another language", "3")
    ]  # fmt: skip
    checklist = report.with_name("report-checklist.html").read_text()
    assert "3 read it in de, 3 read it in another language." in checklist
    assert f"Translated by: {OFFERED['translated_by']}." in checklist
    out = tmp_path / "bundle"
    code, printed, error = command(
        capsys, "release", "--study", "small", "--out", out, "--answers", *database
    )
    assert code == 0, error
    assert "2 of 6 people who answered are unique by their answers and the language" in printed
    people = csv.DictReader(io.StringIO((out / "csv" / "participants.csv").read_text()))
    assert sorted(row["language"] for row in people) == ["", "", "", "de", "de", "de"]
    stored = ask(out / "study.sqlite", "SELECT settings FROM participants")
    events = ask(out / "study.sqlite", "SELECT detail FROM stage_events WHERE kind = 'settings'")
    assert len(events) == 6
    assert ("language" in str(events), '"es"' in str(stored), '"de"' in str(stored)) == (
        False,
        False,
        True,
    )
    assert "The column `language` of" in (out / "DATASHEET.md").read_text()
    code, derived, error = command(capsys, "reproduce", out)
    assert (code, derived.splitlines()[-1].endswith(" values compared, 0 differ")) == (0, True), (
        error
    )


def test_a_refusal_and_what_explains_a_wrong_answer_are_in_the_language_too(serve, root):
    me = person(serve, root)
    me.to_tutorial()
    assert me.refused("advance", {"from": "tutorial"}) == (
        "spielen Sie die Übung mit den Tasten erst zu Ende, oder überspringen Sie sie"
    )
    me.give_up_tutorial()
    asked = me.call("answers", {"answers": [1, 0, 0]})
    assert asked["why"][0].startswith("Nicht ganz: Es läuft keine Uhr")
    assert asked["questions"][0]["question"] == "Was beendet eine Runde sofort?"
    left = me.call("withdraw")
    assert left["note"].startswith("Sie haben Ihre Teilnahme beendet.")
    assert "schreiben Sie an niemand, das ist ein Test" in left["note"]


def test_the_platforms_sentence_and_the_practice_are_in_the_language(serve, root):
    me = person(
        serve, root, platform="prolific", recruitment="panel", outcomes={"finished": "C1DONE"},
        practice={"episodes_to_pass": 1}, question_tries=2,
        payment={"currency": "GBP", "outcomes": {"withdrew": 1.5}},
        join={"outside_ids": {"PROLIFIC_PID": "1" * 24, "STUDY_ID": "a" * 24, "SESSION_ID": "b" * 24}},
    )  # fmt: skip
    assert "Sie bestehen die Übung, wenn mindestens 1 von 2" in me.where["consent"]["text"]
    assert "You pass the practice if at least 1 of its 2" not in me.where["consent"]["text"]
    me.call("consent", {"version": "1", "agree": True})
    left = me.call("withdraw")
    assert left["ending"]["outcome"] == Outcome.WITHDREW
    assert left["ending"]["sentence"].startswith("Bitte geben Sie Ihre Teilnahme auf Prolific")
    assert "1,50 GBP" in left["ending"]["sentence"]


def test_a_language_that_the_study_does_not_offer_is_answered_in_its_first(serve, root):
    me = person(serve, root, {"accept-language": "fr, pt;q=0.5"})
    assert me.where["settings"]["language"] == "en"
    assert '<html lang="en"' in me.client.get("/study/small").text


def test_right_answers_and_other_arms_never_reach_the_page(serve, root):
    arms = [
        {"name": "arm_one", "hint": "Walls first"},
        {"name": "arm_two", "hint": "The middle first"},
    ]
    hints = {
        language: {**words, "protocol.arms[0].hint": "EINS", "protocol.arms[1].hint": "ZWEI"}
        for language, words in OFFERED["own_texts"].items()
    }
    me = person(serve, root, arms=arms, own_texts=hints)
    page = me.client.get("/study/small").text
    assert "Nicht ganz" not in page
    assert ("EINS" in page, "ZWEI" in page) == (False, False)


def test_freezing_asks_who_translated_and_who_checked(root):
    folder = draft(root, languages=("en", "de"), translated_by="we", checked_by="TODO")
    write_own(folder.path("small"), "de", {RETENTION: "zehn Jahre"})
    with pytest.raises(
        StudyError, match="who translated it and who checked that: write checked_by"
    ):
        folder.freeze("small")


def test_freezing_refuses_a_language_that_lacks_a_text_and_the_command_writes_it_down(
    root, tmp_path, capsys
):
    declared = {"translated_by": "we", "checked_by": "others"}
    folder = draft(root, languages=("en", "de"), title="Our {ranked} rounds", **declared)
    with pytest.raises(
        StudyError, match=r"2 texts .* no translation into 'de', such as protocol\.title"
    ):
        folder.freeze("small")
    database = str(tmp_path / "playground.db")
    code, out, error = command(capsys, "study", "texts", "small", "de", "--database", database)
    assert (code, "2 texts to be translated" in out) == (0, True), error
    path = path_of(folder.path("small"), "de")
    assert '# "Our {ranked} rounds"\n"protocol.title" = ""\n' in path.read_text("utf-8")
    assert own_texts(folder.path("small"), "de") == {}
    write_own(
        folder.path("small"), "de", {"protocol.title": "Unsere {ranked}", RETENTION: "zehn Jahre"}
    )
    study = folder.freeze("small")
    assert localized(study.protocol, "de").title == "Unsere 30"
    assert study.protocol.title == "Our 30 rounds"


def test_a_study_is_shown_in_each_of_its_languages(root, capsys):
    database = ("--database", root.with_name("playground.db"))
    declared = {"translated_by": "we", "checked_by": "others"}
    folder = draft(root, languages=("en", "de"), title="Our {ranked} rounds", **declared)
    code, printed, _ = command(capsys, "study", "show", "small", *database)
    assert (code, "missing in de: `humanplay study texts small de`" in printed) == (0, True)
    write_own(
        folder.path("small"),
        "de",
        {**OFFERED["own_texts"]["de"], "protocol.title": "Unsere {ranked} Runden"},
    )
    code, printed, _ = command(capsys, "study", "show", "small", "--language", "de", *database)
    assert (code, "missing" in printed, '"title": "Unsere 30 Runden"' in printed) == (
        0,
        False,
        True,
    )
    folder.freeze("small")
    code, printed, _ = command(capsys, "study", "show", "small", "--language", "de", *database)
    assert (
        code,
        '"title": "Unsere 30 Runden"' in printed,
        "Die Teilnahme ist freiwillig" in printed,
    ) == (0, True, True)
    code, _, complaint = command(capsys, "study", "show", "small", "--language", "fr", *database)
    assert (code, "is offered in en, de, not in 'fr'" in complaint) == (2, True)


def test_a_study_says_any_text_in_its_own_words(root):
    folder = draft(root)
    write_own(folder.path("small"), "en", {"consent.agree": "Yes, I do"})
    assert folder.filled("small").texts["en"]["consent.agree"] == "Yes, I do"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"consent.agre": "Ja"}, "did you mean 'consent.agree'"),
        ({"ready.done": "{ranked} gespielt"}, "has {ranked}, which nothing fills in there"),
        ({"moves.one": "a move"}, "lacks {n}, which stands in"),
        ({"mars.rules.done": "All is done"}, "lacks </span>, which stands in"),
        ({"consent.agree": "<b>Yes</b>"}, "has </b>, which nothing fills in there"),
        ({"consent.agree": 'Say "yes"'}, "has straight quotation marks"),
        ({"move.few": "{n} moves"}, "did you mean 'mo"),
        ({"moves.few": "few moves"}, "lacks {n}, which stands in '{n} moves'"),
    ],
)
def test_own_texts_with_another_id_placeholder_or_mark_are_refused(root, words, sentence):
    folder = draft(root)
    write_own(folder.path("small"), "en", words)
    with pytest.raises(StudyError) as refusal:
        folder.filled("small")
    assert sentence in str(refusal.value)


def test_a_language_that_is_not_shipped_can_be_written_whole(root):
    declared = {"translated_by": "we", "checked_by": "others"}
    folder = draft(root, languages=("en", "fr"), **declared)
    added = write_missing(folder.draft("small"), folder.path("small"), "fr", with_all=False)
    assert {"consent.agree", "refused.closed", "protocol.title"} <= set(added)
    assert len(added) > len(wording.english())
    sources = collect(folder.draft("small"), folder.path("small"), "fr").missing
    words = {
        ident: " ".join(["mot", *KEPT.findall(text), *("n" * (text == ""))])
        for ident, text in sources.items()
    }
    write_own(folder.path("small"), "fr", words)
    assert folder.filled("small").texts["fr"]["consent.agree"] == "mot"


def filled_in(root, languages, replaced, **rest):
    """The protocol of a study in some languages, with its replaced words in them."""
    folder = draft(root, languages=languages, translated_by="we", checked_by="others", **rest)
    for language, words in replaced.items():
        write_own(folder.path("small"), language, words)
    return folder.filled("small")


def test_a_text_in_the_studys_own_words_is_missing_in_its_other_languages(root):
    replaced = {"consent.agree": "Yes, I do", "consent.title": wording.english()["consent.title"]}
    folder = draft(root, languages=("en", "de"), translated_by="we", checked_by="others")
    write_own(folder.path("small"), "en", replaced)
    write_own(folder.path("small"), "de", {RETENTION: "zehn Jahre"})
    with pytest.raises(StudyError, match=r"1 texts .* into 'de', such as consent\.agree"):
        folder.filled("small")
    write_missing(folder.draft("small"), folder.path("small"), "de", with_all=True)
    path = path_of(folder.path("small"), "de")
    assert '# "Yes, I do"\n"consent.agree" = ""\n' in path.read_text("utf-8")
    write_own(folder.path("small"), "de", {RETENTION: "zehn Jahre", "consent.agree": "Ja"})
    assert folder.filled("small").texts["de"]["consent.agree"] == "Ja"


def test_a_study_whose_first_language_is_not_shipped_offers_those_that_are(root):
    folder = draft(root, languages=("fr", "en", "de"), translated_by="we", checked_by="others")
    template, place = folder.draft("small"), folder.path("small")
    french = collect(template, place, "fr").missing
    write_own(place, "fr", {ident: pseudo(text) for ident, text in french.items()})
    assert "consent.agree" in french
    assert not {"consent.agree", "moves.one"} & collect(template, place, "en").missing.keys()
    assert not {"consent.agree", "moves.one"} & collect(template, place, "de").missing.keys()


def test_further_forms_of_the_plural_are_frozen(root):
    replaced = {"moves.few": "{n} ruchy", "moves.many": "{n} ruchów", "moves.two": "dwa ruchy"}
    sources = collect(
        draft(root, languages=("en", "pl"), translated_by="we", checked_by="others").draft("small"),
        root / "small",
        "pl",
    ).missing
    words = {ident: pseudo(text) for ident, text in sources.items()}
    write_own(root / "small", "pl", {**words, **replaced})
    texts = Folder(root).filled("small").texts["pl"]
    assert {ident: texts[ident] for ident in replaced} == replaced


def test_a_study_in_german_alone_keeps_the_rest_of_a_consent_with_a_paragraph_of_its_own(root):
    config = EnvConfig.of("random", (7, 9))
    _, *rest = default_protocol("small", config, declarations=DECLARATIONS).consent.text.split(
        "\n\n"
    )
    consent = {"version": "1", "text": "\n\n".join(["Unser eigener Absatz.", *rest])}
    text = filled_in(root, ("de",), {}, consent=consent).consent.text
    assert text.startswith("Unser eigener Absatz.\n\n")
    assert "Wir zeichnen jeden Zug" in text
    assert "We record" not in text


def test_no_language_of_a_study_that_keeps_episodes_promises_to_erase_them(root):
    config = EnvConfig.of("random", (7, 9))
    promising = default_protocol("small", config, declarations=DECLARATIONS).consent
    promise = wording.translated("de", ERASURE)
    assert promise in wording.translated("de", promising.text.split("\n\n")[-1])
    german = "\n\n".join(
        wording.translated("de", part) or part for part in promising.text.split("\n\n")
    )
    keeping = promising.model_copy(update={"text": "We keep all. {retention} {contact}"})
    for languages, consent, replaced in (
        (("de",), promising, {}),
        (("de",), promising.model_copy(update={"text": german}), {}),
        (("en", "de"), keeping, {"protocol.consent.text": f"{promise} {{retention}} {{contact}}"}),
    ):
        study = Folder(root / str(len(replaced)) / str(len(consent.text)))
        rest = {"languages": languages, "translated_by": "we", "checked_by": "others"}
        study.create(
            default_protocol(
                "small", config, declarations=DECLARATIONS, consent=consent,
                keep_episodes_when_forgotten=True, **rest,
            )
        )  # fmt: skip
        write_own(
            study.path("small"), languages[-1], replaced and {RETENTION: "zehn Jahre", **replaced}
        )
        with pytest.raises(StudyError, match="promises that what was played is erased"):
            study.filled("small")


def test_a_refusal_says_a_text_of_the_protocol_in_its_readers_language(root):
    protocol = filled_in(root, ("en", "de"), {"de": {RETENTION: "zehn Jahre"}}, blocks=BLOCKS)
    german = wording.wording_of(protocol, "de")
    title = own_sentence("blocks[0].title", protocol.blocks[0].title)
    assert "Über Sie" in german.say(QUESTIONS_FIRST.format(title=title))
    assert german.say(Sentence(OPENING, "You are invited")).startswith("Sie sind eingeladen")


def test_a_translation_that_equals_its_english_is_not_missing(monkeypatch):
    class Same(gettext.NullTranslations):
        """A catalogue of one text."""

        def gettext(self, message):
            return {"no": "no"}.get(message, "")

    monkeypatch.setattr(wording, "catalogue", lambda language: Same())
    assert wording.translated("es", "no") == "no"
    assert wording.translated("es", "yes") is None


def test_a_study_in_german_alone_needs_no_english(root):
    declared = {"translated_by": "we", "checked_by": "others"}
    study = freeze(root, languages=("de",), title="Unsere Studie", **declared)
    assert study.protocol.title == "Unsere Studie"
    assert study.protocol.consent.text.startswith("Sie sind eingeladen")
    assert "en" not in study.protocol.texts


def test_a_dry_run_has_the_texts_of_its_study(root):
    folder = draft(root, languages=("en", "de"), translated_by="we", checked_by="others")
    write_own(folder.path("small"), "de", {RETENTION: "zehn Jahre"})
    dry = folder.begin_dry_run("small").parent.name
    frozen = folder.freeze(dry).protocol
    assert frozen.title.endswith("(dry run)")
    assert localized(frozen, "de").title.endswith("(Probelauf)")


def test_a_study_whose_name_means_no_value_is_refused_and_so_is_its_dry_run(root):
    folder = draft(root)
    config = EnvConfig.of("random", (7, 9))
    with pytest.raises(StudyError, match='cannot be called "none"'):
        folder.create(default_protocol("none", config, declarations=DECLARATIONS))
    folder.path("small").rename(root / "none")
    with pytest.raises(StudyError, match='cannot be called "none"'):
        folder.begin_dry_run("none")


@pytest.mark.parametrize(
    ("accepted", "language"),
    [
        ("", "en"),
        ("de-AT,de;q=0.9,en;q=0.5", "de"),
        ("fr, es;q=0.4, de;q=0.7", "de"),
        ("de;q=0, es;q=0.1", "es"),
        ("de;q=x, ES-mx", "es"),
        ("es ; q=0.4, de ; q=0.7", "de"),
        ("pt-PT", "pt-PT"),
        ("pt-ao,de;q=0.5", "pt-BR"),
    ],
)
def test_the_language_that_a_browser_likes_best_is_chosen(accepted, language):
    assert preferred(accepted, ("en", "de", "es", "pt-BR", "pt-PT")) == language


def test_another_environment_is_offered_in_german(root):
    folder = Folder(root)
    lake = "gymnasium:FrozenLake-v1"
    environment = environment_of(lake)
    protocol = default_protocol(
        "lake", environment.default, lake, declarations=DECLARATIONS, languages=("en", "de"),
        translated_by="we", checked_by="others", warm_up=1, ranked=1,
    )  # fmt: skip
    folder.create(protocol)
    write_own(folder.path("lake"), "de", {RETENTION: "zehn Jahre"})
    texts = folder.freeze("lake").protocol.texts["de"]
    assert texts["task.instructions"].startswith("Gehen Sie zur Fahne")
    assert (texts["action.left"], texts["metric.return"]) == ("links", "Ertrag")
