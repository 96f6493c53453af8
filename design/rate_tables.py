"""Rate against error of the encoder's choices: writes a section of docs/measurements.md, and docs/pictures/rate.svg.

Run ``python -m design.rate_tables``. The track is bench/talking.py's: 60 s at 25 Hz, all 66 low-level FAPs.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from bench.talking import talking_face
from design import measurements
from fapengine.codec.decoder import decode
from fapengine.codec.encoder import Encoder, EncoderOptions, encode
from fapengine.codec.planes import STEPS
from fapengine.mpeg4.track import FapTrack

mpl.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parent.parent / "docs"
QUANTS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 25, 31)
TARGETS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)
SHOWN = ("q 1", "q 4", "target 2.0", "target 4.0")
"""Choices that the page shows; the plot shows all."""
Row = tuple[str, float, float, float]

TEXT = """
What a stream costs, and how far decoded values are off, for a synthetic talking face (60 s at 25 Hz, 66 FAPs). Errors
are in quantiser steps at q = 1; the maximum is over everything. With the table's ranges, a blink or a jump of the eyes
needs two P planes, so the maximum is larger. Live rate control cannot look ahead.
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


def curves_of(track: FapTrack) -> dict[str, list[Row]]:
    """All choices for one track."""
    return {
        "table ranges": [measure(track, f"q {q}", encode(track, EncoderOptions(quant=q))) for q in QUANTS],
        "fitted ranges": [
            measure(track, f"q {q}", encode(track, EncoderOptions(quant=q, ranges="fitted"))) for q in QUANTS
        ],
        "rate control, fitted ranges": [
            measure(track, f"target {k}", encode(track, EncoderOptions(kbit_s=k, ranges="fitted"))) for k in TARGETS
        ],
        "rate control, live": [measure(track, f"target {k}", live(track, EncoderOptions(kbit_s=k))) for k in TARGETS],
    }


def table(curves: dict[str, list[Row]]) -> list[list[str]]:
    """Rows of the page."""
    names = {"table ranges": "table", "fitted ranges": "fitted", "rate control, fitted ranges": "fitted"}
    shown = [
        [f"{name}, {kind}", f"{kbit_s:.2f}", f"{rms:.2f} ({most:.1f})"]
        for curve, kind in {**names, "rate control, live": "live"}.items()
        for name, kbit_s, rms, most in curves[curve]
        if name in SHOWN
    ]
    return [["", "kbit/s", "RMS (maximum)"], *shown]


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
    curves = curves_of(talking_face(1500))
    section = {
        "title": "Bit rate",
        "text": TEXT,
        "picture": ["rate.svg", "kbit/s against error"],
        "table": table(curves),
        "commands": ["python -m design.rate_tables"],
    }
    measurements.write_sections("rate", [section])
    measurements.PAGE.write_text(measurements.page(), encoding="utf-8")
    plot(curves, DOCS / "pictures" / "rate.svg")


if __name__ == "__main__":
    main()
