"""`python docs/make_pictures.py`: draw pictures of docs/environment.md and docs/results.md from the environment itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode

FOLDER = Path(__file__).parent / "pictures"
COLOURS = np.array([(14, 11, 13), (168, 98, 60), (255, 179, 71), (220, 203, 184)], np.uint8)
"""RGB of the codes: unknown, free, the rover's cell, obstacle; the colours of the playground."""
PAPER, INK = (255, 255, 255), (60, 50, 46)
MARGIN, CAPTION = 12, 22


def picture_of(
    codes: NDArray[np.uint8], path: Sequence[tuple[int, int]] = (), cell: int = 10
) -> Image.Image:
    """Return codes[rows, cols] as a picture with `cell` pixels a cell, faint lines between cells, and the path driven."""
    pixels = COLOURS[codes].repeat(cell, 0).repeat(cell, 1)
    pixels[::cell] = (pixels[::cell] * 0.86).astype(np.uint8)
    pixels[:, ::cell] = (pixels[:, ::cell] * 0.86).astype(np.uint8)
    image = Image.fromarray(pixels)
    if len(path) > 1:
        middles = [((col + 0.5) * cell, (row + 0.5) * cell) for row, col in path]
        ImageDraw.Draw(image).line(
            middles, fill=(255, 179, 71), width=max(2, cell // 4), joint="curve"
        )
    return image


def side_by_side(pictures: Sequence[tuple[str, Image.Image]], columns: int) -> Image.Image:
    """Return captioned pictures of one size on a canvas, `columns` a line."""
    width, height = pictures[0][1].size
    lines = -(-len(pictures) // columns)
    canvas = Image.new(
        "RGB",
        (columns * (width + MARGIN) + MARGIN, lines * (height + CAPTION + MARGIN) + MARGIN),
        PAPER,
    )
    draw = ImageDraw.Draw(canvas)
    for number, (caption, picture) in enumerate(pictures):
        line, column = divmod(number, columns)
        x, y = MARGIN + column * (width + MARGIN), MARGIN + line * (height + CAPTION + MARGIN)
        draw.text((x, y + 2), caption, fill=INK, font_size=14)
        canvas.paste(picture, (x, y + CAPTION))
    return canvas


def episode_in_four_moments() -> Image.Image:
    """Return how `ppo` explores the terrain of seed 7: what it knows at the start, twice on the way, and at the end."""
    episode, policy = Episode.begin(EnvConfig.of("random", 21), seed=7), policies.load("ppo")
    policy.reset(0)
    moments = []
    while True:
        if episode.steps in (0, 15, 40) or episode.ended:
            caption = f"move {episode.steps}: {episode.coverage:.0%} mapped"
            moments.append((caption, picture_of(episode.codes, episode.path, 12)))
        if episode.ended:
            return side_by_side(moments, 4)
        episode.step(policy.act(episode.codes))


def levels() -> Image.Image:
    """Return a terrain of each kind of level: seed 3 at 21x21."""
    names = ("random", "1-1-1", "2-1-1", "3-1-1", "1-2-1", "2-2-1", "3-2-1")
    pictures = []
    for name in names:
        episode = Episode.begin(EnvConfig.of(name, 21), seed=3)
        codes = np.where(episode.terrain, 3, 1).astype(np.uint8)
        codes[episode.position] = 2
        pictures.append((name, picture_of(codes, cell=9)))
    return side_by_side(pictures, 7)


def lidar() -> Image.Image:
    """Return one scan beside the terrain that it was made on: what stands behind a rock stays unknown."""
    terrain = np.zeros((13, 17), bool)
    terrain[2:4, 9:12] = terrain[5:7, 3:5] = terrain[9:11, 10:12] = terrain[8, 6] = True
    episode = Episode.begin(EnvConfig.of("random", (13, 17)), terrain=terrain, start=(6, 8))
    whole = np.where(terrain, 3, 1).astype(np.uint8)
    whole[episode.position] = 2
    return side_by_side(
        [
            ("the terrain", picture_of(whole, cell=16)),
            ("what the lidar shows", picture_of(episode.codes, cell=16)),
        ],
        2,
    )


def building_and_cave() -> Image.Image:
    """Return a building and a cave as `frontier-priced` has mapped them at the end, with its course."""
    pictures = []
    for level in ("building", "cave"):
        episode, policy = (
            Episode.begin(EnvConfig.of(level, 42), seed=1_000_000_000),
            policies.load("frontier-priced"),
        )
        policy.reset(0)
        while not episode.ended:
            episode.step(policy.act(episode.codes))
        pictures.append(
            (f"{level}: {episode.steps} moves", picture_of(episode.codes, episode.path, 9))
        )
    return side_by_side(pictures, 2)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    drawings = {
        "episode": episode_in_four_moments,
        "levels": levels,
        "lidar": lidar,
        "building_and_cave": building_and_cave,
    }
    for name, draw in drawings.items():
        draw().save(FOLDER / f"{name}.png", optimize=True)
        print(f"docs/pictures/{name}.png")
