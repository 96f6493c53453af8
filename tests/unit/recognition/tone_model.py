"""A learned ear that a second makes: it hears tones as phones, so that what it should hear is known.

Each frame of 20 ms is compared with a tone of 400, 1000 and 2500 Hz (a convolution with its sine and cosine, squared
and summed): the loudest is the phone m, a or s, and nothing loud is blank.
"""

import json
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

RATE_HZ = 16_000
TONES_HZ = {"m": 400.0, "a": 1000.0, "s": 2500.0}
LABELS = ["<blank>", *TONES_HZ]
CARD = {"labels": LABELS, "alphabet": "ipa"}


def save_model(path: Path, card: dict[str, object] | None = CARD, *, rate_hz: int = RATE_HZ) -> Path:
    """Write the model, and its card beside it; None: no card."""
    frame = rate_hz // 50
    at_s = np.arange(frame) / rate_hz
    waves = [wave(2 * np.pi * hz * at_s) / frame for hz in TONES_HZ.values() for wave in (np.sin, np.cos)]
    pairs = np.zeros((len(LABELS), len(waves), 1), np.float32)
    for number in range(len(TONES_HZ)):
        pairs[number + 1, 2 * number : 2 * number + 2] = 4000.0
    bias = np.array([3.0] + [0.0] * len(TONES_HZ), np.float32)
    nodes = [
        helper.make_node("Unsqueeze", ["sound", "axis"], ["line"]),
        helper.make_node("Conv", ["line", "waves"], ["parts"], strides=[frame]),
        helper.make_node("Mul", ["parts", "parts"], ["powers"]),
        helper.make_node("Conv", ["powers", "pairs", "bias"], ["scores"]),
        helper.make_node("Transpose", ["scores"], ["told"], perm=[0, 2, 1]),
    ]
    tensors = {"waves": np.array(waves, np.float32)[:, None], "pairs": pairs, "bias": bias, "axis": np.array([1])}
    graph = helper.make_graph(
        nodes,
        "tones",
        [helper.make_tensor_value_info("sound", TensorProto.FLOAT, [1, "samples"])],
        [helper.make_tensor_value_info("told", TensorProto.FLOAT, [1, "frames", len(LABELS)])],
        [numpy_helper.from_array(tensor, name) for name, tensor in tensors.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, path)
    if card is not None:
        path.with_suffix(".json").write_text(json.dumps(card))
    return path


def melody(*notes: tuple[str, float]) -> NDArray[np.int16]:
    """Sound of labels and their seconds; "_" is silence."""
    parts = [
        9000 * np.sin(2 * np.pi * TONES_HZ[label] * np.arange(round(lasts_s * RATE_HZ)) / RATE_HZ)
        if label in TONES_HZ
        else np.zeros(round(lasts_s * RATE_HZ))
        for label, lasts_s in notes
    ]
    return np.concatenate(parts).astype(np.int16)
