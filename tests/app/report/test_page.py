"""The page stands alone: no request, no script, and nothing that axe finds."""

import re
from collections import Counter
from html.parser import HTMLParser

import numpy as np
import pytest

from humanplay.report.build import build
from humanplay.report.page import pages as all_pages
from humanplay.report.page import render
from humanplay.report.statistics.summaries import EpisodeSummary, coverage_curve, visit_counts
from tests.support.browser import QUIET, chromium_path, violations
from tests.support.declared import DECLARATIONS
from tests.support.made_studies import CONFIG, played, run, study

SCORES = np.random.default_rng(1).normal(0.85, 0.08, (4, 6)).clip(0, 0.97)


def pictures():
    path = [(0, 0), (0, 1), (1, 1), (1, 2)]
    games = [EpisodeSummary(True, 0.9, 3, [9, 20, 40, 63], path, CONFIG.n)]
    return {
        "curve": coverage_curve([games, games]),
        "visits": visit_counts(CONFIG.size, [games]),
    }


@pytest.fixture(scope="module")
def pages():
    """The page over people, and the one over scripts."""
    runs = [
        run("ppo", SCORES.mean(0) + 0.02),
        run("random <b>", [0.3] * 6),
        run("random", [0.3] * 6),
    ]
    people = build(
        study(*played(SCORES), title="Rocks & <dunes>"), runs, pictures={"people": pictures()}
    )
    scripts = build(study(*played(SCORES, "script", "idler")), runs, True, {"idler": pictures()})
    return render(people), render(scripts)


class Collected(HTMLParser):
    """The tags of a page in order; each opened element is closed where it should be."""

    EMPTY = frozenset(("meta", "link", "br", "path", "use", "rect", "image", "circle"))

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.attributes = Counter(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags[tag] += 1
        self.attributes += attrs
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags[tag] += 1
        self.attributes += attrs

    def handle_endtag(self, tag):
        if tag not in self.EMPTY:
            assert self.open.pop() == tag


def test_what_the_authors_declared_is_printed_folded(pages):
    for page in pages:
        (declared,) = re.findall(
            r"<details><summary>What the authors declared(.*?)</details>", page, re.S
        )
        for name, text in DECLARATIONS.items():
            assert (
                f'scope="row">{name.replace("_", " ")}</th><td role="cell" data-head="answer">{text}</td>'
                in declared
            )


def test_every_element_is_closed_and_every_id_is_one(pages):
    for page in pages:
        elements = Collected(page)
        assert elements.open == []
        assert elements.tags["svg"] == (
            12 if 'body class="human"' in page else 10
        )  # each for screens and for phones; scripts have no flow of participants
        ids = Counter(value for name, value in elements.attributes if name == "id")
        assert ids
        assert max(ids.values()) == 1
        used = {
            value[1:]
            for name, value in elements.attributes
            if name.endswith("href") and value.startswith("#")
        }
        assert used <= set(ids)


def test_text_is_escaped(pages):
    assert "Rocks &amp; &lt;dunes&gt;" in pages[0]
    assert "random &lt;b&gt;" in pages[0]
    assert "<b>" not in pages[0]


def test_nothing_is_fetched_and_nothing_runs(pages):
    for page in pages:
        elements = Collected(page)
        assert elements.tags["script"] == 0
        outside = [
            value
            for name, value in elements.attributes
            if name in ("src", "href", "xlink:href") and value
        ]
        beside = ("report-methods.html", "report-checklist.html")
        assert all(value.startswith(("#", "data:", *beside)) for value in outside)
        assert not re.search(r"url\((?!['\"]?(#|data:))", page)
        assert "@import" not in page


def test_the_page_says_every_part(pages):
    for heading in ("Result", "Read before use", "Who played", "Spread", "Policies on the same instances",
                    "Learning over the ranked trials", "Where they went", "Deviations from the protocol",
                    "Protocol"):  # fmt: skip
        assert f">{heading}</h" in pages[0], heading
    for wanted in ("per protocol", "everybody", "instances at the lowest score"):
        assert wanted in pages[0], wanted


@pytest.mark.browser
@pytest.mark.skipif(
    chromium_path() is None, reason="NO CHROMIUM: install it to run the browser tests"
)
def test_a_browser_asks_for_nothing_overflows_nowhere_and_axe_finds_nothing(pages, tmp_path):
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=QUIET)
        for name, text in zip(("people", "scripts"), pages, strict=True):
            path = tmp_path / f"{name}.html"
            path.write_text(text, encoding="utf-8")
            page = browser.new_page(viewport={"width": 360, "height": 740})
            asked = []
            page.on("request", lambda request, asked=asked: asked.append(request.url))
            page.goto(path.as_uri())
            assert [url for url in asked if not url.startswith("data:")] == [path.as_uri()]
            page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
            assert page.evaluate("document.documentElement.scrollWidth") <= 360
            assert violations(page) == []
            page.close()
        browser.close()


