"""The page of a synthetic player, cancelled wherever it can be: no connection is left behind."""

import asyncio
import gc
import types
import warnings

import pytest

from app.simulate.client import Page


@types.coroutine
def cancelled_from(first, coroutine, times):
    """Await a coroutine whose task is cancelled at its `first` wait and at each one after, `times` in all."""
    waits, throw = 0, None
    while True:
        try:
            waited = coroutine.send(None) if throw is None else coroutine.throw(throw)
        except StopIteration as done:
            return done.value
        if first <= waits < first + times:
            asyncio.current_task().cancel()
        waits, throw = waits + 1, None
        try:
            yield waited
        except BaseException as error:
            throw = error


async def visit(url):
    """Do all that a page can: call, open a board, look, open another, and go."""
    page = Page(url, "small")
    try:
        session = (await page.ask("POST", "api/sessions", {})).json()["session"]
        await page.open(session)
        await page.receive()
        await page.open(session)
    finally:
        await page.close()


def left_open(work):
    """Return what `asyncio.run(work)` left unclosed, and whether it was cancelled."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        gc.collect()  # what others left is not ours
        warnings.simplefilter("always", ResourceWarning)
        try:
            asyncio.run(work)
            is_cancelled = False
        except asyncio.CancelledError:
            is_cancelled = True
        gc.collect()
    return [str(each.message) for each in caught], is_cancelled


@pytest.mark.parametrize("times", [1, 2, 1000], ids=["once", "twice", "again-and-again"])
def test_a_page_cancelled_at_any_wait_leaves_nothing_open(server, times):
    first, is_cancelled = 0, True
    while is_cancelled:

        async def work(first=first):
            await cancelled_from(first, visit(server.url), times)

        found, is_cancelled = left_open(work())
        assert found == [], f"cancelled at wait {first}"
        first += 1
    assert first > 10, "there were waits to be cancelled at"
