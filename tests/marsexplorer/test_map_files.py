"""What a map file says of each pixel, by modes, thresholds and numbers of Nav2."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from marsexplorer.map_files import MapFileError, MapWarning, read_occupancy

GREYS = np.arange(256, dtype=np.uint8).reshape(16, 16)
LINES = {
    "image": "m.png", "resolution": "0.05", "origin": "[0, 0, 0]", "negate": "0",
    "occupied_thresh": "0.65", "free_thresh": "0.196",
}  # fmt: skip


def map_file(folder, picture=GREYS, **changes):
    """A map file of lines and a picture: an array, a Pillow image, or bytes."""
    lines = {**LINES, **changes}
    if isinstance(picture, bytes):
        (folder / lines["image"]).write_bytes(picture)
    else:
        image = Image.fromarray(picture) if isinstance(picture, np.ndarray) else picture
        image.save(folder / lines["image"])
    path = folder / "m.yaml"
    path.write_text(
        "".join(f"{name}: {text}\n" for name, text in lines.items() if text is not None)
    )
    return path


def occupancy(grey, mode, free, occupied, negate):
    """The definition, one pixel at a time, in single precision as Nav2 has it."""
    if mode == "raw":
        return grey if grey <= 100 else -1
    share = np.float32(grey) / np.float32(255)
    darkness = share if negate else np.float32(1) - share
    if darkness <= np.float32(free):
        return 0
    if darkness >= np.float32(occupied):
        return 100
    if mode == "trinary":
        return -1
    return math.floor((darkness - np.float32(free)) / np.float32(occupied - free) * 100 + 0.5)


@pytest.mark.parametrize("mode", [None, "trinary", "Scale", "RAW"])
@pytest.mark.parametrize("negate", ["0", "true"])
@pytest.mark.parametrize(
    ("free", "occupied"), [(0.196, 0.65), (0.2, 0.8), (0.05, 0.95), (0.6, 0.4)]
)
def test_modes_and_thresholds_mean_what_they_mean_in_nav2(tmp_path, mode, negate, free, occupied):
    thresholds = {"free_thresh": str(free), "occupied_thresh": str(occupied)}
    path = map_file(tmp_path, mode=mode, negate=negate, **thresholds)
    name = (mode or "trinary").lower()
    if name != "raw" and occupancy(205, name, free, occupied, negate == "true") == 0:
        with pytest.warns(MapWarning, match="makes the 0% of the pixels free that have grey 205"):
            cells = read_occupancy(path).cells
    else:
        cells = read_occupancy(path).cells
    expected = [occupancy(grey, name, free, occupied, negate == "true") for grey in range(256)]
    assert cells.reshape(-1).tolist() == expected


THRESHOLDS = st.integers(0, 100).map(lambda percent: percent / 100)
NOTATIONS = ("{:.2f}", "{:e}", "{:.3E}", "+{}", "'{}'", '"{:.2f}"', "!!str {}")
"""Ways to write a number that yaml-cpp reads as one."""
PIXELS = st.lists(
    st.tuples(st.integers(0, 255), st.sampled_from([255, 255, 254, 1, 0])), min_size=1
)
"""Greys, and how opaque they are."""


def picture_of(pixels, kind):
    """A row of pixels as a file's name and its bytes or picture."""
    greys = np.array([[grey for grey, _ in pixels]], np.uint8)
    if kind == "plain":
        return "m.pgm", f"P2 {greys.size} 1 255 {' '.join(map(str, greys[0]))}".encode()
    if kind == "deep":
        deep = greys.astype(">u2") * 257 + 128 * (greys < 255)
        return "m.pgm", b"P5 %d 1 65535\n" % greys.size + deep.astype(">u2").tobytes()
    if kind == "alpha":
        alphas = np.array([[alpha for _, alpha in pixels]], np.uint8)
        return "m.png", Image.fromarray(np.dstack([greys, greys, greys, alphas]))
    return f"m.{kind}", greys


