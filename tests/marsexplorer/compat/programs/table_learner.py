"""A learner with a table of values over positions, in the usual loop of agents."""

import random
from collections import defaultdict

from marsexplorer.compat import DEFAULT_CONFIG as conf  # noqa: N811
from marsexplorer.compat import make

random.seed(1)
conf["lidar_range"] = 4
env = make(conf, returns="gym")
inputs, actions = env.observation_space.shape, env.action_space.n
values = defaultdict(lambda: [0.0] * actions)
returns = []
for _ in range(30):
    state, place, total, done = env.reset(), (0, 0), 0.0, False
    visited = set()
    while not done:
        best = max(range(actions), key=values[place].__getitem__)
        action = random.randrange(actions) if random.random() < 0.2 else best
        state, reward, done, info = env.step(action)
        following = info.get("position", (0, 0))
        visited.add(following)
        wanted = reward + (0.0 if done else 0.9 * max(values[following]))
        values[place][action] += 0.5 * (wanted - values[place][action])
        place, total = following, total + reward
    returns.append(total)
print(
    f"inputs {inputs}: mean return {sum(returns) / len(returns):.1f}, {len(visited)} cells at last"
)
