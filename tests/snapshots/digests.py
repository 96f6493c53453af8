"""Digests of files: an exact part, and numbers that another processor may give a little differently.

A digest is ``Digest(kind, exact, near)``. ``exact`` are the first hexadecimal digits of a SHA-256, ``near`` a few
numbers that are compared with the tolerance of the kind. Prose is in no digest: it may be reworded.
"""

import hashlib
import io
import json
import re
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Any

import av
import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageSequence

Near = tuple[float, ...]
DIGITS = 20
BLOCKS = 8
"""Blocks that an array of floats is cut into; each leaves its mean and its root mean square."""
GRID = 4
"""Rows and columns of the mean colours that a picture leaves."""
NUMBER = re.compile(r"-?\d+\.\d+(?:[eE][-+]?\d+)?|-?\d+(?:[eE][-+]?\d+)?")
AVATARS = (".glb", ".usda", ".usdc")
SHA256 = re.compile(r"\b[0-9a-f]{64}\b")
VERSION = re.compile(r"^version = .*$", re.MULTILINE)
"""Of the program that made a file."""
UNSTEADY = ("seconds", "total_s", "times_real_time", "drawn_hz", "drawn_per_s", "wall_s", "finished_at")
"""Keys of results that say how long the work took. Avatars hold floats as text: other processors, other sizes."""


@dataclass(frozen=True)
class Digest:
    """What is left of a file."""

    kind: str
    exact: str
    near: Near = ()

    def equals(self, other: "Digest") -> bool:
        """Compare; ``near`` with the tolerance of the kind."""
        if (self.kind, self.exact, len(self.near)) != (other.kind, other.exact, len(other.near)):
            return False
        share, floor = TOLERANCES.get(self.kind, (0.0, 0.0))
        return all(
            abs(a - b) <= floor + share * max(abs(a), abs(b)) for a, b in zip(self.near, other.near, strict=True)
        )


TOLERANCES = {
    "picture": (0.0, 6.0),
    "film": (0.0, 8.0),
    "sound": (0.0, 1.0),
    "arrays": (2e-3, 2e-5),
    "scene": (2e-3, 2e-5),
    "stage": (2e-3, 2e-5),
}
"""(share, absolute) by kind: levels of 255, levels, dB, the array's unit."""


def digest(name: str, data: bytes) -> Digest:
    """Digest a file; its name says of which kind it is."""
    for pattern, kind in KINDS.items():
        if fnmatch(name.rpartition("/")[2], pattern):
            exact, near = READERS[kind](data)
            return Digest(kind, hashlib.sha256(exact).hexdigest()[:DIGITS], near)
    raise LookupError(f"{name}: no kind of digest; add its ending to KINDS")


def rounded(number: float, digits: int = 4) -> str:
    """Round so that values such as 0.125, which one bit would tip over, are far from the border."""
    shifted = np.floor(number * 10.0**digits + 0.3137)
    return str(int(shifted)) if np.isfinite(shifted) else str(shifted)


def blocks(values: ArrayLike) -> Near:
    """Mean and root mean square of each of a few blocks."""
    flat = np.asarray(values, np.float64).ravel()
    flat = np.where(np.isfinite(flat), flat, 0.0)
    if not flat.size:
        return ()
    parts = np.array_split(flat, min(BLOCKS, flat.size))
    return tuple(float(f"{number:.6g}") for part in parts for number in (part.mean(), np.sqrt((part**2).mean())))


def _bytes(data: bytes) -> tuple[bytes, Near]:
    return data, ()


def _there(data: bytes) -> tuple[bytes, Near]:
    """Nothing but that it is there, and whether it is empty."""
    return str(bool(data)).encode(), ()


def _table(data: bytes) -> tuple[bytes, Near]:
    """Every word, and numbers rounded."""
    return NUMBER.sub(lambda match: rounded(float(match[0])), data.decode("utf-8", "replace")).encode(), ()


def _numbers(data: bytes) -> tuple[bytes, Near]:
    """Numbers alone, in their order; not those in digests of other files, nor those of our version."""
    text = VERSION.sub("", SHA256.sub("", data.decode("utf-8", "replace")))
    return " ".join(rounded(float(word)) for word in NUMBER.findall(text)).encode(), ()


def leaves(value: Any, path: str = "") -> Iterable[tuple[str, Any]]:
    """Yield (path of keys, value) of a result in JSON; items of a list share a path."""
    if isinstance(value, Mapping):
        unsteady = (*UNSTEADY, "bytes") if str(value.get("output")).endswith(AVATARS) else UNSTEADY
        for key, item in value.items():
            if key not in unsteady:
                yield from leaves(item, f"{path}.{key}")
    elif isinstance(value, list):
        for item in value:
            yield from leaves(item, f"{path}[]")
    else:
        yield path, value


