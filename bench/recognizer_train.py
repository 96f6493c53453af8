"""Trains the small recognizer on the speech of ``bench.recognizer_speech`` and writes its weights.

``bench.recognizer_join`` adds to them.

    python -m bench.recognizer_train FOLDER -o weights.npz [--minutes 20] [--without flite-kal16 festival-kal ...]

The network hears the bands of :mod:`fapengine.recognition.small_net` and names the phone of each frame of 10 ms
(:mod:`fapengine.recognition.small_net` says how it is made). Sound is changed at random, each time anew, so that it is
not the speakers that are learned: the length of the throat (the bands' axis is stretched), tempo, microphone,
telephone, loudness, echo, noise, other speakers and music. Loss: cross entropy of the phones, and of kinds of
phones that look alike on lips. ``--without`` leaves speakers out, for honest figures on a voice that was never heard.

It needs PyTorch: pip install --group recognizer-training. One processor core; seeded, so the same data, version and
number of steps (``--steps``) give the same weights.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from scipy.signal import lfilter, resample_poly
from torch import nn
from torch.nn import functional

from bench.recognizer_speech import EITHER, LABELS, UNKNOWN
from fapengine.recognition.loudness import HOP
from fapengine.recognition.small_net import (
    AHEAD,
    BANDS,
    BEFORE,
    FLOOR,
    FRONT,
    LOUD,
    OFFSETS,
    PAIR,
    WINDOW,
    RunningMean,
    log_mel,
)

CLASSES = len(LABELS)
FRAMES = 400
"""Frames of 10 ms of a piece that is learned at once."""
PITCHES = ((1, 1), (9, 8), (8, 9))
"""Speeds at which a sound is played: its pitch, its throat and its tempo change."""
KINDS = tuple(
    frozenset(labels.split())
    for labels in (
        "_", "p b m", "f v", "w u ʊ oʊ ɔ ɔɪ", "θ ð", "s z t d n l", "ʃ ʒ tʃ dʒ", "ɹ ɝ", "k ɡ ŋ h",
        "i ɪ j eɪ", "ɛ æ aɪ aʊ ɑ", "ə ʌ",
    )
)  # fmt: skip
"""Labels that look alike on lips."""
KIND_WEIGHT = 0.6
NO_SPEECH = ("music", "tones")

Array = np.ndarray


def windows(samples: np.ndarray) -> np.ndarray:
    """Frames of a recording, (N,) int16: (N // 160, 400), with silence before and after it."""
    count = len(samples) // HOP
    padded = np.zeros(count * HOP + 2 * BEFORE, np.int16)
    padded[BEFORE : BEFORE + count * HOP] = samples[: count * HOP]
    return np.lib.stride_tricks.sliding_window_view(padded, WINDOW)[::HOP]


class Net(nn.Module):
    """The network as PyTorch learns it; :mod:`fapengine.recognition.small_net` runs it."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.front = nn.Linear(PAIR * len(FRONT), channels)
        self.mix = nn.ModuleList(nn.Linear(channels * len(steps), channels) for steps in OFFSETS)
        self.out = nn.ModuleList(nn.Linear(channels, channels) for _ in OFFSETS)
        self.head = nn.Linear(channels, 2 * CLASSES)
        for layer in self.out:
            nn.init.normal_(layer.weight, std=0.3 / channels**0.5 / len(OFFSETS) ** 0.5)

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """(B, T, 41) to scores (B, T, classes)."""
        batch, frames, _ = seen.shape
        x = torch.relu(self.front(beside(seen.reshape(batch, frames // 2, -1), FRONT)))
        for steps, mix, out in zip(OFFSETS, self.mix, self.out, strict=True):
            x = x + out(torch.relu(mix(beside(normed(x), steps))))
        return self.head(normed(x)).reshape(batch, frames, CLASSES)


def normed(x: torch.Tensor) -> torch.Tensor:
    return x * torch.rsqrt(x.square().mean(dim=-1, keepdim=True) + 1e-5)


def beside(x: torch.Tensor, steps: tuple[int, ...]) -> torch.Tensor:
    before, behind = -min(steps), max(steps)
    padded = functional.pad(x, (0, 0, before, behind))
    count = x.shape[1]
    return torch.cat([padded[:, before + step : before + step + count] for step in steps], dim=2)


def features(folder: Path, names: list[str]) -> dict[str, list[tuple[Array, Array, Array]]]:
    """Bands, labels and ends of each speaker, at each speed."""
    found = {}
    for name in names:
        kept = folder / f"{name}.mel.npz"
        if not kept.exists():
            data = np.load(folder / f"{name}.npz")
            saved = {}
            speeds = PITCHES if not name.startswith("espeak") and name not in NO_SPEECH else PITCHES[:1]
            for index, (up, down) in enumerate(speeds):
                samples = data["samples"]
                frames, ends = data["frames"], data["ends"]
                if up != down:
                    samples = np.clip(resample_poly(samples.astype(np.float32), up, down), -32768, 32767)
                    count = len(samples) // 160
                    at = np.minimum(((np.arange(count) + 0.5) * down / up).astype(int), len(frames) - 1)
                    frames, ends = frames[at], np.minimum((ends * up / down).astype(int), count)
                near = windows(samples.astype(np.int16))
                saved[f"mel{index}"] = np.concatenate(
                    [log_mel(near[a : a + 10_000]).astype(np.float16) for a in range(0, len(near), 10_000)]
                )
                saved[f"frames{index}"], saved[f"ends{index}"] = frames, ends
            np.savez(kept, **saved)
        data = np.load(kept)
        count = sum(1 for key in data.files if key.startswith("mel"))
        found[name] = [(data[f"mel{i}"], data[f"frames{i}"], data[f"ends{i}"]) for i in range(count)]
    return found


def weight(name: str) -> float:
    """Weight of a speaker's sound in the choice of pieces, 1 for most."""
    if name == "people-en":
        return 3.0
    if name.startswith("people"):
        return 0.5
    if name.startswith("festival"):
        return 0.7
    if name in NO_SPEECH:
        return 0.35
    return 0.09 if name.startswith("espeak") else 1.0


class Pieces:
    """Makes batches at random. Stateful."""

    def __init__(self, speakers: dict, first_mean: Array, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.speakers, self.first_mean = speakers, first_mean
        self.names = list(speakers)
        weights = np.array([weight(name) for name in self.names])
        self.shares = weights / weights.sum()

    def cut(self, name: str, frames: int) -> tuple[Array, Array]:
        """Cut so many frames of a speaker: bands and labels."""
        rng = self.rng
        versions = self.speakers[name]
        mel, labels, ends = versions[0 if rng.random() < 0.5 else rng.integers(len(versions))]
        room = len(mel) - frames
        at_start = rng.random() < 0.5  # of a sentence
        start = int(ends[rng.integers(len(ends))]) - rng.integers(0, 40) if at_start else rng.integers(room)
        start = min(max(start, 0), room)
        return mel[start : start + frames].astype(np.float32), labels[start : start + frames]

    def noise(self, frames: int, peak: float) -> Array:
        """(T, 40): logarithms of the energies of a noise."""
        rng = self.rng
        kind = rng.random()
        if kind < 0.2:
            mel, _ = self.cut(self.names[rng.choice(len(self.names), p=self.shares)], frames)
            return mel - mel.max() + peak - rng.uniform(2.5, 7)
        if kind < 0.35 and "tones" in self.speakers:
            mel, _ = self.cut("music" if rng.random() < 0.7 else "tones", frames)
            return mel - mel.max() + peak - rng.uniform(2.0, 7)
        axis = np.linspace(0, 1, BANDS)
        curve = rng.uniform(-5, 3) * axis + sum(
            rng.normal(0, 0.7) * np.cos(np.pi * (n * axis + rng.random() * 2)) for n in (1, 2, 3)
        )
        bins = np.linspace(1.5, 9, BANDS)
        flicker = np.log(rng.gamma(bins, 1 / bins, size=(frames, BANDS)) + 1e-3)
        slow = np.interp(np.arange(frames), np.arange(0, frames + 50, 50), rng.normal(0, 0.4, frames // 50 + 1))
        noise = curve - curve.max() + flicker + slow[:, None]
        return noise + peak - rng.uniform(1.5, 9.5)

    def piece(self) -> tuple[Array, Array]:
        """Make a piece, changed at random: bands and labels."""
        rng = self.rng
        if rng.random() < 0.03:  # noise alone
            return self.noise(FRAMES, rng.uniform(-9, 2)), np.zeros(FRAMES, np.uint8)
        name = self.names[rng.choice(len(self.names), p=self.shares)]
        tempo = rng.uniform(0.8, 1.25) if rng.random() < 0.5 else 1.0
        mel, labels = self.cut(name, int(FRAMES * tempo) + 2)
        at = np.arange(FRAMES) * tempo
        low = at.astype(int)
        share = (at - low)[:, None].astype(np.float32)
        mel = mel[low] * (1 - share) + mel[low + 1] * share
        labels = labels[np.round(at).astype(int)]
        if rng.random() < 0.6:  # throat
            warp = np.clip(np.arange(BANDS) * rng.uniform(0.87, 1.14) + rng.uniform(-0.5, 0.5), 0, BANDS - 1.001)
            low = warp.astype(int)
            share = (warp - low).astype(np.float32)
            mel = mel[:, low] * (1 - share) + mel[:, low + 1] * share
        if rng.random() < 0.2:  # echo
            fall = np.exp(-13.8 / (rng.uniform(0.15, 0.6) * 100))
            energy = np.exp(mel)
            tail = lfilter([0, 1], [1, -fall], energy, axis=0) * (1 - fall) * rng.uniform(0.05, 0.6)
            mel = np.log(energy + tail)
        axis = np.linspace(0, 1, BANDS)
        if rng.random() < 0.7:  # microphone
            mel = (
                mel
                + rng.normal(0, 1.0) * axis
                + sum(rng.normal(0, 0.45) * np.cos(np.pi * (n * axis + rng.random() * 2)) for n in (1, 2, 3, 5))
            )
        if rng.random() < 0.15:  # telephone
            top = rng.integers(26, 39)
            mel[:, top:] -= rng.uniform(2, 9)
            if rng.random() < 0.4:
                mel[:, : rng.integers(2, 6)] -= rng.uniform(2, 6)
        mel = mel + rng.uniform(-5.0, 1.0)
        if rng.random() < 0.45:
            mel = np.logaddexp(mel, self.noise(FRAMES, float(mel.max()) - 0.5))
        return np.logaddexp(mel, np.log(FLOOR)), labels

    def batch(self, size: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Make so many pieces as the network sees them, and their labels."""
        pieces = [self.piece() for _ in range(size)]
        mel = np.stack([piece for piece, _ in pieces]).astype(np.float32)
        running = RunningMean(self.first_mean)
        seen = np.stack([running.push(mel[:, t]) for t in range(FRAMES)], axis=1)
        for row in seen:
            if self.rng.random() < 0.3:
                first = self.rng.integers(BANDS - 5)
                row[:, first : first + self.rng.integers(1, 6)] = 0
        return torch.from_numpy(seen), torch.from_numpy(np.stack([labels for _, labels in pieces])).long()


def first_mean(speakers: dict) -> Array:
    """Mean of the loud frames against the loudest of their sentence, over the speakers."""
    means = []
    for name, versions in speakers.items():
        if name in NO_SPEECH:
            continue
        mel, labels, _ = versions[0]
        mel = mel[:6000].astype(np.float32)
        level = np.log(np.exp(mel).mean(axis=1))
        top = np.percentile(level, 97)
        means.append((mel[(level > top - LOUD) & (labels[:6000] > 0)] - top).mean(axis=0))
    return np.mean(means, axis=0).astype(np.float32)


def orders(speakers: dict) -> Array:
    """(C, C): how often a label follows another in English."""
    pairs = np.zeros((CLASSES,) * 2)
    for name, versions in speakers.items():
        if name.startswith("people") or name in NO_SPEECH:
            continue
        _, labels, ends = versions[0]
        for a, b in zip([0, *ends[:-1]], ends, strict=True):
            row = labels[a:b]
            if not len(row):
                continue
            row = row[np.concatenate([[True], np.diff(row.astype(int)) != 0])]
            row = np.concatenate([[0], row[row > 0], [0]]) if row[0] else row
            np.add.at(pairs, (row[:-1], row[1:]), 1)
    return pairs


def loss_of(scores: torch.Tensor, labels: torch.Tensor, kinds: torch.Tensor) -> torch.Tensor:
    logs = scores.log_softmax(dim=-1)
    schwa, strut = LABELS.index("ə"), LABELS.index("ʌ")
    either = torch.logaddexp(logs[..., schwa], logs[..., strut])[..., None]
    known = labels != UNKNOWN
    target = labels.clamp(max=EITHER)
    smooth = 0.95 * torch.cat([logs, either], dim=-1).gather(-1, target[..., None])[..., 0] + 0.05 * logs.mean(dim=-1)
    alike = torch.log(logs.exp() @ kinds.T + 1e-8).gather(-1, kind_of(kinds, target)[..., None])[..., 0]
    return -((smooth + KIND_WEIGHT * alike) * known).sum() / known.sum()


def kind_of(kinds: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    number = torch.cat([kinds.argmax(dim=0), kinds[:, LABELS.index("ə")].argmax(dim=0, keepdim=True)])
    return number[target]


def save(path: Path, net: dict[str, torch.Tensor], mean: Array, pairs: Array, shares: Array, about: dict) -> None:
    arrays = {key: value.numpy().astype(np.float16) for key, value in net.items()}
    np.savez_compressed(
        path, **arrays, first_mean=mean, pairs=pairs.astype(np.float32), shares=shares.astype(np.float32),
        other=np.zeros((CLASSES, CLASSES), np.float16), about=np.array(json.dumps(about)),
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--steps", type=int, help="number of steps in the place of minutes")
    parser.add_argument("--without", nargs="*", default=[], metavar="SPEAKER")
    parser.add_argument("--start", type=Path, help="weights to begin with, and their first mean")
    parser.add_argument("--channels", type=int, default=160)
    parser.add_argument("--batch", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=1.5e-3)
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)
    names = sorted(path.stem for path in options.folder.glob("*.npz") if ".mel" not in path.name)
    names = [name for name in names if name not in options.without]
    speakers = features(options.folder, names)
    mean = first_mean(speakers)
    pairs = orders(speakers)
    print(len(names), "speakers", sum(len(v[0][0]) for v in speakers.values()) / 360_000, "hours", flush=True)
    pieces = Pieces(speakers, mean, options.seed)
    counted = np.zeros(CLASSES)
    for name, share in zip(pieces.names, pieces.shares, strict=True):
        labels = np.minimum(speakers[name][0][1], CLASSES)
        counted += share * np.bincount(labels, minlength=CLASSES + 1)[:CLASSES] / len(labels)
    kinds = torch.tensor([[float(label in kind) for label in LABELS] for kind in KINDS])
    net = Net(options.channels)
    earlier: list[int] = []
    if options.start:
        begun = np.load(options.start)
        net.load_state_dict({key: torch.from_numpy(begun[key].astype(np.float32)) for key in net.state_dict()})
        mean = begun["first_mean"]
        about = json.loads(str(begun["about"]))
        earlier = [*about.get("earlier_steps", []), about["steps"]]
        pieces.first_mean = mean
    mean_net = {key: value.detach().clone() for key, value in net.state_dict().items()}
    print(sum(p.numel() for p in net.parameters()), "parameters", flush=True)
    optimiser = torch.optim.AdamW(net.parameters(), lr=options.rate, betas=(0.9, 0.98), weight_decay=0.02)
    began, step, lately, done = time.monotonic(), 0, [], 0.0
    while done < 1.0:
        done = step / options.steps if options.steps else (time.monotonic() - began) / 60 / options.minutes
        rise = min(1.0, (step + 1) / 150)
        for group in optimiser.param_groups:
            group["lr"] = options.rate * rise * max(0.5 * (1 + np.cos(np.pi * min(done, 1.0))), 0.01)
        seen, labels = pieces.batch(options.batch)
        scores = net(seen)[:, : FRAMES - 2 * AHEAD]
        loss = loss_of(scores, labels[:, : FRAMES - 2 * AHEAD], kinds)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()
        step += 1
        keep = min(0.998, step / (step + 20))
        with torch.no_grad():
            for key, value in net.state_dict().items():
                mean_net[key].mul_(keep).add_(value, alpha=1 - keep)
        right = (scores.argmax(-1) == labels[:, : FRAMES - 2 * AHEAD]).float().mean().item()
        lately.append((loss.item(), right))
        if step % 50 == 0:
            lost, right = np.mean(lately, axis=0)
            print(f"{step} {done:.3f} loss {lost:.3f} right {right:.3f} {time.monotonic() - began:.0f} s", flush=True)
            lately = []
        if step % 500 == 0 or done >= 1.0:
            about = {
                "made_by": "bench/recognizer_speech.py, bench/recognizer_train.py, bench/recognizer_join.py",
                "licence": "CC-BY-SA-3.0: small_recognizer.npz.license",
                "steps": step,
                "earlier_steps": earlier,
                "seed": options.seed,
                "speakers": names,
                "without": options.without,
                "labels": LABELS,
            }
            save(options.output, mean_net, mean, pairs, counted / counted.sum(), about)


if __name__ == "__main__":
    main()
