"""The environment that the authors' code is: how it draws, scans, moves and pays.

    env = make(DEFAULT_CONFIG, returns="gym")

Below is what the authors' repository does, in the files named in brackets. How to use it is in
docs/from-mars-explorer.md.

**Terrain.** Cells are `(x, y)`, x from 0 to `size[0] - 1` and y from 0 to `size[1] - 1`. Nothing
checks that a terrain can be solved, or that the start is free [`randomMapGenerator.py`].

- **Without a lattice** (`number_rows` and `number_columns` are None): `obstacles` corners, y
  uniform from `margins[0]` to `size[1] - 2 - margins[0]`, x uniform from `margins[1]` to
  `size[0] - 2 - margins[1]`. From its corner each obstacle extends by a width along y and a height
  along x, both uniform from `obstacle_size[0]` to `obstacle_size[1]`.
- **With a lattice** (both are set): `number_rows` values of x, evenly spaced from `margins[0]` to
  `size[0] - 1 - margins[0]` with fractions cut off, and `number_columns` of y from `margins[1]`
  likewise; a corner at each crossing. Each corner moves along x by a whole number that is uniform
  from `-floor(noise[0])` to `ceil(noise[0]) - 1` (0 where that is 0 to -1), along y by `noise[1]`
  likewise, clipped to the grid. So noise 2 moves by -2, -1, 0 or 1. The width along y is uniform
  from 1 to `obstacle_size[1] - 1`, the height along x from 1 to `obstacle_size[0] - 1`: a size of
  2 is always one cell, one of 4 is up to three.

The corner itself is always blocked. Cells beyond the grid are clipped to its last row or column.

**Lidar.** It looks from the rover's cell along `lidar_channels` rays, ray k at k/`lidar_channels`
of a full turn, its direction `(cos, sin)` along (x, y) [`lidarSensor.py`].

- A line is 200 points, evenly spaced from the centre of the rover's cell to its end, both
  included. A point is rounded to a cell in each coordinate, halves to the even number, and
  clipped to the grid. So a ray that leaves the grid goes on along its edge.
- **Range.** Each ray's line is `lidar_range` long. The range is the smallest Euclidean distance
  from the rover's cell to a blocked cell of the line, `lidar_range` if none is blocked. If
  `lidar_range` is an integer (6, not 6.0), fractions of the distance are cut off. On a grid that
  is not square, both coordinates of a point are limited to the shorter side for this (not one
  less), before the cell is looked up.
- **Shown** are the cells of a second line along the ray, of the length range + 0.5, at most
  `lidar_range`. Blocked cells in between are no hindrance.

**What the rover knows.** Every cell is unknown (0) at first. A scan writes 0.3 for a shown free
cell and 1 for a shown blocked one; then 0.6 for the rover's cell, even a blocked start. This 0.6
stays behind until a later scan shows that cell. The observation is this matrix with the rover's
cell as 0.6 after a reset and, by preset, 0.5 or 0.6 after a move. Its shape is `(size[0],
size[1], 1)`. An episode begins at `initial` with a scan.

**A move.** Actions 0 to 3 add 1 to x, take 1 from x, add 1 to y, take 1 from y. A move off the
grid or into a blocked cell leaves the rover in place. After every move, valid or not, there is a
scan [`explorer.py`, `explorerConf.py`].

The reward is the number of newly known cells less `movementCost`. Then the first of these that
holds ends the episode, and its reward replaces that of the move:

1. more than `max_steps` moves were made, so 401 by default: the reward stays;
2. more than 95 or 99 % of all cells, by preset, are known: the reward is `bonus_reward`;
3. the move went into a blocked cell: the reward is `collision_reward`;
4. it went off the grid: the reward is `out_of_bounds_reward`.

The time limit too gives `done`, here `terminated`, never `truncated`. `exploConf-v1` has the
attributes that programs read: `conf`, `x`, `y`, `groundTruthMap`, `exploredMap`.
"""

from marsexplorer.compat.config import DEFAULT_CONFIG, PRESETS
from marsexplorer.compat.env import make

__all__ = ["DEFAULT_CONFIG", "PRESETS", "make"]
