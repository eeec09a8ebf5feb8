"""A random walk with pictures, as the authors' own test program has it."""

from marsexplorer.compat import DEFAULT_CONFIG as conf  # noqa: N811
from marsexplorer.compat import make

conf["size"] = [30, 30]
conf["obstacles"] = 20
conf["lidar_range"] = 4
conf["obstacle_size"] = [1, 3]
conf["viewer"]["night_color"] = (0, 0, 0)
conf["viewer"]["draw_lidar"] = True
conf["viewer"]["drone_img"] = "img/drone.png"

env = make(conf, returns="gym")
total = 0.0
observation = env.reset()
for _ in range(20):
    picture = env.render()
    observation, reward, done, info = env.step(env.action_space.sample())
    total += reward
    if done:
        observation = env.reset()
env.close()
print(f"return {total:.1f} of observations {observation.shape}, pictures {picture.shape}")
