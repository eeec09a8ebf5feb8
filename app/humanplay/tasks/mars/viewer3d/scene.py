"""The 3-D scene of a board in one browser: soil, fog, rocks, rover and trail.

It is built from what the rover knows (`View.codes`, `View.path`) and nothing else, so it cannot show what is hidden.
Metres begin here: a cell is one metre, x = col, y = -row, z is up, so north is at the top and west at the left. The soil is
a fixed picture for each size; the fog over it is a small picture with alpha, which is sent again after each move and makes
unknown ground lie lower. With effects the sun casts shadows, dunes lie around the board, newly discovered cells rise and the
lidar sweeps; without them nothing costs more than the boards themselves.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image

from humanplay.tasks.mars.run import View
from humanplay.tasks.mars.viewer3d import models
from marsexplorer.config import ACTIONS, OBSTACLE, UNKNOWN

LARGE_SIDE = 21
"""A board with a side longer than this, in cells, is followed unless the browser asks for the whole map."""

SLOW_SIDE = 60
"""A board with a side longer than this, in cells, has more ground than a processor draws between two moves."""


Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Colours:
    """A theme's board colours (RGB), as in `static/common/base.css`.

    beyond  what is behind the board, below the horizon
    line    the share of a board's colour that its thin lines have
    fog     the palette of the fog, see `CLEAR` and the others
    """

    beyond: Colour
    soil: Colour
    rock: Colour
    dust: Colour
    glow: Colour
    player: Colour
    rival: Colour
    line: float
    fog: bytes


NIGHT = Colours(
    (14, 11, 13), (168, 98, 60), (220, 203, 184), (120, 70, 46), (255, 206, 158), (255, 179, 71), (95, 208, 197), 1.0,
    bytes([0, 0, 0, 255, 214, 150, 40, 24, 20, 84, 46, 28, 5, 3, 4, 40, 28, 26, 24, 17, 18, 12, 9, 11]),
)  # fmt: skip
DAY = Colours(
    (246, 239, 230), (184, 118, 76), (70, 50, 41), (226, 190, 156), (40, 34, 26), (255, 196, 77), (140, 234, 223), 0.4,
    bytes([0, 0, 0, 255, 255, 255, 60, 36, 24, 150, 92, 58, 170, 130, 104, 232, 214, 194, 241, 229, 215, 248, 242, 234]),
)  # fmt: skip


@dataclass(frozen=True)
class ViewOptions:
    """The wishes of one browser, as they stand in the query of its socket's address.

    camera          map: all of the board; follow: the rover and what is around it; None: by the size of the board
    has_effects     shadows, haze, movement between cells: for browsers that draw with a GPU
    is_light        the page's light theme: a board in daylight
    """

    camera: Literal["map", "follow"] | None = None
    has_effects: bool = False
    is_light: bool = False

    @property
    def colours(self) -> Colours:
        """Return the colours of the theme."""
        return DAY if self.is_light else NIGHT

    @classmethod
    def from_query(cls, query: Mapping[str, str]) -> ViewOptions:
        """Read `camera`, `effects` (on or off) and `theme` from a query; ignore the rest."""
        camera = query.get("camera")
        return cls(
            camera="map" if camera == "map" else "follow" if camera == "follow" else None,
            has_effects=query.get("effects") == "on",
            is_light=query.get("theme") == "light",
        )

    def follows(self, rows: int, cols: int) -> bool:
        """Return whether the camera follows the rover on a board of this size."""
        return self.camera == "follow" or (self.camera is None and max(rows, cols) > LARGE_SIDE)


CLEAR, EDGE, SHADE, CLIFF, SHADOW, NEAR, FAR, FARTHEST = range(8)
"""Of the fog: known ground, known cells beside unknown ones, the ground under rocks; then unknown ground, which lies lower:
the cliff down to it, the shadow on it, and its cells, the farther from known ones the deeper in dust."""
FOG_ALPHA = bytes([0, 46, 150, 255, 215, 190, 195, 200])
"""Opacities; the soil's relief, the same for every terrain of a size, shows through."""


