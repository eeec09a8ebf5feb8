"""Maps in the format of map_server: read as terrains, written, or refused."""

import json
import math
import warnings

import gymnasium
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image

from marsexplorer.episode import Episode
from marsexplorer.evaluation.on_maps import evaluate_on_maps, to_json
from marsexplorer.maps import GridMap, MapFileError, MapWarning, read_map, write_map
from marsexplorer.regions import label_regions
from marsexplorer.world import cells_that_count
from tests.support import robot_maps

FIELDS = {
    "image": "hall.pgm", "resolution": 0.25, "origin": [-1.0, -2.0, 0.0], "negate": 0, "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}  # fmt: skip


def saved(tmp_path, pixels, **changes):
    """A map of float pixels [height, width] (0 occupied, 1 free) as a YAML file."""
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
    grid_map = read_map(saved(tmp_path, hall(), image=image), cell=0.5)
    assert grid_map.terrain.shape == (6, 10)
    assert np.argwhere(grid_map.terrain).tolist() == [[0, 1], [5, 9]]
    negated = read_map(saved(tmp_path, 1 - hall(), image=image, negate=1))
    assert (negated.terrain == grid_map.terrain).all()


def test_a_plain_pgm_is_read_too(tmp_path):
    path = saved(tmp_path, hall())
    values = " ".join(str(round(255 * value)) for value in hall().ravel())
    (tmp_path / "hall.pgm").write_text(f"P2\n20 12\n255\n{values}\n")
    assert np.argwhere(read_map(path).terrain).tolist() == [[0, 1], [5, 9]]


@pytest.mark.parametrize(
    ("cell", "inflation"), [(0.25, 0.0), (0.3, 0.0), (0.5, 0.3), (0.25, 0.5), (0.7, 0.2)]
)
def test_cells_and_inflation_are_those_of_the_definition(tmp_path, cell, inflation):
    pixels = np.ones((32, 48))
    pixels[0, 3], pixels[31, 46] = 0, 0.5
    terrain = read_map(saved(tmp_path, pixels), cell, inflation).terrain
    rows, cols = math.ceil(8 / cell - 1e-9), math.ceil(12 / cell - 1e-9)
    expected = np.zeros((rows, cols), bool)
    for row, col in np.ndindex(rows, cols):
        west, south = col * cell, (rows - 1 - row) * cell
        expected[row, col] = west + cell > 12 + 1e-9 or south + cell > 8 + 1e-9
        # the south-west corners of the two pixels that are not free
        for x, y in ((0.75, 7.75), (11.5, 0.0)):
            gap_x = max(0, west - x - 0.25, x - west - cell)
            gap_y = max(0, south - y - 0.25, y - south - cell)
            overlaps_x = west < x + 0.25 - 1e-9 and x < west + cell - 1e-9
            overlaps_y = south < y + 0.25 - 1e-9 and y < south + cell - 1e-9
            is_near = math.hypot(gap_x, gap_y) < inflation - 1e-6
            expected[row, col] |= (overlaps_x and overlaps_y) or is_near
    assert (terrain == expected).all()


def test_a_tilde_is_the_home_as_in_nav2(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    path = saved(tmp_path, hall())
    assert (read_map("~/hall.yaml").terrain == read_map(path).terrain).all()


def test_cells_and_metres_are_one_another(tmp_path):
    turned = GridMap(np.zeros((6, 10), bool), 0.5, (3.0, -1.0, 0.7), (0, 0))
    straight = read_map(saved(tmp_path, hall()))
    assert straight.to_metres((5, 0)) == (-0.75, -1.75)
    assert straight.to_cell(-0.9, -1.6) == (5, 0)
    for grid_map in (turned, straight):
        for cell in ((0, 0), (5, 9), (2, 7)):
            assert grid_map.to_cell(*grid_map.to_metres(cell)) == cell
        with pytest.raises(ValueError, match="lies off the map"):
            grid_map.to_cell(30.0, 30.0)


def test_the_start_is_the_one_given_or_the_free_cell_nearest_to_the_origin(tmp_path):
    path = saved(tmp_path, hall())
    assert read_map(path).start == (1, 1)  # of the four cells around (0, 0)
    chosen = read_map(path, start=(3.1, 0.9))
    assert chosen.cell == 0.25, "in larger cells too much is seen at once from there"
    assert chosen.start == chosen.to_cell(3.1, 0.9)
    with pytest.raises(MapFileError, match="lies in a blocked cell; the nearest free one is at"):
        read_map(path, 0.5, start=(-0.2, 0.8))
    with pytest.raises(MapFileError, match="lies off the map"):
        read_map(path, start=(99.0, 0.0))


def share_seen(grid_map):
    """The share of what counts that is known before the first move."""
    start = {"terrain": grid_map.terrain, "start": grid_map.start}
    return Episode.begin(grid_map.config(), **start).coverage


def share_reached(grid_map):
    """The share of the free cells that a rover can reach from the start."""
    labels = label_regions(~grid_map.terrain)
    return (labels == labels[grid_map.start]).sum() / (labels > 0).sum()


@pytest.mark.parametrize("kind", robot_maps.KINDS)
def test_a_robots_map_begins_where_there_is_something_to_explore(tmp_path, kind):
    pixels, origin = robot_maps.KINDS[kind]()
    grid_map = read_map(robot_maps.save(tmp_path, pixels, origin))
    assert share_seen(grid_map) <= 0.3
    assert share_reached(grid_map) >= (0.5 if kind != "race track" else 0.2)
    assert grid_map.cell in (0.5, 0.35), "the largest cells that keep it together"


def test_a_race_begins_on_the_track_although_its_outside_is_larger(tmp_path):
    pixels, origin = robot_maps.race_track()
    path = robot_maps.save(tmp_path, pixels, origin)
    for inflation in (0.0, 0.1):
        grid_map = read_map(path, inflation=inflation)
        x, y = grid_map.to_metres(grid_map.start)
        labels = label_regions(pixels == 1)
        track = labels[180, 240 - 175]
        assert (labels == track).sum() < (labels > 0).sum() / 3
        assert labels[359 - int((y - origin[1]) / 0.05), int((x - origin[0]) / 0.05)] == track


def test_a_map_begins_in_the_nearest_region_that_is_no_pocket(tmp_path):
    pixels = np.full((40, 40), 0.0)
    pixels[:-4, :] = 1
    pixels[18, 4:] = pixels[:, 20] = 0
    pixels[38, 1] = 1
    path = saved(tmp_path, pixels, resolution=0.5, origin=[0, 0, 0])
    assert read_map(path).start == (35, 0), "the cell at (38, 1) is nearer, and walled in"
    with pytest.warns(MapWarning, match=r"1 of 1,\d+ free cells can be reached, and 100%"):
        assert read_map(path, start=(0.75, 0.75)).start == (38, 1)


def test_cells_too_large_for_the_doors_are_refused_with_a_size_that_would_do(tmp_path):
    path = robot_maps.save(tmp_path, *robot_maps.offices())
    with pytest.raises(
        MapFileError, match=r"in cells of 1 m \d+ of \d+ free cells.*\(--cell 0\.5\)"
    ):
        read_map(path, cell=1.0)


def test_a_map_that_would_be_complete_at_once_is_refused(tmp_path):
    pixels = np.zeros((12, 12))
    pixels[5, 5] = 1
    with pytest.raises(
        MapFileError, match=r"1 of 1 free cell .* and 100% .*; give a map with more"
    ):
        read_map(saved(tmp_path, pixels, resolution=0.5))


@pytest.mark.parametrize("cell", [None, 0.25])
def test_a_start_on_a_map_without_a_free_cell_is_refused(tmp_path, cell):
    with pytest.raises(
        MapFileError, match=r"no cell of .* m is free; choose a smaller cell or less"
    ):
        read_map(saved(tmp_path, hall()), cell, inflation=5, start=(0, 0))


def test_a_map_is_cut_to_what_is_known(tmp_path):
    pixels = np.full((4000, 4000), robot_maps.UNKNOWN)
    pixels[1900:2100, 1900:2150] = 1
    grid_map = read_map(robot_maps.save(tmp_path, pixels, (-100.0, -100.0)))
    assert grid_map.terrain.shape == (22, 27)
    assert (~grid_map.terrain[1:-1, 1:-1]).all()
    assert grid_map.origin == (-5.5, -5.5, 0.0)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    cell=st.sampled_from([0.25, 0.3, 0.5, 0.6]),
    inflation=st.sampled_from([0.0, 0.2, 0.4]),
    yaw=st.sampled_from([0.0, 0.7, -2.0]),
)
def test_cutting_changes_no_cell(tmp_path_factory, seed, cell, inflation, yaw):
    """Each kept cell keeps its state and metres, and one ring of unknown ones is kept."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(30, 50, 2)
    pixels = np.full((height, width), robot_maps.UNKNOWN)
    top, left = rng.integers(0, 12, 2)
    bottom, right = height - rng.integers(0, 12), width - rng.integers(0, 12)
    pixels[top:bottom, left:right] = rng.random((bottom - top, right - left)) > 0.02
    origin = (-3.0, 4.0, yaw)
    rows, cols = (math.ceil(side * 0.25 / cell - 1e-9) for side in (height, width))
    whole = GridMap(np.ones((rows, cols), bool), cell, origin, (0, 0))
    is_known = np.zeros((rows, cols), bool)
    blocked_south, blocked_west = (np.array(at) * 0.25 for at in np.nonzero(pixels[::-1] != 1))
    for row, col in np.ndindex(rows, cols):
        south, west = (rows - 1 - row) * cell, col * cell
        if south + cell <= height * 0.25 + 1e-9 and west + cell <= width * 0.25 + 1e-9:
            gap_y = np.maximum(south - blocked_south - 0.25, blocked_south - south - cell)
            gap_x = np.maximum(west - blocked_west - 0.25, blocked_west - west - cell)
            overlaps = (gap_y < -1e-9) & (gap_x < -1e-9)
            near = np.hypot(gap_x.clip(0), gap_y.clip(0)) < inflation - 1e-9
            whole.terrain[row, col] = (overlaps | near).any()
        low, high = (int((south + shift) / 0.25) for shift in (1e-9, cell - 1e-9))
        first, last = (int((west + shift) / 0.25) for shift in (1e-9, cell - 1e-9))
        part = pixels[::-1][low : high + 1, first : last + 1]
        is_known[row, col] = (part != robot_maps.UNKNOWN).any()
    free = np.argwhere(~whole.terrain)
    assume(len(free))
    start = whole.to_metres(tuple(free[0]))
    path = saved(tmp_path_factory.mktemp("map"), pixels, origin=list(origin))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)
        cut = read_map(path, cell, inflation, start)
    corner = whole.to_cell(*cut.to_metres((0, 0)))
    assert cut.start == tuple(free[0] - corner)
    for position in np.ndindex(cut.terrain.shape):
        metres = cut.to_metres(position)
        before = (position[0] + corner[0], position[1] + corner[1])
        assert metres == pytest.approx(whole.to_metres(before), abs=1e-9)
        assert cut.to_cell(*metres) == position
        assert cut.terrain[position] == whole.terrain[before]
    box = [(int(at.min()), int(at.max())) for at in np.nonzero(is_known)]
    ends = [
        (max(low - 1, 0), min(high + 1, side - 1))
        for (low, high), side in zip(box, is_known.shape, strict=True)
    ]
    assert corner == (ends[0][0], ends[1][0])
    assert cut.terrain.shape == tuple(high - low + 1 for low, high in ends)


def test_a_written_map_is_read_as_it_was(tmp_path):
    terrain = np.random.default_rng(3).random((17, 21)) < 0.2
    terrain[2, 4] = False
    written = GridMap(terrain, 0.4, (np.float64(1.5), -2.5, 1e-05), (2, 4))
    write_map(written, tmp_path / "own.yaml")
    again = read_map(tmp_path / "own.yaml", cell=0.4, start=written.to_metres((2, 4)))
    assert (again.terrain == terrain).all()
    assert (again.cell, again.origin, again.start) == (0.4, written.origin, (2, 4))


@pytest.mark.parametrize("name", ["hall.pgm", "hall.PGM"])
def test_a_map_is_never_written_over_its_picture(tmp_path, name):
    with pytest.raises(ValueError, match=r"expected the name of a YAML file.*give .*hall\.yaml"):
        write_map(GridMap(np.zeros((5, 5), bool), 0.5, (0.0, 0.0, 0.0), (0, 0)), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"image": "[1]"}, "line 1: image: expected the picture's file"),
        (
            {"resolution": 0},
            "line 2: resolution: expected metres above 0, as in resolution: 0.05, got 0",
        ),
        ({"resolution": ".nan"}, "line 2: resolution: expected a number"),
        ({"resolution": "1:30"}, "expected a number, as in 0.05 or 5e-2, got '1:30'"),
        ({"resolution": "5cm"}, "expected a number, as in 0.05 or 5e-2, got '5cm'"),
        ({"origin": [0, 0]}, "line 3: origin: expected x, y and yaw"),
        ({"negate": "1.0"}, "line 4: negate: expected 0 or 1, true or false"),
        ({"occupied_thresh": None}, "occupied_thresh: expected a number.*no such line; add it"),
        ({"mode": "grey"}, "line 7: mode: expected one of trinary, scale, raw, got 'grey'"),
        ({"resolution": 0.01}, "no cell of 0.1 to 1 m gives 5 to 256 cells a side"),
    ],
)
def test_a_malformed_map_says_what_was_expected_in_which_line(tmp_path, changes, says):
    path = saved(tmp_path, hall(), **{**changes, "image": "hall.pgm"})
    if "image" in changes:
        path.write_text(path.read_text().replace("image: hall.pgm", f"image: {changes['image']}"))
    with pytest.raises(MapFileError, match=says):
        read_map(path)


def test_what_is_no_map_at_all_is_refused(tmp_path):
    path = saved(tmp_path, hall())
    (tmp_path / "hall.pgm").write_bytes(b"P5\n20 12\n255\nshort")
    with pytest.raises(MapFileError, match="no readable picture"):
        read_map(path)
    (tmp_path / "hall.pgm").write_bytes(b"no picture")
    with pytest.raises(MapFileError, match="save it as PGM or PNG"):
        read_map(path)
    (tmp_path / "hall.pgm").unlink()
    with pytest.raises(MapFileError, match="no readable picture: No such file"):
        read_map(path)
    for text in ("[1, 2", "just words", "x" * 200_000):
        path.write_text(text)
        with pytest.raises(MapFileError):
            read_map(path)
    with pytest.raises(MapFileError, match="no readable YAML file: No such file"):
        read_map(tmp_path / "absent.yaml")
    with pytest.raises(MapFileError, match="no pixel is free; check negate"):
        read_map(saved(tmp_path, np.zeros((12, 20))))
    with pytest.raises(MapFileError, match=r"no cell of 1\.5 m is free"):
        read_map(saved(tmp_path, np.indices((60, 60)).sum(axis=0) % 7 > 0), cell=1.5)
    with pytest.raises(MapFileError, match="cell must be at least a pixel"):
        read_map(saved(tmp_path, hall()), cell=0.1)


def test_the_environment_plays_a_map(tmp_path):
    path = saved(tmp_path, hall())
    grid_map = read_map(path)
    name, shape = "marsexplorer:MarsExplorer-v0", grid_map.terrain.shape
    env = gymnasium.make(name, level="map", size=shape, sensor_radius=2)
    for named in (path, str(path), grid_map):
        _, info = env.reset(options={"map": named})
        assert info["position"] == grid_map.start
        assert (env.unwrapped.terrain == grid_map.terrain).all()
    episode = Episode.begin(
        grid_map.config(sensor_radius=2), terrain=grid_map.terrain, start=grid_map.start
    )
    assert info["coverage"] == episode.coverage
    with pytest.raises(ValueError, match=r'level="map"'):
        gymnasium.make(name, size=(6, 10)).reset(options={"map": grid_map})
    sentence = r"the map has 6 x 10 cells: make the environment with size=\(6, 10\)"
    with pytest.raises(ValueError, match=sentence):
        gymnasium.make(name, level="map", size=21).reset(options={"map": grid_map})


def test_policies_are_compared_on_maps_by_what_can_be_discovered_from_their_starts():
    maps = {}
    for seed in (1, 2):
        terrain = np.random.default_rng(seed).random((11, 17)) < 0.25
        terrain[6:, 9:] = True  # solid: its inside cannot be seen
        terrain[4, 6] = False
        maps[f"hall{seed}"] = GridMap(terrain, 0.5, (0.0, 0.0, 0.0), (4, 6))
    played_maps = evaluate_on_maps(["frontier-cost", "frontier-utility"], maps)
    assert [played.name for played in played_maps] == ["hall1", "hall2"]
    for played in played_maps:
        cost, utility = played.results
        terrain = maps[played.name].terrain
        counted = cells_that_count(maps[played.name].config(), terrain, (4, 6))
        assert cost.cells == utility.cells == counted < terrain.size
        assert {result.outcome for result in played.results} == {"explored"}
        assert played.to_rule(cost) == cost.steps / min(cost.steps, utility.steps)
    document = json.loads(to_json(played_maps))
    assert [len(played["results"]) for played in document["maps"]] == [2, 2]
    assert document["maps"][0]["start"] == [4, 6]
