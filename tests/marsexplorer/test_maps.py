"""Maps in the format of map_server: read as terrains, written, refused when they are malformed."""

import json
import math

import gymnasium
import numpy as np
import pytest
from PIL import Image

from marsexplorer.episode import Episode
from marsexplorer.evaluation.on_maps import evaluate_on_maps, to_json
from marsexplorer.maps import GridMap, MapFileError, read_map, write_map
from marsexplorer.world import cells_that_count

FIELDS = {
    "image": "hall.pgm", "resolution": 0.25, "origin": [-1.0, -2.0, 0.0], "negate": 0, "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}  # fmt: skip


def saved(tmp_path, pixels, **changes):
    """A map of float pixels [height, width] (0 occupied, 1 free) as a YAML file with these fields."""
    fields, shades = {**FIELDS, **changes}, np.round(255 * np.asarray(pixels)).astype(np.uint8)
    Image.fromarray(shades).save(tmp_path / fields["image"])
    path = tmp_path / "hall.yaml"
    lines = (f"{name}: {value}\n" for name, value in fields.items() if value is not None)
    path.write_text("".join(lines))
    return path


def hall():
    """12 x 20 pixels, free but for an occupied one and an unknown one."""
    pixels = np.ones((12, 20))
    pixels[0, 3], pixels[11, 18] = 0, 0.5
    return pixels


@pytest.mark.parametrize("image", ["hall.pgm", "hall.png"])
def test_a_cell_is_blocked_when_any_pixel_of_it_is_not_free(tmp_path, image):
    found = read_map(saved(tmp_path, hall(), image=image), cell=0.5)
    assert found.terrain.shape == (6, 10)
    assert np.argwhere(found.terrain).tolist() == [[0, 1], [5, 9]]
    negated = read_map(saved(tmp_path, 1 - hall(), image=image, negate=1))
    assert (negated.terrain == found.terrain).all()


def test_a_plain_pgm_is_read_too(tmp_path):
    path = saved(tmp_path, hall())
    values = " ".join(str(round(255 * value)) for value in hall().ravel())
    (tmp_path / "hall.pgm").write_text(f"P2\n20 12\n255\n{values}\n")
    assert np.argwhere(read_map(path).terrain).tolist() == [[0, 1], [5, 9]]


@pytest.mark.parametrize(
    ("cell", "inflation"), [(0.25, 0.0), (0.3, 0.0), (0.5, 0.3), (0.25, 0.5), (0.7, 0.2)]
)
def test_cells_and_inflation_are_those_of_the_definition(tmp_path, cell, inflation):
    found = read_map(saved(tmp_path, hall()), cell, inflation)
    rows, cols = math.ceil(3 / cell - 1e-9), math.ceil(5 / cell - 1e-9)
    expected = np.zeros((rows, cols), bool)
    for row, col in np.ndindex(rows, cols):
        west, south = col * cell, (rows - 1 - row) * cell
        expected[row, col] = west + cell > 5 + 1e-9 or south + cell > 3 + 1e-9
        # the south-west corners of the two pixels that are not free
        for x, y in ((0.75, 2.75), (4.5, 0.0)):
            gap_x = max(0, west - x - 0.25, x - west - cell)
            gap_y = max(0, south - y - 0.25, y - south - cell)
            overlaps_x = west < x + 0.25 - 1e-9 and x < west + cell - 1e-9
            overlaps_y = south < y + 0.25 - 1e-9 and y < south + cell - 1e-9
            is_near = math.hypot(gap_x, gap_y) < inflation - 1e-6
            expected[row, col] |= (overlaps_x and overlaps_y) or is_near
    assert (found.terrain == expected).all()


def test_cells_and_metres_are_one_another(tmp_path):
    turned = GridMap(np.zeros((6, 10), bool), 0.5, (3.0, -1.0, 0.7), (0, 0))
    straight = read_map(saved(tmp_path, hall()))
    assert straight.to_metres((5, 0)) == (-0.75, -1.75)
    assert straight.to_cell(-0.9, -1.6) == (5, 0)
    for found in (turned, straight):
        for cell in ((0, 0), (5, 9), (2, 7)):
            assert found.to_cell(*found.to_metres(cell)) == cell
        with pytest.raises(ValueError, match="lies off the map"):
            found.to_cell(30.0, 30.0)


def test_the_start_is_the_one_given_or_the_free_cell_nearest_to_the_origin(tmp_path):
    path = saved(tmp_path, hall())
    assert read_map(path).start == (1, 1)  # of the four cells around (0, 0)
    assert read_map(path, start=(3.1, 0.9)).start == (0, 8)
    with pytest.raises(MapFileError, match="lies in a blocked cell; the nearest free one is at"):
        read_map(path, start=(-0.2, 0.8))
    with pytest.raises(MapFileError, match="lies off the map"):
        read_map(path, start=(99.0, 0.0))


def test_a_written_map_is_read_as_it_was(tmp_path):
    terrain = np.random.default_rng(3).random((7, 11)) < 0.3
    terrain[2, 4] = False
    found = GridMap(terrain, 0.4, (np.float64(1.5), -2.5, 1e-05), (2, 4))
    write_map(found, tmp_path / "own.yaml")
    again = read_map(tmp_path / "own.yaml", cell=0.4, start=found.to_metres((2, 4)))
    assert (again.terrain == terrain).all()
    assert (again.cell, again.origin, again.start) == (0.4, found.origin, (2, 4))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"image": "[1]"}, "image must name the picture"),
        ({"resolution": 0}, "resolution must be a number from 0.0001 to 1000, got 0"),
        ({"resolution": ".nan"}, "resolution must be a number"),
        ({"origin": [0, 0]}, r"origin must be \[x, y, yaw\]"),
        ({"free_thresh": 0.9}, "free_thresh must not exceed occupied_thresh"),
        ({"occupied_thresh": None}, "occupied_thresh must be a number from 0 to 1, got None"),
        ({"mode": "raw"}, "mode must be trinary, got 'raw'"),
        ({"resolution": 0.01}, "a side must have 5 to 1024 cells, got 1x1"),
    ],
)
def test_a_malformed_map_says_what_was_expected(tmp_path, changes, says):
    path = saved(tmp_path, hall(), **{**changes, "image": "hall.pgm"})
    if "image" in changes:
        path.write_text(path.read_text().replace("image: hall.pgm", f"image: {changes['image']}"))
    with pytest.raises(MapFileError, match=says):
        read_map(path)