@settings(deadline=None)
@given(
    pixels=PIXELS,
    kind=st.sampled_from(["pgm", "plain", "deep", "png", "bmp", "tif", "alpha"]),
    mode=st.sampled_from(["trinary", "Trinary", "scale", "SCALE", "raw", "'raw'"]),
    negate=st.sampled_from(["0", "1", "-1", "0x0", "0xF", "true", "False", "yes", "OFF"]),
    free=THRESHOLDS,
    occupied=THRESHOLDS,
    notations=st.tuples(*2 * [st.sampled_from(NOTATIONS)]),
)
def test_a_drawn_map_file_means_what_it_means_in_nav2(
    tmp_path_factory, pixels, kind, mode, negate, free, occupied, notations
):
    name, picture = picture_of(pixels, kind)
    written = [way.format(number) for way, number in zip(notations, (free, occupied), strict=True)]
    path = map_file(
        tmp_path_factory.mktemp("map"),
        picture,
        image=name,
        mode=mode,
        negate=negate,
        free_thresh=written[0],
        occupied_thresh=written[1],
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)
        cells = read_occupancy(path).cells
    is_negated = negate not in ("0", "0x0", "False", "OFF")
    plain = mode.strip("'").lower()
    expected = [
        -1
        if kind == "alpha" and plain != "raw" and alpha < 255
        else occupancy(grey, plain, free, occupied, is_negated)
        for grey, alpha in pixels
    ]
    assert cells.tolist() == [expected]


@pytest.mark.parametrize(
    ("written", "number"),
    [
        ("0.05", 0.05),
        ("5e-2", 0.05),
        ("5E-2", 0.05),
        (".5", 0.5),
        ("1", 1.0),
        ("1.", 1.0),
        ("'0.05'", 0.05),
        ("+0.5", 0.5),
    ],
)
def test_numbers_are_read_in_all_ways_that_they_are_written(tmp_path, written, number):
    path = map_file(
        tmp_path,
        resolution=written,
        origin=f"[-{written.strip('+')}, 1e1, {written}]" if written[0] != "'" else None,
    )
    if written[0] == "'":
        path.write_text(path.read_text() + f"origin:\n- -{number}\n- {written}\n- 0\n")
        assert read_occupancy(path).origin == (-number, number, 0.0)
    else:
        assert read_occupancy(path).origin == (-number, 10.0, number)
    assert read_occupancy(path).resolution == number


@pytest.mark.parametrize(
    ("written", "is_negated"),
    [
        ("0", False),
        ("1", True),
        ("2", True),
        ("0x0", False),
        ("no", False),
        ("True", True),
        ("on", True),
    ],
)
def test_negate_is_a_number_or_a_word(tmp_path, written, is_negated):
    cells = read_occupancy(map_file(tmp_path, negate=written)).cells.reshape(-1)
    assert (cells[0], cells[255]) == ((0, 100) if is_negated else (100, 0))


def test_the_first_of_two_lines_and_of_two_documents_counts(tmp_path):
    path = map_file(tmp_path)
    path.write_text(path.read_text() + "resolution: 7\nmap_type: occupancy\n---\nresolution: 8\n")
    assert read_occupancy(path).resolution == 0.05


DEEP = np.minimum(GREYS.astype(np.uint32) * 257 + 128, 65535)
PICTURES = {
    "pgm of 16 bits": ("m.pgm", b"P5\n16 16\n65535\n" + DEEP.astype(">u2").tobytes()),
    "pgm in words": ("m.pgm", b"P2\n16 16\n255\n" + " ".join(map(str, range(256))).encode()),
    "png of 16 bits": ("m.png", DEEP.astype(np.uint16)),
    "png in colour": ("m.png", np.repeat(GREYS[..., None], 3, axis=2)),
    "bmp": ("m.bmp", GREYS),
    "tiff": ("m.tif", GREYS),
    "tga": ("m.tga", GREYS),
    "gif": ("m.gif", GREYS),
    "pcx": ("m.pcx", GREYS),
    "palette": ("m.png", Image.fromarray(GREYS).convert("P")),
}


