"""Try whether an adopted policy file can decide on the boards of real episodes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marsexplorer.observation import STATE_VALUES, action_masks, rover_position
from marsexplorer.policies.base import PolicyFileError
from marsexplorer.policies.files.onnx import OnnxEvaluation, OnnxModel, load_imported


def try_on_boards(
    path: Path, content: bytes, boards: Iterable[tuple[NDArray[np.uint8], bool]]
) -> None:
    """Let a policy file decide on boards of an episode.

    Args:
        path: The file's name in messages.
        content: The file's bytes.
        boards: Codes, and whether an episode begins with them.

    Raises:
        PolicyFileError: If it cannot decide, or has numbers that are not finite.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / path.name
        file.write_bytes(content)
        try:
            model = OnnxModel(file)
            load_imported(model)
        except PolicyFileError as error:
            raise PolicyFileError(str(error).replace(str(file), str(path))) from error
    evaluation = OnnxEvaluation(model)
    is_raw = model.inputs["observation"][0] == "tensor(uint8)"
    for codes, is_start in boards:
        if is_start:
            evaluation.begin()
        mask = action_masks(codes[None], np.array([rover_position(codes)]))[0]
        outputs = evaluation.run(codes if is_raw else STATE_VALUES[codes], mask)
        logits = outputs.pop("logits")
        is_number = np.isfinite(logits) | np.isneginf(logits)  # a mask may leave moves out by -inf
        others_are = all(np.isfinite(output).all() for output in outputs.values())
        if not (is_number.all() and np.isfinite(logits).any() and others_are):
            raise PolicyFileError(
                f"{path} cannot be read as a policy: expected finite numbers, got others after some moves of an episode; "
                "look at the network's weights, and train it with a smaller learning rate"
            )