def _json(data: bytes) -> tuple[bytes, Near]:
    """Numbers and truth values under each path of keys, in their order; neither the keys nor their order.

    Keys are in ``texts/json-keys.txt``, and words may be reworded.
    """
    found: dict[str, list[str]] = {}
    for path, value in leaves(json.loads(data)):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        found.setdefault(path, []).append(rounded(value) if is_number else "" if isinstance(value, str) else str(value))
    return "\n".join(sorted(" ".join(values) for values in found.values())).encode(), ()


def _lines(data: bytes) -> tuple[bytes, Near]:
    """A JSON value a line."""
    return b"\n".join(_json(line)[0] for line in data.splitlines() if line.strip()), ()


def _page(data: bytes) -> tuple[bytes, Near]:
    """How many elements of each kind; the words of a page may be reworded."""
    text = data.decode()
    counts = [
        f"{tag} {len(re.findall(f'<{tag}[ >/]', text))}" for tag in ("svg", "path", "polyline", "table", "tr", "img")
    ]
    return " ".join(counts).encode(), ()


def _arrays(data: bytes) -> tuple[bytes, Near]:
    exact, near = [], []
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        for name in sorted(file.files):
            values = file[name]
            exact.append(f"{name} {values.shape} {values.dtype.kind}")
            if values.dtype.kind == "f":
                near += blocks(values)
            elif values.dtype.kind in "iub":
                exact.append(hashlib.sha256(np.ascontiguousarray(values, np.int64).tobytes()).hexdigest())
            elif values.dtype.kind == "U":
                exact += [NUMBER.sub("#", str(word)) for word in values.ravel() if len(str(word)) < 20]
    return "\n".join(exact).encode(), tuple(near)


def _cells(picture: Image.Image) -> Near:
    pixels = np.asarray(picture.convert("RGBA").resize((GRID, GRID), Image.Resampling.BOX), np.float64)
    return tuple(float(round(level)) for level in pixels.ravel())