LETTERS = """() => [...document.querySelectorAll("figure svg")]
    .filter((chart) => chart.getBoundingClientRect().width)
    .flatMap((chart) => [...chart.querySelectorAll("text")].map((text) => {
        const scale = chart.getBoundingClientRect().width / chart.viewBox.baseVal.width;
        return scale * parseFloat(getComputedStyle(text).fontSize);
    }))"""
"""The sizes of the letters of all charts that are shown, in pixels."""
CUT_TABLES = """() => [...document.querySelectorAll(".wide")]
    .filter((box) => box.scrollWidth > box.clientWidth)
    .map((box) => box.textContent.slice(0, 40))"""
BRIGHTNESS = """() => [document.body, ...document.querySelectorAll("figure, .wide")]
    .map((part) => getComputedStyle(part).backgroundColor.match(/[0-9.]+/g).map(Number))
    .filter((colour) => colour[3] !== 0)
    .map(([red, green, blue]) => Math.max(red, green, blue))"""


@pytest.mark.browser
@pytest.mark.skipif(
    chromium_path() is None, reason="NO CHROMIUM: install it to run the browser tests"
)
def test_on_a_phone_charts_and_tables_are_read_whole_in_the_systems_colours(pages, tmp_path):
    from playwright.sync_api import sync_playwright

    path = tmp_path / "people.html"
    path.write_text(pages[0], encoding="utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=QUIET)
        for width, scheme in ((320, "dark"), (390, "light"), (1024, "dark"), (1440, "dark")):
            size = {"width": width, "height": 800}
            page = browser.new_page(
                viewport=size, color_scheme=scheme, has_touch=width < 1000, reduced_motion="reduce"
            )
            page.goto(path.as_uri())
            if width < 400:
                assert page.evaluate("document.documentElement.scrollHeight") < 4400, width
            page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            letters = page.evaluate(LETTERS)
            assert len(letters) > 40
            assert min(letters) >= 11 - 0.01, (width, min(letters))
            if width < 400:
                assert page.evaluate(CUT_TABLES) == []
            brightest = max(page.evaluate(BRIGHTNESS))
            assert brightest < 40 if scheme == "dark" else brightest > 240
            assert violations(page) == [], scheme
            page.close()
        browser.close()


def test_the_first_page_has_flow_headline_comparison_picture_and_cautions_and_the_rest_is_folded(
    pages,
):
    first, folded = pages[0].split('<details class="section">', 1)
    for wanted in (
        "Figure of unverified participants (attested). Per protocol: 4 players",
        "Everybody who began: 4 players",
        '<p class="large"><strong>24.0</strong> steps to 99 %</p>',
        "Required of every ranked episode: attested",
        "Opened the study: 4",
        "Policies on the same instances, with 95 % intervals",
        "Below, both estimates",
        "Everybody who came: where they are",
        "Read before use",
        "4 players are few",
    ):
        assert wanted in first, wanted
    assert first.count("<svg") == 6
    parts = [first.index(part) for part in ('class="large"', "4 players are few", "<table", "Each")]
    assert parts == sorted(parts), "the estimates come first"
    assert "ppo" in re.search(r"<svg.*?</svg>", first, re.S)[0], (
        "people and policies in one picture"
    )
    assert first.count("<table") == 1, "of the people; a phone scrolls through no other"
    headings = re.findall(r"<h2>(.*?)</h2>", folded)
    assert headings[:2] == ["Both estimates in full", "Against policies, instance by instance"]
    assert len(headings) >= 9
    assert len(headings) == len(re.findall(r"<summary><h2>", folded))


@pytest.mark.browser
@pytest.mark.skipif(
    chromium_path() is None, reason="NO CHROMIUM: install it to run the browser tests"
)
def test_figures_take_a_page_tables_have_room_for_words_and_paper_has_what_is_folded(
    pages, tmp_path
):
    from playwright.sync_api import sync_playwright

    (tmp_path / "report.html").write_text(pages[0], encoding="utf-8")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=QUIET)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.goto((tmp_path / "report.html").as_uri())
        for part, screens in ((".overview", 1), (".first", 2)):
            ends = page.locator(part).bounding_box()
            assert ends["y"] + ends["height"] <= screens * 900
        on_screen = page.evaluate("document.documentElement.scrollHeight")
        page.evaluate("document.querySelectorAll('details').forEach(each => each.open = true)")
        assert page.evaluate(COLUMNS_OF_ONE_WORD_A_LINE) == []
        page.reload()
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 680, "height": 1009})  # A4 less its margins
        ends = page.locator(".first").bounding_box()
        assert ends["y"] + ends["height"] <= 1009
        assert page.evaluate("document.documentElement.scrollHeight") > 2 * on_screen
        assert page.evaluate(COLUMNS_OF_ONE_WORD_A_LINE) == []
        assert not page.get_by_text("The protocol in full").is_visible()
        browser.close()


