"""Models that a moment makes and that speak as those of Piper, piper-plus and Kokoro do: each symbol has a tone and a
length of its own.

Inputs, outputs and files are those of the real ones; what is between is a table of lengths and a table of waves. So
what should be heard, and when, is known.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

RATES_HZ = {"piper": 22_050, "piper-plus": 22_050, "kokoro": 24_000}
UNITS = {"piper": 256, "piper-plus": 256, "kokoro": 600}
"""Samples of which lengths are counts."""
SILENT = frozenset("_^$ .,;:!?")
PIPER_SYMBOLS = [*"_^$ .,!?ˈˌː", *"abdefhijklmnoprstuvwzæðŋɐɑɔəɚɛɜɪɹʃʊʌʒθɡɾʔ", "\u0303"]
UNITS_OF = {"_": 1, "^": 6, "$": 9, " ": 2, ".": 10, ",": 10, "ˈ": 2, "ˌ": 2, "ː": 3}
"""Lengths of Piper's symbols; the rest lasts 7."""


def save_piper(path: Path, *, told: bool = True, speakers: Mapping[str, int] | None = None) -> Path:
    """Write a voice and its description; not ``told``: one that hides how long its symbols last."""
    numbers = {symbol: [number] for number, symbol in enumerate(PIPER_SYMBOLS)}
    table = np.array([UNITS_OF.get(symbol, 7) for symbol in PIPER_SYMBOLS], np.float32) - 0.25
    nodes = [
        node("Gather", ["table", "input"], "raw"),
        node("Slice", ["scales", "one", "two"], "scale"),
        node("Mul", ["raw", "scale"], "scaled"),
        node("Ceil" if told else "Round", ["scaled"], "counts"),
    ]
    constants = {"one": np.array([1]), "two": np.array([2]), "table": table, "shape": np.array([1, 1, 1, -1])}
    inputs = [("input", TensorProto.INT64, [1, "n"]), ("input_lengths", TensorProto.INT64, [1]),
              ("scales", TensorProto.FLOAT, [3])]  # fmt: skip
    if speakers:
        inputs.append(("sid", TensorProto.INT64, [1]))
        nodes.append(node("Cast", ["sid"], "loud", to=TensorProto.FLOAT))
    save(path, nodes, constants, inputs, ["output"], PIPER_SYMBOLS, "piper")
    description = {
        "audio": {"sample_rate": RATES_HZ["piper"]}, "espeak": {"voice": "en-us"}, "phoneme_type": "espeak",
        "num_symbols": len(numbers), "num_speakers": len(speakers or "x"), "phoneme_id_map": numbers,
        "speaker_id_map": speakers or {}, "inference": {"noise_scale": 0, "length_scale": 1, "noise_w": 0},
        "hop_length": UNITS["piper"],
    }  # fmt: skip
    Path(f"{path}.json").write_text(json.dumps(description))
    return path


PLUS_SYMBOLS = [*PIPER_SYMBOLS, *"Nɯɾɕɲɣβxyõãẽĩũʁʎʂɻɨøœ", *map(chr, range(0xE000, 0xE065))]


def save_piper_plus(
    path: Path, *, told: bool = True, languages: Sequence[str] = ("ja", "en", "es"), speakers: int = 1
) -> Path:
    """Write a voice, with random lengths of its symbols, and its description."""
    symbols = list(dict.fromkeys(PLUS_SYMBOLS))
    rng = np.random.default_rng(3)
    table = np.array([
        0.4 if symbol == "_" else 1.5 if symbol in " ˈˌː" else rng.uniform(4.1, 8.9) for symbol in symbols
    ], np.float32)  # fmt: skip
    nodes = [
        node("Gather", ["table", "input"], "raw"),
        node("Slice", ["scales", "one", "two"], "scale"),
        node("Mul", ["raw", "scale"], "durations"),  # as exported: before they are rounded up
        node("Ceil", ["durations"], "counts"),
        node("Cast", ["lid"], "language", to=TensorProto.FLOAT),
    ]
    inputs = [("input", TensorProto.INT64, [1, "n"]), ("input_lengths", TensorProto.INT64, [1]),
              ("scales", TensorProto.FLOAT, [3]), ("lid", TensorProto.INT64, [1]),
              ("speaker_embedding", TensorProto.FLOAT, [1, 192]),
              ("speaker_embedding_mask", TensorProto.INT64, [1, 1])]  # fmt: skip
    if speakers > 1:
        inputs.append(("sid", TensorProto.INT64, [1]))
        nodes.append(node("Cast", ["sid"], "loud", to=TensorProto.FLOAT))
    constants = {"one": np.array([1]), "two": np.array([2]), "table": table, "shape": np.array([1, 1, 1, -1])}
    save(path, nodes, constants, inputs, ["output", "durations"][: 1 + told], symbols, "piper-plus")
    description = {
        "audio": {"sample_rate": RATES_HZ["piper-plus"], "hop_size": UNITS["piper-plus"]},
        "phoneme_type": "multilingual", "num_symbols": len(symbols), "num_speakers": speakers,
        "num_languages": len(languages), "language_id_map": {name: n for n, name in enumerate(languages)},
        "phoneme_id_map": {symbol: [number] for number, symbol in enumerate(symbols)}, "speaker_id_map": {},
        "inference": {"noise_scale": 0, "length_scale": 1, "noise_w": 0},
    }  # fmt: skip
    Path(f"{path}.json").write_text(json.dumps(description))
    return path


