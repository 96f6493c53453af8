"""Lip syncs of web pages beside ours, on the same sounds, against filmed lips.

    python -m bench.page_rivals --filmed FOLDER [--sentences 60]

``FOLDER`` is that of ``bench.recognizers``. HeadAudio 0.1.0 and wawa-lipsync 0.0.2 follow the sound, TalkingHead 1.7.0
speaks words with their true times, ours follows the sound, which it delays as well; our plan of the true phones is a
control. npm (MIT, all three) fetches them into ``out/page-rivals``; they run in Node on a made clock, so that none is
late by computing. Their weights of Oculus' visemes become an opening of the lips by our table; correlation does not
depend on how wide it is.

Figures, of 60 pictures a second, compared with lips 25 times a second: correlation while speaking, all sentences in
one, with what is heard at that moment; the lag at which it is best (positive: the face is late), and how good it is
there; p b m during which the lips are shut (less than :data:`SHUT` of their widest), with an open mouth near them;
vowels that are shut as well in their middle third, which they should not be; by how much the sound is delayed; what a
page loads, gzip, without three.js and a head.
"""

import argparse
import base64
import gzip
import json
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.signal import resample_poly

from bench.recognizers import FILMED_HZ, Clip, filmed_clips, while_speaking
from design import face_package
from fapengine.recognition.protocol import RATE_HZ
from fapengine.retarget.visemes import visemes_to_faps
from tests.unit.recognition.speech import closures, opening_mm

HERE = Path(__file__).resolve().parent
HOME = HERE.parent / "out" / "page-rivals"
PACKAGES = ("@met4citizen/headaudio@0.1.0", "wawa-lipsync@0.0.2", "@met4citizen/talkinghead@1.7.0", "three@0.180.0")
PAGE_HZ = 48_000
FRAME_HZ = 60.0
SHUT, OPEN = 0.15, 0.3
"""Of the widest opening: its 95th percentile."""
SHUT_S, OPEN_S = 0.08, 0.2
"""Time around the middle of p, b and m."""
LAGS_S = np.arange(-12, 25) / FRAME_HZ
HEAD = " " * 14 + " as heard    late by r then    p b m shut vowels     sound      loaded"
LOADED = {
    "HeadAudio": ("@met4citizen/headaudio/dist/*",),
    "wawa-lipsync": ("wawa-lipsync/dist/wawa-lipsync.es.js",),
    "TalkingHead": tuple(
        f"@met4citizen/talkinghead/modules/{name}" for name in ("talkinghead.mjs", "dynamicbones.mjs", "lipsync-en.mjs")
    ),
}
"""Files that a page loads."""

Array = np.ndarray


def words_of(folder: Path, name: str) -> list[tuple[str, float, float]]:
    """Words of a sentence with their times, s."""
    data = np.load(folder.parent / "speech_train.npz", allow_pickle=False)
    mine = np.flatnonzero(data["word_clip"] == data["ids"].tolist().index(name))
    words = [(str(data["word"][n]), float(data["word_start"][n]), float(data["word_end"][n])) for n in mine]
    return [word for word in words if word[0] not in ("", "sil", "sp")]