def _picture(data: bytes) -> tuple[bytes, Near]:
    """Size, frames and times; mean colours of the first and the middle frame."""
    with Image.open(io.BytesIO(data)) as file:
        frames = [frame.copy() for frame in ImageSequence.Iterator(file)]
        times = [frame.info.get("duration", 0) for frame in frames]
        exact = f"{file.format} {file.size} {file.mode if len(frames) == 1 else ''} {len(frames)} {sum(times)}"
    chosen = frames[:1] if len(frames) == 1 else [frames[0], frames[len(frames) // 2]]
    return exact.encode(), tuple(level for frame in chosen for level in _cells(frame))


def _film(data: bytes) -> tuple[bytes, Near]:
    """Kinds of streams, size, rate, frames, length of the sound; mean colours of two frames."""
    exact, near = [], ()
    with av.open(io.BytesIO(data)) as file:
        exact += [
            f"{stream.type} {stream.codec_context.name if stream.codec_context else ''}" for stream in file.streams
        ]
    with av.open(io.BytesIO(data)) as file:
        frames = _pictures(file)
        if frames:
            video = file.streams.video[0]
            exact.append(f"{video.width}x{video.height} {video.average_rate} {len(frames)}")
            for frame in (frames[0], frames[len(frames) // 2]):
                near += _cells(Image.fromarray(frame))
    with av.open(io.BytesIO(data)) as file:
        if file.streams.audio:
            seconds = sum(frame.samples / frame.sample_rate for frame in file.decode(audio=0))
            exact.append(f"{file.streams.audio[0].rate} {seconds:.1f}")
    return "\n".join(exact).encode(), near


def _pictures(file: av.container.InputContainer) -> list[NDArray[np.uint8]]:
    """Pictures of a film; none, where the visual track holds FAPs."""
    if not file.streams.video or file.streams.video[0].codec_context is None:
        return []
    try:
        return [frame.to_ndarray(format="rgba") for frame in file.decode(video=0)]  # type: ignore[misc]
    except av.error.InvalidDataError:
        return []


def _sound(data: bytes) -> tuple[bytes, Near]:
    """Rate, channels and length; loudness in 16 pieces, dB."""
    with av.open(io.BytesIO(data)) as file:
        frames = [frame.to_ndarray().astype(np.float64) for frame in file.decode(audio=0)]
        stream = file.streams.audio[0]
        exact = f"{stream.rate} {stream.channels} {sum(frame.shape[-1] for frame in frames)}"
    samples = np.concatenate([frame.ravel() for frame in frames]) if frames else np.zeros(1)
    pieces = np.array_split(samples, 16)
    return exact.encode(), tuple(
        round(20 * float(np.log10(np.sqrt((p**2).mean()) + 1.0)), 1) if p.size else 0.0 for p in pieces
    )


GLTF_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def _scene(data: bytes) -> tuple[bytes, Near]:
    """The glTF document without its offsets and prose, and the accessors' numbers in blocks."""
    length = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + length])
    binary = data[20 + length + 8 :]
    near: list[float] = []
    exact = hashlib.sha256()
    for accessor in document.get("accessors", []):
        values = _accessor(document, accessor, binary)
        if values.dtype.kind == "f":
            near += (
                [float(f"{number:.6g}") for number in (values.mean(), np.sqrt((values**2).mean()))]
                if values.size
                else []
            )
        else:
            exact.update(np.ascontiguousarray(values, np.int64).tobytes())
    sums = [float(f"{number:.6g}") for number in (np.asarray(near[n :: 2 * BLOCKS]).sum() for n in range(2 * BLOCKS))]
    kept = {key: value for key, value in document.items() if key not in ("asset", "bufferViews", "buffers")}
    words = [
        f"{path} {_stable(value)}"
        for path, value in leaves(kept)
        if not path.startswith((".extensions.VRM", ".extras"))
    ]
    exact.update("\n".join(words).encode())
    return exact.hexdigest().encode(), tuple(sums)


def _stable(value: Any) -> str:
    return (
        rounded(value, 3)
        if isinstance(value, float)
        else str(value)
        if not isinstance(value, str) or len(value) < 40
        else "text"
    )


def _accessor(document: Mapping[str, Any], accessor: Mapping[str, Any], binary: bytes) -> NDArray[Any]:
    kind, width = np.dtype(GLTF_KINDS[accessor["componentType"]]), WIDTHS[accessor["type"]]
    values = np.zeros((accessor["count"], width), kind)
    if "bufferView" in accessor:
        values = _view(
            document, accessor["bufferView"], binary, kind, accessor["count"] * width, accessor.get("byteOffset", 0)
        )
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        at = _view(
            document,
            sparse["indices"]["bufferView"],
            binary,
            np.dtype(GLTF_KINDS[sparse["indices"]["componentType"]]),
            sparse["count"],
            0,
        )
        there = _view(document, sparse["values"]["bufferView"], binary, kind, sparse["count"] * width, 0)
        values = values.reshape(-1, width).copy()
        values[at] = there.reshape(-1, width)
    return values.astype(np.float64) if kind.kind == "f" else values


def _view(
    document: Mapping[str, Any], number: int, binary: bytes, kind: np.dtype[Any], count: int, offset: int
) -> NDArray[Any]:
    view = document["bufferViews"][number]
    return np.frombuffer(binary, kind, count, view.get("byteOffset", 0) + offset)


def _stage(data: bytes) -> tuple[bytes, Near]:
    """A USD stage: its text, words exact and numbers in blocks."""
    text = data.decode() if data.startswith(b"#usda") else _opened(data)
    numbers = [float(word) for word in NUMBER.findall(text)]
    words = [
        line.split()[0]
        for line in text.splitlines()
        if line.strip() and not line.strip().startswith("#") and "=" not in line
    ]
    return "\n".join([*words, str(len(numbers))]).encode(), blocks(numbers)


def _opened(data: bytes) -> str:
    import tempfile

    from pxr import Usd

    with tempfile.NamedTemporaryFile(suffix=".usdc") as file:
        file.write(data)
        file.flush()
        stage = Usd.Stage.Open(file.name)  # the layer is gone with its stage
        return str(stage.GetRootLayer().ExportToString())


READERS: Mapping[str, Callable[[bytes], tuple[bytes, Near]]] = {
    "bytes": _bytes, "there": _there, "table": _table, "numbers": _numbers, "json": _json, "lines": _lines,
    "page": _page, "arrays": _arrays, "picture": _picture, "film": _film, "sound": _sound,
    "scene": _scene, "stage": _stage,
}  # fmt: skip
"""What each kind of digest reads of a file."""
KINDS: Mapping[str, str] = {
    "stdout.json": "json", "stdout.bytes": "bytes", "stdout.words": "numbers", "index.csv": "there",
    "journal*.jsonl": "there",
    "*.lock": "there",
    **dict.fromkeys(("*.fap", "*.fba", "*.TextGrid", "*.ctm", "*.pho", "*.tsv", "*.xml", "*.dat"), "bytes"),
    **dict.fromkeys(("*.csv", "*.trc"), "table"), "*.toml": "numbers", "*.json": "json", "*.jsonl": "lines",
    "*.html": "page", "*.npz": "arrays", **dict.fromkeys(("*.png", "*.gif", "*.webp"), "picture"),
    **dict.fromkeys(("*.mp4", "*.webm", "*.mkv", "*.mov"), "film"), **dict.fromkeys(("*.wav",), "sound"),
    **dict.fromkeys(("*.glb", "*.vrm", "*.vrma"), "scene"), **dict.fromkeys(("*.usda", "*.usdc"), "stage"),
    "*.c3d": "there", "*.ply": "there",
}  # fmt: skip
"""Kind of digest by a file's name, the first that fits; ``stdout`` is what a command prints."""


def encode_row(parts: Sequence[str], value: Digest) -> str:
    """Spell a line of ``jobs.txt``."""
    near = " ".join(f"{number:g}" for number in value.near)
    return " | ".join([*parts, value.kind, value.exact, near]).rstrip()
