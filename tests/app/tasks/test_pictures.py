"""What an environment draws is shown, or refused with the way out."""

import base64
import io
from contextlib import closing

import numpy as np
import pytest
from PIL import Image

from humanplay.task import Choice
from humanplay.tasks.gymnasium.description import Description
from humanplay.tasks.gymnasium.task import GymnasiumTask
from tests.support.command import command
from tests.support.shown import GREY, RGB


def described(way):
    return Description(id="tests.support.shown:Shown", kwargs={"way": way}).told


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        ("rgb", RGB),
        ("rgba", RGB),
        ("wide", RGB),
        ("list", RGB),
        ("nested", RGB),
        ("grey", np.dstack([GREY] * 3)),
        ("grey channel", np.dstack([GREY] * 3)),
        ("mask", np.dstack([255 * (GREY > 50)] * 3)),
        ("figure", np.full((1, 2, 3), (255, 0, 0))),
        ("closed figure", np.full((1, 2, 3), (255, 0, 0))),
    ],
)
def test_a_board_shows_it(way, expected):
    with closing(GymnasiumTask(described(way))) as task:
        picture = task.begin(Choice(task.default, 1)).view().picture
    shown = Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2])))
    assert np.asarray(shown).tolist() == expected.tolist()


@pytest.mark.parametrize("words", [("serve", "--port", 0, "--env"), ("doctor",)])
@pytest.mark.parametrize(
    ("way", "came", "way_out"),
    [
        ("float", "float64 (2 x 3 x 3) from 0 to 0.0666667", "(255 * picture).astype(np.uint8)"),
        ("negative", "int64 (2 x 3 x 3) from -1 to 16", ""),
        ("channels first", "uint8 (3 x 5 x 6) from 0 to 0", "its channels come first"),
        ("nothing", "nothing", "where it is made with render_mode='rgb_array'"),
        ("one number", "int64 (a single value) from 3 to 3", ""),
    ],
)
def test_it_is_refused_before_the_page_opens(
    words, way, came, way_out, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shown.toml").write_text(f'id = "tests.support.shown:Shown"\nkwargs.way = "{way}"')
    code, out, err = command(capsys, *words, "shown.toml")
    err = " ".join(err.split())
    assert (code in (1, 2), out) == (True, "")
    assert f"render returned {came}: expected a picture (uint8, rows x columns x 3)" in err, err
    assert way_out in err, err
