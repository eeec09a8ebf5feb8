"""Replays as files: pictures of the right size and colours, and one whole page."""

import io
import json
import re
import sys
from dataclasses import replace

import av
import numpy as np
import pytest
from PIL import Image, ImageDraw

from humanplay.tasks.mars.colours import AMBER, NIGHT, ROCK, SOIL
from humanplay.tasks.mars.course import course_of, play_ghost
from humanplay.tasks.mars.pictures import PREVIEW, board_picture
from humanplay.web.replays.files import (
    Timing,
    VideoMissingError,
    file_of,
    has_video,
    most_gif_pictures,
    offered,
)
from humanplay.web.replays.page import ENTRY, modules
from marsexplorer.config import OBSTACLE, EnvConfig
from marsexplorer.episode import Episode
from tests.support.recorded import free_moves

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)


def record_of(actions, seed=4):
    episode = Episode.begin(CONFIG, seed=seed)
    for action in actions(episode):
        if not episode.ended:
            episode.step(action)
    return episode.record()


@pytest.fixture(scope="module")
def courses():
    record = record_of(lambda episode: [*free_moves(episode)[:4], 0])
    return course_of("A person", record), play_ghost("frontier-cost", record)


def test_a_board_is_drawn_in_the_common_colours_and_shows_nothing_before_it_was_known(courses):
    _, ghost = courses
    cell = 10
    for step in (0, 3, ghost.moves):
        picture = board_picture(ghost, step, cell, AMBER)
        assert picture.size == (130, 90)
        for (row, col), since in np.ndenumerate(ghost.known_since):
            is_known = 0 <= since <= step
            expected = (
                NIGHT if not is_known else ROCK if ghost.codes[row, col] == OBSTACLE else SOIL
            )
            shown = picture.getpixel((col * cell + 1, row * cell + 1))
            assert (row, col) == ghost.path[step] or shown == expected, (step, row, col)


def test_a_gif_has_a_picture_for_each_move_and_holds_the_end(courses):
    timing = Timing.of(courses, speed=10)
    last = max(course.moves for course in courses)
    assert timing.steps == tuple(range(last + 1))
    calls = []
    content = file_of("gif", "e", courses, 10, lambda done, total: calls.append((done, total)))
    with Image.open(io.BytesIO(content)) as picture:
        size = courses[0].animation(courses[1:], is_large=False).size
        assert (picture.n_frames, picture.size) == (last + 1, size)
        durations = []
        for number in range(picture.n_frames):
            picture.seek(number)
            durations.append(picture.info["duration"])
        assert picture.convert("RGB").getpixel((0, 0)) == NIGHT
        assert durations == [*[100] * last, 3000]
        assert picture.info["loop"] == 0
    assert calls[-1] == (last + 1, last + 1)


def test_an_mp4_has_the_same_pictures_and_then_the_end_for_three_seconds(courses):
    timing = Timing.of(courses[:1], speed=8)
    content = file_of("mp4", "e", courses[:1], 8)
    with av.open(io.BytesIO(content)) as container:
        stream = container.streams.video[0]
        count = sum(1 for _ in container.decode(stream))
        assert count == len(timing.steps) + timing.held - 1 == courses[0].moves + 1 + 23
        assert (stream.width, stream.height) == courses[0].animation([], is_large=True).size
        assert stream.average_rate == 8


def test_long_and_fast_replays_leave_moves_out_and_show_the_last():
    class Long:
        moves = 1331

    timing = Timing.of([Long()])
    assert timing.steps[:3] == (0, 5, 10)
    assert timing.steps[-1] == 1331
    assert len(timing.steps) <= 301
    assert 14 < len(timing.steps) / timing.rate < 16
    assert Timing.of([Long()], speed=100).rate <= 25


def test_a_gif_of_a_large_board_has_fewer_pictures_in_the_same_time():
    episode = Episode.begin(EnvConfig.of("random", 84), seed=3)
    episode.step(1)
    courses = [course_of("A person", episode.record())]
    most = most_gif_pictures(courses)
    large = Timing.of([replace(courses[0], actions=bytes(1284))], most=most)
    assert len(large.steps) <= most + 1 == 126
    assert 14 < len(large.steps) / large.rate < 16


def test_the_preview_has_the_size_that_sites_show(courses, monkeypatch):
    drawn, draw = [], ImageDraw.ImageDraw.text
    monkeypatch.setattr(
        ImageDraw.ImageDraw,
        "text",
        lambda self, at, text, *rest, **more: (
            drawn.append(text),
            draw(self, at, text, *rest, **more),
        ),
    )
    with Image.open(io.BytesIO(file_of("png", "e", courses))) as picture:
        assert (picture.size, picture.format) == (PREVIEW, "PNG")
    assert " ".join(drawn).isascii(), "the font has glyphs for these"


def test_no_line_of_the_preview_reaches_the_edge(courses):
    wide = replace(courses[0], name="MMMM WWWWWW MMMM WWWWW")
    with Image.open(io.BytesIO(file_of("png", "e", [wide]))) as picture:
        margin = np.asarray(picture.convert("RGB"))[:, -36:]
    assert (margin == NIGHT).all()


def test_a_page_in_one_file_holds_every_module_and_asks_for_nothing(courses):
    text = file_of("html", "e<", courses).decode()
    data = json.loads(re.search(r'id="replay-data">(.*?)</script>', text, re.S)[1])
    assert [data["run"]["name"], data["ghost"]["name"]] == ["A person", "frontier-cost"]
    assert data["episode"] == "e<"
    imports = json.loads(re.search(r'type="importmap">(.*?)</script>', text, re.S)[1])["imports"]
    assert ENTRY in imports
    for name, script in modules(ENTRY, "mars").items():
        assert set(re.findall(r'from "([^"]+)"', script)) <= set(imports), name
    assert not re.search(r'(?:src|href)="(?!data:)', text)
    assert not set(re.findall(r"https?://[\w.]+", text)) - {"http://www.w3.org"}


def test_without_pyav_no_video_is_offered_and_the_error_names_the_extra(courses, monkeypatch):
    assert has_video()
    monkeypatch.setitem(sys.modules, "av", None)
    monkeypatch.setattr("humanplay.web.replays.files.find_spec", lambda name: None)
    assert "mp4" not in offered()
    with pytest.raises(VideoMissingError, match=r"pip install 'humanplay\[video\]'"):
        file_of("mp4", "e", courses)
