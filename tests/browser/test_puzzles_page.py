"""The puzzles' page: a key or a button answers, and the browser keeps the choice."""

import json

from humanplay.results.puzzles import puzzles_of
from tests.support.browser import KEY_OF, NO_3D, judge


def test_three_puzzles_are_answered_by_keys_and_buttons_and_a_reload_keeps_them(serve, player):
    me = player(serve(), NO_3D)
    page, wrong = me.page, []
    sent = []
    page.on("request", lambda request: sent.append(request) if request.method != "GET" else None)

    def begin():
        page.goto(f"{me.url}/puzzles")
        me.wait("window.puzzles.today && document.body.dataset.state === 'ready'")

    keys = {"north": "i", "east": "l", "south": "k", "west": "j"}
    chosen = {action: [KEY_OF[action], f"Key{key.upper()}"] for action, key in keys.items()}
    page.goto(f"{me.url}/about")
    page.evaluate(
        "keys => localStorage.setItem('humanplay.keys', keys)", json.dumps({"mars": chosen})
    )
    begin()
    wrong += judge(page, "puzzle-open")
    puzzles = puzzles_of("mars")
    ids = [puzzle["id"] for puzzle in page.evaluate("() => window.puzzles.today.puzzles")]
    answers = [puzzles[ident].answer for ident in ids]
    blocked = next((direction for direction in KEY_OF if direction not in answers[0].means), None)
    if blocked:
        page.keyboard.press(KEY_OF[blocked])
        assert page.get_by_test_id("verdict").is_hidden(), "a rock is no answer"
    page.keyboard.press(KEY_OF[answers[0].best])
    page.get_by_text(f"{answers[0].best.capitalize()} is right.").wait_for()
    text = page.get_by_test_id("verdict").inner_text()
    assert f"saves {round(answers[0].saves)} moves on average" in text
    reason = page.get_by_test_id("why")
    shows = answers[0].shows
    second = min(
        (move for move in answers[0].means if move != answers[0].best), key=answers[0].means.get
    )
    shows_more = len(shows[answers[0].best]) > len(shows[second])
    assert ("brings in sight" in reason.inner_text()) == shows_more, "the answer says why"
    saves_later = not shows_more and answers[0].here > 0
    assert ("comes later" in reason.inner_text()) == saves_later
    wrong += judge(page, "puzzle-right")
    page.get_by_test_id("next").click()
    other = next(direction for direction in answers[1].means if direction != answers[1].best)
    page.get_by_test_id(f"move-{other}").click()
    page.get_by_text(f"{answers[1].best.capitalize()} was better than {other}.").wait_for()
    wrong += judge(page, "puzzle-wrong")
    begin()
    assert page.evaluate("() => window.puzzles.number") == 2, "the first that is open"
    page.keyboard.press(keys[answers[2].best])
    page.get_by_text("That was today: 2 of 3 right.").wait_for()
    wrong += judge(page, "puzzle-done")
    begin()
    page.get_by_text("That was today: 2 of 3 right.").wait_for()
    stored = page.evaluate("() => JSON.parse(localStorage.getItem('humanplay.puzzles'))")
    (choices,) = stored.values()
    assert [choice["answer"] for choice in choices] == [answers[0].best, other, answers[2].best]
    assert all(set(choice) == {"id", "answer", "ms"} and choice["ms"] > 0 for choice in choices)
    assert sent == []
    assert wrong == []
    assert me.errors == []