COLUMNS_OF_ONE_WORD_A_LINE = """[...document.querySelectorAll("td, th")].filter(cell => {
    const range = document.createRange();
    range.selectNodeContents(cell);
    const lines = new Set([...range.getClientRects()].map(each => Math.round(each.top))).size;
    return lines > 2 && lines >= cell.innerText.trim().split(/\\s+/).length;
}).map(cell => cell.innerText)"""


def test_checklist_and_methods_are_files_of_their_own_that_the_page_links_to():
    report = build(study(*played(SCORES)), [run("random", [0.3] * 6)])
    files = all_pages(report, "pilot.htm")
    assert list(files) == ["pilot.htm", "pilot-methods.htm", "pilot-checklist.htm"]
    page, methods, checklist = files.values()
    for words in ("Paper title", "Owen 1988", "Methods", "Coverage (%)", "2506.13776"):
        assert words not in page, words
    assert '<a href="pilot-methods.htm">' in page
    assert '<a href="pilot-checklist.htm">' in page
    assert "Owen 1988" in methods
    assert '<a href="pilot.htm">' in methods
    assert '<a href="pilot.htm">' in checklist
    assert ">Missing</td>" not in checklist
    answered, unknown = checklist.split("What only the authors know")
    assert "Baseliner sampling strategy" in answered
    assert "0.1 Paper title" in unknown
    scripts = build(study(*played(SCORES, "script", "idler")), [], True)
    assert list(all_pages(scripts)) == ["report.html", "report-methods.html"]
    for text in (*files.values(), *all_pages(scripts).values()):
        assert Collected(text).open == []


def test_a_long_policys_name_leaves_room_for_the_charts():
    """matplotlib warns when nothing is left of a chart, and warnings are errors here."""
    people, trials = played(np.full((5, 6), 0.8) + np.arange(5)[:, None] / 50)
    path = "/a/folder/of/policies/" + "with-a-name-that-is-long-" * 4 + "mine.onnx"
    page = render(
        build(
            study(people, trials),
            [run(path, [0.9, 0.8, 0.9, 0.8, 0.9, 0.7]), run("random", [0.3] * 6)],
        )
    )
    assert "…" in page
    assert path in page, "the tables have it whole"
