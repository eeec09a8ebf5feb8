"""Clone the people of a released study: behaviour cloning (Pomerleau 1991).

    pip install '.[play,train,export]'
    python examples/clone.py dunes-1 --out dunes-clone.onnx
    humanplay serve --policy dunes-clone.onnx

The release's tables of episodes and steps are read, each episode is played again, and the network
of `marsexplorer train` is fitted to the moves made. A fifth of the ranked terrains trains nothing:
there its agreement with the players is measured, beside that of other policies.
"""

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch.nn.functional import cross_entropy

from marsexplorer import policies
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode, Record
from marsexplorer.evaluation.episodes import Agreement, agreement_with
from marsexplorer.policies.base import Memory
from marsexplorer.policies.network.features import RememberedFeatures
from marsexplorer.training.network import TRANSPOSED, Net, save_network

COMPARED = ("ppo", "frontier-cost", "frontier-utility")
HELD_OUT = 0.2
CODES = {name: code for code, name in enumerate(ACTIONS)}


def read_records(release: Path, kind: str) -> list[tuple[str, int | None, Record]]:
    """(participant, ranked terrain or None, record) of a release's finished episodes.

    kind  "human", or "script" for synthetic players
    """
    episodes = pd.read_parquet(release / "parquet" / "episodes.parquet")
    steps = pd.read_parquet(release / "parquet" / "steps.parquet").sort_values("step")
    actions = {episode: rows.action for episode, rows in steps.groupby("episode")}
    finished = episodes[(episodes.driver == kind) & (episodes.outcome != "abandoned")]
    records = []
    for row in finished[finished.phase.isin(["warm_up", "ranked"])].itertuples():
        config = EnvConfig(
            row.level, row.rows, row.cols, row.sensor_radius, row.beta, row.max_steps
        )
        start = (row.start_row, row.start_col)
        packed = bytes.fromhex(row.terrain.removeprefix("x"))
        bits = np.unpackbits(np.frombuffer(packed, np.uint8))
        terrain = bits[: config.n].reshape(config.rows, config.cols).astype(bool)
        episode = Episode.begin(config, terrain=terrain, start=start)
        for action in actions.get(row.episode, ()):
            episode.step(CODES[action])
        index = row.terrain_index if row.phase == "ranked" else None
        records.append((row.participant, index, episode.record()))
    return records


def demonstrations_of(records: list[Record]) -> tuple[torch.Tensor, ...]:
    """Every valid move: planes uint8[num, ...], moves float32[num, 4, ...], actions.

    Actions are int64[num].
    """
    planes, moves, actions = [], [], []
    for record in records:
        episode = Episode.begin(record.config, terrain=record.terrain_map(), start=record.start)
        memory, extract = Memory(), RememberedFeatures(record.config.sensor_radius)
        for action in record.actions:
            memory.observe(episode.codes)
            own_planes, own_moves = extract(memory)
            if own_moves[0, action, 0] > 0:
                planes.append(own_planes[0].copy())
                moves.append(own_moves[0].copy())
                actions.append(action)
            episode.step(action)
    return tuple(torch.from_numpy(np.array(column)) for column in (planes, moves, actions))


def fit(net: Net, demonstrations: tuple[torch.Tensor, ...], epochs: int, seed: int) -> None:
    """Fit the network by AdamW; every second step sees rows and columns exchanged."""
    rng, done = np.random.default_rng(seed), 0
    optimizer = torch.optim.AdamW(net.parameters(), weight_decay=0.1)
    count = len(demonstrations[2])
    batches = -(-count // 256)
    for _ in range(epochs):
        for batch in np.array_split(rng.permutation(count), batches):
            optimizer.param_groups[0]["lr"] = 1e-3 * (1 - done / (batches * epochs))
            planes, moves, actions = (part[batch] for part in demonstrations)
            if done % 2:
                planes, moves, actions = planes[:, :, TRANSPOSED], moves.flip(1), 3 - actions
            optimizer.zero_grad()
            cross_entropy(net.train()(planes, moves)[0], actions).backward()
            optimizer.step()
            done += 1
    net.eval()


def agreement_on(held_out: dict[str, list[Record]], policy: policies.Policy) -> float:
    """The share of the players' moves that a policy would make, averaged by player."""
    shares = []
    for records in held_out.values():
        shares.append(
            sum((agreement_with(policy, record) for record in records), Agreement()).share
        )
    return float(np.mean(shares))


def main() -> None:
    """Read a release, fit and write a network, and compare its moves with players."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("release", type=Path, help="folder that `humanplay release` wrote")
    parser.add_argument("--out", type=Path, default=Path("clone.onnx"))
    parser.add_argument("--epochs", type=int, default=12, help="passes over the moves")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--synthetic", action="store_true", help="train on its scripts instead")
    options = parser.parse_args()

    who = "scripts (SYNTHETIC)" if options.synthetic else "people"
    records = read_records(options.release, "script" if options.synthetic else "human")
    ranked = sorted({index for _, index, _ in records if index is not None})
    drawn = np.random.default_rng(options.seed).permutation(ranked)
    held = set(drawn[: max(1, round(HELD_OUT * len(ranked)))])
    trained, held_out = (
        [record for _, index, record in records if index not in held],
        defaultdict(list),
    )
    for participant, index, record in records:
        if index in held:
            held_out[participant].append(record)
    if not trained or not held_out:
        raise SystemExit(
            f"{options.release} has no finished ranked episodes of {who} on two terrains"
        )

    torch.manual_seed(options.seed)
    torch.set_num_threads(1)
    net, config = Net(), trained[0].config
    demonstrations = demonstrations_of(trained)
    fit(net, demonstrations, options.epochs, options.seed)
    summary = (
        f"A clone of the {who} of {options.release.name}, from {len(demonstrations[2]):,} moves."
    )
    card = {"summary": summary, "size": [config.rows, config.cols]}
    save_network(net, options.out, card)
    likeness = agreement_on(held_out, policies.load(options.out, config.sensor_radius))
    results = {"human_likeness": likeness, "held_out_terrains": len(held)}
    save_network(net, options.out, {**card, "results": results})
    print(f"{options.out}: {summary}")
    print(f"on {len(held)} held-out terrains it makes {likeness:.1%} of the players' moves")
    for name in COMPARED:
        other = agreement_on(held_out, policies.load(name, config.sensor_radius))
        print(f"{name} makes {other:.1%} of them")


if __name__ == "__main__":
    main()