def pixels_a_cell(side: int, pixels: int, most: int) -> int:
    """Return a cell's pixels, 1 to `most`, so that the longer side fits `pixels`."""
    return max(1, min(most, pixels // side))


def noise(
    rng: np.random.Generator, rows: int, cols: int, height: int, width: int
) -> NDArray[np.float64]:
    """Return smooth noise[height, width], 0 to 1, from rows x cols values."""
    coarse = Image.fromarray(rng.random([max(2, rows), max(2, cols)]).astype(np.float32))
    return np.asarray(coarse.resize((width, height), Image.Resampling.BICUBIC), np.float64)


@lru_cache(maxsize=16)
def soil(rows: int, cols: int, colour: Colour) -> bytes:
    """Return the ground as a JPEG, the same for every terrain of a size.

    It has ridges lit from the west, and a faint grid.
    """
    scale = pixels_a_cell(max(rows, cols), 768, 16)
    height, width = rows * scale, cols * scale
    rng = np.random.default_rng(rows * 1009 + cols)
    ground = np.zeros((height, width))
    for cells, weight in ((9.0, 0.5), (3.0, 0.3), (0.7, 0.2)):
        size = round(rows / cells), round(cols / cells)
        ground += weight * noise(rng, *size, height, width)
    down, across = np.gradient(ground)
    slope = across - 0.5 * down
    lit = 0.76 + 0.46 * ground + 0.07 * np.clip(slope / slope.std(), -2, 2)
    lines = (np.arange(height)[:, None] % scale == 0) | (np.arange(width)[None] % scale == 0)
    lit[lines] *= 0.86
    lit *= 1 + 0.05 * rng.standard_normal((height, width))
    drawn = np.clip(np.array(colour) * lit[..., None], 0, 255).astype(np.uint8)
    return encode(Image.fromarray(drawn), format="JPEG", quality=80)


@lru_cache(maxsize=2)
def sky(colours: Colours) -> NDArray[np.uint8]:
    """Return the sky as uint8[160, 256, 3]: dust lit by a low sun along the horizon."""
    down, across = np.mgrid[0:1:160j, 0:1:256j]
    dust = np.exp(-(((down - 0.05) / 0.16) ** 2))[..., None]
    away = np.hypot((across - 0.24) * 1.6, down - 0.07)
    glow = (0.5 * np.exp(-((away / 0.22) ** 2)) + 0.9 * np.exp(-((away / 0.025) ** 4)))[..., None]
    rng = np.random.default_rng(0)
    banks = 0.6 * noise(rng, 14, 4, 160, 256) + 0.4 * noise(rng, 34, 12, 160, 256)
    haze = np.clip(dust * 0.85 + 0.5 * (banks[..., None] - 0.3) * (1 - dust), 0, 1)
    beyond, hazed = np.array(colours.beyond), np.array(colours.dust)
    lit = beyond * (1 - haze) + hazed * haze + np.array(colours.glow) * glow
    picture: NDArray[np.uint8] = np.clip(lit, 0, 255).astype(np.uint8)
    return picture


def encode(image: Image.Image, format: str, **options: object) -> bytes:
    """Return an image as the bytes of a file."""
    file = io.BytesIO()
    image.save(file, format, **options)
    return file.getvalue()


def fog(codes: NDArray[np.uint8], colours: Colours) -> bytes:
    """Return the fog over codes[rows, cols] as a PNG with a palette and alpha.

    Unknown ground lies lower than known ground.
    """
    unknown = codes == UNKNOWN
    near, far = beside(~unknown), beside(beside(~unknown))
    depth = np.where(near, NEAR, np.where(far, FAR, FARTHEST))
    shade = np.where(codes == OBSTACLE, SHADE, np.where(beside(unknown), EDGE, CLEAR))
    scale = pixels_a_cell(max(codes.shape), 400, 4)
    picture = np.where(unknown, depth, shade).astype(np.uint8).repeat(scale, 0).repeat(scale, 1)
    if scale > 2:
        lower = unknown.repeat(scale, 0).repeat(scale, 1)
        for ahead in range(
            1, scale // 2 + 1
        ):  # the sun stands in the west, the camera in the south
            picture[:, ahead:][lower[:, ahead:] & ~lower[:, :-ahead]] = SHADOW
            picture[ahead:][lower[ahead:] & ~lower[:-ahead]] = CLIFF
    image = Image.fromarray(picture, "P")
    image.putpalette(colours.fog)
    return encode(image, format="PNG", transparency=FOG_ALPHA, compress_level=1)


def beside(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which cells are, or share a side with, one of cells[rows, cols]."""
    wide = np.pad(cells, 1)
    return np.asarray(cells | wide[:-2, 1:-1] | wide[2:, 1:-1] | wide[1:-1, :-2] | wide[1:-1, 2:])


ALARM = (255, 107, 87)
SUN = (255, 226, 196)

FACING_UP = (0.0, 1.0, 0.0, 0.0)
ITEMS_PER_NODE = 32
"""Rocks, and steps of a path, in one node of the scene: a move sends only the last one again."""
RISE = 0.4
"""How far below the ground newly discovered cells begin to rise, metres."""
SWEEP_WIDTH = float(np.deg2rad(70))
"""Of the sector that turns once around the rover while it moves, radians."""
CRASHES = ("collided", "out_of_bounds")


DEFAULT_OPTIONS = ViewOptions()


class Scene:
    """One browser's scene; call `show` after each move of an episode.

    Nodes stay and change where they can, so that only what changed is sent. (A node removed and added again under its
    name in one batch would keep its old place: viser sends the later of two messages about a name.)
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        episode: View,
        is_rival: bool,
        options: ViewOptions = DEFAULT_OPTIONS,
    ) -> None:
        self._scene, self._options = scene, options
        colours = options.colours
        mine, other = colours.player, colours.rival
        self._accent, self._other = (other, mine) if is_rival else (mine, other)
        self.episode = episode
        self._board, self._drawn = (0, 0), -1
        self.rover_waits = False
        self._target: NDArray[np.float64] = np.zeros(3)
        self._paired: View | None = None
        self._episode_nodes: list[viser.SceneNodeHandle] = []
        self._add_light()
        self._add_ground()
        self._rover = models.add_rover(scene, self._accent, options.has_effects)
        self._add_lidar_range(episode.config.sensor_radius)
        self._add_marks(episode.config.sensor_radius)
        self._begin(episode)
        self.show(episode)

    def show(self, episode: View) -> None:
        """Show the episode as it is; call `glide` after it if `rover_waits`."""
        if not _are_of_same_run(episode, self.episode):
            self._begin(episode)
        self.episode = episode
        if episode.steps == self._drawn:
            return
        self._fog._data = fog(episode.codes, self._options.colours)
        self._show_rocks(episode.codes)
        self._show_discovered(episode.codes)
        row, col = episode.position
        turn = np.pi / 2 * (1 - ACTIONS.index(episode.heading))
        target = np.array([col, -row, turn], np.float64)
        if self._options.has_effects:
            self.rover_waits = self._drawn >= 0 and episode.steps == self._drawn + 1
        else:  # a large board's ground takes the processor longer to draw than its rover
            self.rover_waits = self._drawn >= 0 and max(self._board) > SLOW_SIDE
        self._from, self._target = (self._target if self.rover_waits else target), target
        self._show_end(episode)
        self._show_trail(max(self._drawn, 0))
        self._drawn = episode.steps
        self.glide(0.0 if self.rover_waits else 1.0)

    @property
    def steps(self) -> int:
        """Return how many moves of the episode are drawn; -1 before the first picture."""
        return self._drawn

    @property
    def rover_place(self) -> tuple[float, float]:
        """Return where the rover is, (x, y) in metres; between two cells while it glides."""
        return self._place

    def glide(self, share: float) -> None:
        """Place the rover and new cells at `share`, 0 to 1, of the last move."""
        ahead = self._target - self._from
        ahead[2] = (ahead[2] + np.pi) % (2 * np.pi) - np.pi
        x, y, turn = self._from + share * ahead
        self._place = float(x), float(y)
        self._rover.position = (*self._place, 0.0)
        half, nod = turn / 2, 0.12 * self._has_crashed
        self._rover.wxyz = (
            float(np.cos(half) * np.cos(nod)), float(-np.sin(half) * np.sin(nod)),
            float(np.cos(half) * np.sin(nod)), float(np.sin(half) * np.cos(nod)),
        )  # fmt: skip
        if self._options.has_effects:
            self._found.position = (0.0, 0.0, 0.05 - RISE * (1 - share))
            self._found.visible = self._sweep.visible = share < 1
            self._sweep.position = (*self._place, 0.12)
            angle = np.pi * share
            self._sweep.wxyz = (float(np.cos(angle)), 0.0, 0.0, float(np.sin(angle)))

    def show_paired_path(self, paired: View | None) -> None:
        """Draw the paired board's path, dashed, under this board's; None removes it."""
        if not _are_of_same_run(paired, self._paired):
            for node in self._episode_nodes[:]:
                if node.name.startswith("/paired_path/"):
                    node.remove()
                    self._episode_nodes.remove(node)
            self._paired_steps = 0
        self._paired = paired
        if paired is None or paired.steps == self._paired_steps:
            return
        first = self._paired_steps // ITEMS_PER_NODE * ITEMS_PER_NODE
        for start in range(first, paired.steps, ITEMS_PER_NODE):
            corners, faces = models.dashes(paired.path[start : start + ITEMS_PER_NODE + 1])
            if len(faces):
                node = self._add_mark(f"/paired_path/{start}", corners, faces, self._other)
                self._add_episode_node(node)
        self._paired_steps = paired.steps

    def _begin(self, episode: View) -> None:
        """Remove the last episode's rocks and trail, and fit the ground to the new one."""
        for node in self._episode_nodes:
            node.remove()
        self._episode_nodes = []
        self._paired, self._paired_steps = None, 0
        self.episode = episode
        self._drawn = -1
        self._shown = np.zeros(episode.codes.shape, np.bool_)
        self._known = np.zeros(episode.codes.shape, np.bool_)
        self._open_rocks: list[list[tuple[int, int]]] = [[] for _ in models.ROCKS]
        self._rock_nodes = [0 for _ in models.ROCKS]
        self._target = np.zeros(3)
        if self._board != episode.codes.shape:
            self._resize_ground(episode.config.rows, episode.config.cols)

    def _add_light(self) -> None:
        """Light the scene by the sky and a low sun, and draw the sky behind the board."""
        self._scene.add_light_ambient("/sky", intensity=1.3)
        has_shadows, place = self._options.has_effects, (-30, -8, 34)
        self._scene.add_light_directional(
            "/sun", color=SUN, intensity=2.6, position=place, cast_shadow=has_shadows
        )
        self._scene.set_background_image(sky(self._options.colours), format="jpeg", jpeg_quality=90)

    def _add_ground(self) -> None:
        night = np.full((2, 2, 4), (*self._options.colours.beyond, 255), np.uint8)
        self._soil = self._add_picture("/soil", night[..., :3], "jpeg")
        self._fog = self._add_picture("/fog", night, "png")
        edges = np.zeros((4, 2, 3), np.float32)
        self._border = self._scene.add_line_segments(
            "/border", edges, colors=(150, 104, 78), thickness=1.5, thickness_units="screen"
        )

    def _add_picture(
        self, name: str, picture: NDArray[np.uint8], format: Literal["jpeg", "png"]
    ) -> viser.ImageHandle:
        """Lay a picture on the ground, without shadows."""
        return self._scene.add_image(
            name,
            picture,
            1,
            1,
            format=format,
            wxyz=FACING_UP,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _resize_ground(self, rows: int, cols: int) -> None:
        """Give soil, fog and border a size."""
        self._board = rows, cols
        self._soil._data = soil(rows, cols, self._options.colours.soil)
        for picture, height in ((self._soil, 0.0), (self._fog, 0.02)):
            picture.render_width, picture.render_height = float(cols), float(rows)
            picture.position = ((cols - 1) / 2, -(rows - 1) / 2, height)
        if self._options.has_effects:
            around = 0.5 * np.array([models.AROUND]) * (cols, rows)
            shade = self._scene.add_mesh_simple(
                "/shade",
                *models.flat(around, 0.0),
                opacity=0.0,
                receive_shadow=0.6,
                cast_shadow=False,
            )
            shade.position = ((cols - 1) / 2, (1 - rows) / 2, 0.04)
            beyond, soil_colour = (
                np.array(self._options.colours.beyond),
                np.array(self._options.colours.soil),
            )
            red, green, blue = (0.5 * beyond + 0.5 * soil_colour).astype(int).tolist()
            around_it = models.relief(rows, cols)
            self._scene.add_mesh_simple(
                "/around",
                *around_it,
                color=(red, green, blue),
                flat_shading=True,
                cast_shadow=False,
            )
        x, y = cols - 0.5, 0.5 - rows
        corners = np.array(
            [[-0.5, 0.5, 0.03], [x, 0.5, 0.03], [x, y, 0.03], [-0.5, y, 0.03]], np.float32
        )
        self._border.points = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)

    def _add_lidar_range(self, radius: int) -> None:
        """Draw the lidar's range, dashed, and a ring around the rover on small boards."""
        dashes, ring = models.circle(radius, 72, 0.06)[::2], models.circle(0.66, 24, 0.1)
        red, green, blue = (int(self._options.colours.line * channel) for channel in self._accent)
        for name, segments, thickness in (("reach", dashes, 2.0), ("ring", ring, 2.0)):
            self._scene.add_line_segments(
                f"/rover/{name}",
                segments,
                colors=(red, green, blue),
                thickness=thickness,
                thickness_units="screen",
            )

    def _add_marks(self, radius: int) -> None:
        """Add what is mostly hidden: a crash, rising cells, the lidar's sweep of a move."""
        self._crash = self._add_mark("/crash", *models.star(), ALARM, visible=False)
        if self._options.has_effects:
            square = models.squares(np.zeros((1, 2), np.int64))
            self._found = self._add_mark("/found", *square, self._accent, visible=False)
            self._found.opacity = 0.5
            sector = models.sector(radius, SWEEP_WIDTH, 12)
            self._sweep = self._add_mark("/sweep", *sector, self._accent, visible=False)
            self._sweep.opacity = 0.22

    def _add_mark(
        self,
        name: str,
        corners: models.Corners,
        faces: models.Faces,
        colour: tuple[int, int, int],
        visible: bool = True,
    ) -> viser.MeshHandle:
        """Add a flat, translucent mark on the ground and return its node."""
        return self._scene.add_mesh_simple(
            name,
            corners,
            faces,
            color=colour,
            visible=visible,
            side="double",
            flat_shading=True,
            opacity=0.85,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _show_rocks(self, codes: NDArray[np.uint8]) -> None:
        """Add new rocks to their shape's last node; begin another when it is full."""
        fresh = (codes == OBSTACLE) & ~self._shown
        if not fresh.any():
            return
        self._shown |= fresh
        cells = np.argwhere(fresh)
        shapes = models.shape_of(cells)
        if self.episode.config.level == "building":
            shapes[:] = models.WALL
        for shape in np.unique(shapes).tolist():
            self._open_rocks[shape] += [(int(row), int(col)) for row, col in cells[shapes == shape]]
            name, has_shadows = (
                f"/rocks/{shape}/{self._rock_nodes[shape]}",
                self._options.has_effects,
            )
            rocks = np.array(self._open_rocks[shape])
            colour = self._options.colours.rock
            node = models.add_rocks(self._scene, name, shape, rocks, colour, has_shadows)
            self._add_episode_node(node)
            if len(rocks) >= ITEMS_PER_NODE:
                self._open_rocks[shape], self._rock_nodes[shape] = [], self._rock_nodes[shape] + 1

    def _show_discovered(self, codes: NDArray[np.uint8]) -> None:
        """Put a bright square under each newly discovered cell, if there are effects.

        `glide` lets them rise.
        """
        is_known = codes != UNKNOWN
        fresh = np.argwhere(is_known & ~self._known & (codes != OBSTACLE))
        if self._options.has_effects and len(fresh):
            self._found.vertices, self._found.faces = models.squares(fresh)
        self._known = is_known

    def _show_end(self, episode: View) -> None:
        """Mark where the rover crashed, and tilt it; `glide` draws it so."""
        self._has_crashed = episode.outcome in CRASHES
        self._crash.visible = self._has_crashed
        if self._has_crashed:
            row, col = episode.position
            self._crash.position = (float(col), -float(row), 0.1)

    def _add_episode_node(self, node: viser.SceneNodeHandle) -> None:
        """Keep a node that is removed with the episode; it replaces its namesake."""
        others = [other for other in self._episode_nodes if other.name != node.name]
        self._episode_nodes = [*others, node]

    def _show_trail(self, since: int) -> None:
        """Draw the path from step `since` on, in chunks: a move sends only the last one."""
        path = self.episode.path
        for start in range(since // ITEMS_PER_NODE * ITEMS_PER_NODE, len(path) - 1, ITEMS_PER_NODE):
            cells = np.array(path[start : start + ITEMS_PER_NODE + 1], np.float32)
            places = [cells[:, 1], -cells[:, 0], np.full(len(cells), 0.08)]
            points = np.stack(places, axis=1).astype(np.float32)
            segments = np.stack([points[:-1], points[1:]], axis=1)
            trail = self._scene.add_line_segments(
                f"/trail/{start}",
                segments,
                colors=self._accent,
                thickness=0.26,
                thickness_units="world",
            )
            self._add_episode_node(trail)


def _are_of_same_run(one: View | None, other: View | None) -> bool:
    return one is other or (one is not None and other is not None and one.is_of_same_run(other))
