"""Where obstacles stand on a level, counted over many resets."""

import numpy as np

from marsexplorer.compat import DEFAULT_CONFIG as conf  # noqa: N811
from marsexplorer.compat import make

conf["number_columns"] = conf["number_rows"] = 3
conf["noise"] = [3, 3]
conf["obstacle_size"] = [5, 5]
conf["viewer"]["night_color"] = (255, 255, 255)

env = make(conf, returns="gym")
counts = np.zeros(conf["size"])
for _ in range(30):
    env.reset()
    x, y = np.where(env.groundTruthMap == 1.0)
    counts[y, x] += 1
env.close()
print(f"{int(counts.sum())} blocked cells, at most {int(counts.max())} on one cell")