def test_what_is_no_map_at_all_is_refused(tmp_path):
    path = saved(tmp_path, hall())
    (tmp_path / "hall.pgm").write_bytes(b"P5\n20 12\n255\nshort")
    with pytest.raises(MapFileError, match="no readable PGM or PNG picture"):
        read_map(path)
    (tmp_path / "hall.pgm").unlink()
    with pytest.raises(MapFileError, match="no readable PGM or PNG picture"):
        read_map(path)
    for text in ("[1, 2", "just words", "x" * 200_000):
        path.write_text(text)
        with pytest.raises(MapFileError):
            read_map(path)
    with pytest.raises(MapFileError, match="no readable YAML file"):
        read_map(tmp_path / "absent.yaml")
    with pytest.raises(MapFileError, match=r"no cell of 0\.5 m is free"):
        read_map(saved(tmp_path, np.zeros((12, 20))))
    with pytest.raises(MapFileError, match="cell must be at least a pixel"):
        read_map(saved(tmp_path, hall()), cell=0.1)


def test_the_environment_plays_a_map(tmp_path):
    path = saved(tmp_path, hall())
    found = read_map(path)
    name, shape = "marsexplorer:MarsExplorer-v0", found.terrain.shape
    env = gymnasium.make(name, level="map", size=shape, sensor_radius=2)
    for given in (path, str(path), found):
        _, info = env.reset(options={"map": given})
        assert info["position"] == found.start
        assert (env.unwrapped.terrain == found.terrain).all()
    episode = Episode.begin(found.config(sensor_radius=2), terrain=found.terrain, start=found.start)
    assert info["coverage"] == episode.coverage
    with pytest.raises(ValueError, match=r'level="map"'):
        gymnasium.make(name, size=(6, 10)).reset(options={"map": found})
    said = r"the map has 6 x 10 cells: make the environment with size=\(6, 10\)"
    with pytest.raises(ValueError, match=said):
        gymnasium.make(name, level="map", size=21).reset(options={"map": found})


def test_policies_are_compared_on_maps_by_what_can_be_discovered_from_their_starts():
    maps = {}
    for seed in (1, 2):
        terrain = np.random.default_rng(seed).random((11, 17)) < 0.25
        terrain[6:, 9:] = True  # solid: its inside cannot be seen
        terrain[4, 6] = False
        maps[f"hall{seed}"] = GridMap(terrain, 0.5, (0.0, 0.0, 0.0), (4, 6))
    found = evaluate_on_maps(["frontier-cost", "frontier-utility"], maps)
    assert [each.name for each in found] == ["hall1", "hall2"]
    for each in found:
        cost, utility = each.results
        terrain = maps[each.name].terrain
        counted = cells_that_count(maps[each.name].config(), terrain, (4, 6))
        assert cost.cells == utility.cells == counted < terrain.size
        assert {result.outcome for result in each.results} == {"explored"}
        assert each.to_rule(cost) == cost.steps / min(cost.steps, utility.steps)
    document = json.loads(to_json(found))
    assert [len(each["results"]) for each in document["maps"]] == [2, 2]
    assert document["maps"][0]["start"] == [4, 6]