@pytest.mark.parametrize("kind", PICTURES)
def test_pictures_of_all_usual_kinds_are_read(tmp_path, kind):
    name, picture = PICTURES[kind]
    cells = read_occupancy(map_file(tmp_path, picture, image=name, mode="raw")).cells
    assert cells.reshape(-1).tolist() == [grey if grey <= 100 else -1 for grey in range(256)]


def test_a_jpeg_and_a_picture_of_one_bit_are_read(tmp_path):
    room = np.full((32, 32), 254, np.uint8)
    room[:8] = 0
    for name, picture in (("m.jpg", room), ("m.pbm", Image.fromarray(room).convert("1"))):
        cells = read_occupancy(map_file(tmp_path, picture, image=name)).cells
        assert ((cells == 0) == (room == 254)).all(), name


def test_colours_count_by_how_bright_they_look(tmp_path):
    red, green, blue = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    picture = np.array([[red, green, blue]], np.uint8)
    cells = read_occupancy(
        map_file(tmp_path, picture, mode="scale", free_thresh="0", occupied_thresh="0.98")
    ).cells
    assert cells.tolist() == [[72, 42, 90]]  # of greys 76, 149 and 29


def test_what_is_not_opaque_is_unknown_but_in_raw(tmp_path):
    picture = np.dstack([np.full((8, 8), 254, np.uint8)] * 3 + [np.full((8, 8), 255, np.uint8)])
    picture[0, 0, 3], picture[0, 1, 3] = 0, 254
    for mode in ("trinary", "scale"):
        cells = read_occupancy(map_file(tmp_path, picture, mode=mode)).cells
        assert (cells[0, :3].tolist(), set(cells[1:].ravel())) == ([-1, -1, 0], {0})
    picture[..., :3] = 50
    assert (read_occupancy(map_file(tmp_path, picture, mode="raw")).cells == 50).all()


def test_a_picture_that_is_not_read_names_those_that_are(tmp_path):
    with pytest.raises(
        MapFileError, match=r"m\.png is no picture that is read; save it as PGM or PNG"
    ):
        read_occupancy(map_file(tmp_path, b"/* XPM */ static char *m[] = {}"))
    fractions = Image.fromarray(np.zeros((8, 8), np.float32))
    with pytest.raises(MapFileError, match="expected 8 or 16 bits a colour, got fractions"):
        read_occupancy(map_file(tmp_path, fractions, image="m.tif"))
    with pytest.raises(MapFileError, match=r"at most 64,000,000 pixels are read, got 9000 x 9000"):
        read_occupancy(map_file(tmp_path, b"P5\n9000 9000\n255\n", image="m.pgm"))
    with pytest.raises(MapFileError, match=r"at most 64,000,000 pixels .* cut the map"):
        read_occupancy(map_file(tmp_path, b"P5\n20000 20000\n255\n", image="m.pgm"))


def test_thresholds_that_make_unknown_pixels_free_are_warned_of(tmp_path):
    picture = np.full((10, 10), 254, np.uint8)
    picture[:2] = 205
    path = map_file(tmp_path, picture, free_thresh="0.25")
    with pytest.warns(MapWarning, match="free_thresh 0.25 makes the 20% of the pixels free.*0.196"):
        assert (read_occupancy(path).cells == 0).all()


def test_a_mask_of_speeds_is_no_map_of_rooms(tmp_path):
    path = map_file(tmp_path, mode="scale", free_thresh="0.0", occupied_thresh="1.0")
    with pytest.warns(MapWarning, match="looks like a mask of speeds, not a map of rooms"):
        read_occupancy(path)