def openings(folder: Path, clips: Sequence[Clip], package: Path) -> dict[str, list[Array]]:
    """(T,) for each sentence: how wide the lips are open in each picture, by the name of who drew it."""
    names = [line.split("\t")[0] for line in (folder / "sentences.tsv").read_text().split("\n") if "\t" in line]
    given = []
    for name, clip in zip(names, clips, strict=False):
        sound = resample_poly(clip.speech.samples.astype(float), PAGE_HZ // RATE_HZ, 1)
        samples = np.clip(sound, -32768, 32767).astype("<i2").tobytes()
        given.append({"samples": base64.b64encode(samples).decode(), "words": words_of(folder, name)})
    done = subprocess.run(
        ["node", str(HERE / "rival_pages.mjs"), str(HOME), str(package)],
        input=json.dumps({"rate": PAGE_HZ, "clips": given}).encode(), stdout=subprocess.PIPE, check=True,
    )  # fmt: skip
    return {name: [opening(np.array(frames)) for frames in drawn] for name, drawn in json.loads(done.stdout).items()}


def opening(frames: Array) -> Array:
    """(T,) FAPU: of weights of visemes, (T, 15), or of FAPs 4 and 5."""
    lips = visemes_to_faps(frames)[:, 3:5] if frames.shape[1] == 15 else frames
    return -lips.sum(axis=1).astype(float)


def row(name: str, clips: Sequence[Clip], shown: list[Array], delay_s: float, size: int) -> str:
    """The figures of one of them."""
    by_lag = [
        while_speaking(clips, [at_frames(one, clip, lag_s) for one, clip in zip(shown, clips, strict=True)])
        for lag_s in LAGS_S
    ]
    best = int(np.argmax(by_lag))
    widest = np.percentile(np.concatenate(shown), 95)
    met = asked = wrong = vowels = 0
    for one, clip in zip(shown, clips, strict=True):
        at_s = np.arange(len(one)) / FRAME_HZ
        for middle_s in closures(clip.speech.phones):
            near = np.abs(at_s - middle_s)
            asked += 1
            met += one[near <= SHUT_S].min() < SHUT * widest and one[near <= OPEN_S].max() > OPEN * widest
        for phone in clip.speech.phones.phones:
            if phone.label[0] in "ɑaæʌɔoeɛ":
                third_s = (phone.end_s - phone.start_s) / 3
                inside = (at_s >= phone.start_s + third_s) & (at_s <= phone.end_s - third_s)
                vowels += inside.any()
                wrong += bool(inside.any()) and one[inside].max() < SHUT * widest
    as_heard = by_lag[int(np.argmin(np.abs(LAGS_S)))]
    return (
        f"{name:14s} {as_heard:8.3f} {1000 * LAGS_S[best]:+7.0f} ms {by_lag[best]:6.3f} {met:6d}/{asked} "
        f"{wrong:7d}/{vowels} {1000 * delay_s:6.0f} ms {size / 1000:8.1f} kB"
    )


def at_frames(shown: Array, clip: Clip, lag_s: float) -> Array:
    """What is shown at the frames of the film, so much later."""
    at_s = np.arange(len(clip.opening)) / FILMED_HZ
    return np.interp(at_s + lag_s, np.arange(len(shown)) / FRAME_HZ, shown)


def size_of(files: Sequence[Path]) -> int:
    """Bytes of files, each compressed."""
    return sum(len(gzip.compress(path.read_bytes(), mtime=0)) for path in files)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--filmed", type=Path, required=True, help="folder of sounds whose lips are filmed")
    parser.add_argument("--sentences", type=int, default=60)
    options = parser.parse_args()
    HOME.mkdir(parents=True, exist_ok=True)
    command = ["npm", "install", "--silent", "--no-save", "--no-audit", "--no-fund", "--prefix", str(HOME), *PACKAGES]
    if subprocess.run(command, check=False).returncode:
        raise SystemExit(f"npm cannot fetch {', '.join(PACKAGES)}")
    clips = filmed_clips(options.filmed)[: options.sentences]
    print(HEAD)
    planned = [opening_mm(clip.speech.phones, len(clip.opening) / clip.rate_hz) for clip in clips]
    print(row("true phones", clips, planned, 0.0, 0))
    with tempfile.TemporaryDirectory() as name:
        package = Path(name)
        face_package.build(package)
        assets = package / "assets"
        own = [*(package / "live").glob("*.js"), assets / "planner.bin", assets / "recognizer.bin"]
        for who, shown in openings(options.filmed, clips, package).items():
            modules = HOME / "node_modules"
            files = [path for pattern in LOADED[who] for path in modules.glob(pattern)] if who in LOADED else own
            delay_s = float(who.split()[1]) if who not in LOADED else 0.0
            print(row(who, clips, shown, delay_s, size_of(files)), flush=True)


if __name__ == "__main__":
    main()
