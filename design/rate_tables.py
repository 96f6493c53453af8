"""Rate against error of the encoder's choices: writes docs/rate.md and docs/pictures/rate.svg.

Run ``python -m design.rate_tables``. The track is bench/talking.py's: 60 s at 25 Hz, all 66 low-level FAPs.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from bench.talking import talking_face
from fapengine.codec.decoder import decode
from fapengine.codec.encoder import Encoder, EncoderOptions, encode
from fapengine.codec.fapfile import parse_fap
from fapengine.codec.planes import STEPS
from fapengine.mpeg4.track import FapTrack

mpl.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parent.parent / "docs"
QUANTS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 25, 31)
TARGETS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
Row = tuple[str, float, float, float]

HEAD = """<!-- Made by design/rate_tables.py; do not edit. -->
# Rate and error

What a stream costs, and how far the decoded values are off. Errors are in quantiser steps at q = 1 (QP of each FAP):
RMS is the mean over the FAPs sent, the maximum is over everything. With the table's ranges a blink or a jump of the
eyes leaves the range of one P plane and is caught up with in the next, so the maximum is more than half a step. A
target below what q 31 costs cannot be met. Live rate control cannot look ahead, and every group learns anew. Every
stream was decoded by the plain decoder.

![kbit/s against error](pictures/rate.svg)
"""


def measure(track: FapTrack, name: str, stream: bytes) -> Row:
    """kbit/s, RMS and maximum error in steps."""
    shown = decode(stream).track
    on = track.mask.any(0)[2:]
    errors = ((shown.values - track.values)[:, 2:] / STEPS)[:, on]
    kbit_s = 8 * len(stream) / (len(track) / track.rate_hz) / 1000
    return name, kbit_s, float(np.sqrt((errors**2).mean(0)).mean()), float(np.abs(errors).max())


def live(track: FapTrack, options: EncoderOptions) -> bytes:
    """Code frame by frame, as a live stream would."""
    faps = [int(n) + 1 for n in np.flatnonzero(track.mask[0])]
    encoder = Encoder(rate_hz=track.rate_hz, faps=faps, options=options)
    return b"".join(encoder.frame(row) for row in track.values) + encoder.finish()


def table(title: str, rows: list[Row]) -> str:
    """One table in Markdown."""
    lines = [f"\n## {title}\n", "| | kbit/s | RMS, steps | maximum, steps |", "|---|---|---|---|"]
    return "\n".join(lines + [f"| {n} | {k:.3f} | {r:.3f} | {m:.1f} |" for n, k, r, m in rows]) + "\n"


def tables(track: FapTrack, what: str) -> tuple[str, dict[str, list[Row]]]:
    """All choices for one track."""
    curves = {
        "table ranges": [measure(track, f"q {q}", encode(track, EncoderOptions(quant=q))) for q in QUANTS],
        "fitted ranges": [
            measure(track, f"q {q}", encode(track, EncoderOptions(quant=q, ranges="fitted"))) for q in QUANTS
        ],
        "rate control, fitted ranges": [
            measure(track, f"target {k}", encode(track, EncoderOptions(kbit_s=k, ranges="fitted"))) for k in TARGETS
        ],
        "rate control, live": [measure(track, f"target {k}", live(track, EncoderOptions(kbit_s=k))) for k in TARGETS],
    }
    return "".join(table(f"{what}: {name}", rows) for name, rows in curves.items()), curves


def plot(curves: dict[str, list[Row]], path: Path) -> None:
    """kbit/s against RMS error."""
    figure, axes = plt.subplots(figsize=(7, 4.2), constrained_layout=True)
    for (name, rows), style in zip(curves.items(), ("o-", "s-", "^--", "x:"), strict=True):
        axes.plot([row[1] for row in rows], [row[2] for row in rows], style, label=name, markersize=4)
    axes.set(xlabel="kbit/s", ylabel="RMS error, steps at q = 1", yscale="log",
             title="66 FAPs of a talking face, 25 Hz, 60 s")  # fmt: skip
    axes.grid(alpha=0.3)
    axes.legend()
    mpl.rcParams["svg.hashsalt"] = "fapengine"
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    text, curves = tables(talking_face(1500), "Synthetic talking face, 66 FAPs")
    parts = [HEAD, text]
    spoken = DOCS.parent / "out" / "demo.fap"
    if spoken.exists():
        own, _ = tables(parse_fap(spoken.read_bytes()), "A sentence spoken by `make demo`")
        parts.append(own)
    (DOCS / "pictures").mkdir(exist_ok=True)
    (DOCS / "rate.md").write_text("".join(parts))
    plot(curves, DOCS / "pictures" / "rate.svg")


if __name__ == "__main__":
    main()
