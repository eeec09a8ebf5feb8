"""Environments of other kinds than Gymnasium's, and the way to play them."""

MANY = "it steps many environments at once, and a person plays one: play(lambda: gymnasium.make(ID, render_mode='rgb_array'))"
AGENTS = "it has several agents, and Gymnasium's has one: let the others act in a wrapper, and play the class of that"
GYM = (
    "Gym is Gymnasium's predecessor: pip install 'shimmy[gym-v26]', and "
    "play(lambda: gymnasium.make('shimmy:GymV26Environment-v0', env_id=ID, make_kwargs={'render_mode': 'rgb_array'}))"
)
REFUSED = {
    "gymnasium.vector": MANY, "gymnasium.experimental.vector": MANY, "stable_baselines3.common.vec_env": MANY,
    "pettingzoo": AGENTS, "gym": GYM,
}  # fmt: skip
"""By the module of one of its classes: why an environment cannot be played, and the way out."""


def refusal_of(kind: type) -> str:
    """Why an environment of a class cannot be played, and the way out; else empty."""
    for base in kind.__mro__:
        for package, reason in REFUSED.items():
            if base.__module__ == package or base.__module__.startswith(f"{package}."):
                return f"{kind.__name__} cannot be played: {reason}"
    return ""