def save_kokoro(path: Path, vocabulary: Mapping[str, int], voices: Sequence[str], *, told: bool = True) -> Path:
    """Write a model, and its voices beside it as ``voices.bin``."""
    letters = ["_"] * (max(vocabulary.values()) + 1)
    for letter, number in vocabulary.items():
        letters[number] = letter
    table = np.array([4 if letter in SILENT else 1 if letter in "ˈˌː" else 3 for letter in letters], np.float32)
    nodes = [
        node("Gather", ["table", "input_ids"], "raw"),
        node("Div", ["raw", "speed"], "scaled"),
        node("Round", ["scaled"], "counts"),
        node("Cast", ["counts"], "whole", to=TensorProto.INT64),
        node("Squeeze", ["whole", "zero"], "duration"),
    ]
    inputs = [("input_ids", TensorProto.INT64, [1, "n"]), ("style", TensorProto.FLOAT, [1, 4]),
              ("speed", TensorProto.FLOAT, [1])]  # fmt: skip
    constants = {"table": table, "shape": np.array([-1])}
    save(path, nodes, constants, inputs, ["output", "duration"][: 1 + told], letters, "kokoro")
    with path.with_name("voices.bin").open("wb") as file:
        np.savez(file, **{name: np.ones((510, 1, 4), np.float32) for name in voices})
    return path


def save(
    path: Path, nodes: list[onnx.NodeProto], constants: dict[str, NDArray[np.generic]],
    inputs: list[tuple[str, int, list[int | str]]], outputs: Sequence[str], symbols: Sequence[str], kind: str,
) -> None:  # fmt: skip
    """Write a model that turns ``counts``, (1, n), and the first input's numbers into ``output``."""
    nodes += [
        node("CumSum", ["counts", "axis"], "ends"),
        node("ReduceSum", ["counts"], "sum", keepdims=0),
        node("Range", ["start", "sum", "step"], "row"),
        node("Unsqueeze", ["row", "axis"], "column"),
        node("GreaterOrEqual", ["column", "ends"], "behind"),
        node("Cast", ["behind"], "ones", to=TensorProto.INT64),
        node("ReduceSum", ["ones", "last"], "which", keepdims=0),
        node("Squeeze", [inputs[0][0], "zero"], "numbers"),
        node("Gather", ["numbers", "which"], "sounding"),
        node("Gather", ["waves", "sounding"], "pieces"),
        node("Reshape", ["pieces", "shape"], "output"),
    ]
    constants |= {"axis": np.array(1), "last": np.array([1]), "zero": np.array([0])}
    constants |= {"start": np.array(0, np.float32), "step": np.array(1, np.float32)}
    constants["waves"] = waves(symbols, UNITS[kind])
    tensors = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    graph = helper.make_graph(
        nodes, "tones", [helper.make_tensor_value_info(*each) for each in inputs],
        [helper.make_tensor_value_info(n, TensorProto.INT64 if n == "duration" else TensorProto.FLOAT, None)
         for n in outputs], tensors,
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)


def node(kind: str, inputs: list[str], output: str, **attributes: object) -> onnx.NodeProto:
    return helper.make_node(kind, inputs, [output], **attributes)


def waves(symbols: Sequence[str], length: int) -> NDArray[np.float32]:
    """One unit of each symbol's tone, (V, length): whole periods, silence for pauses, dull for m n ŋ."""
    turns = 2 * np.pi * np.arange(length) / length
    rows = [
        np.zeros(length) if symbol in SILENT else 0.3 * np.sin(4 * turns) if symbol in "mnŋ"
        else 0.5 * np.sin((8 + number % 20) * turns)
        for number, symbol in enumerate(symbols)
    ]  # fmt: skip
    return np.array(rows, np.float32)
