"""Write the committed fuzz corpus and the small vectors of our own: streams that between them use every field.

Run ``python -m design.fuzz_corpus``; its files are committed.
"""

from pathlib import Path

import numpy as np

from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.epf import encode_orders, parse_epf
from fapengine.codec.fapfile import format_fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.track import FapTrack

ROOT = Path(__file__).resolve().parent.parent / "tests"
WORKED_EXAMPLE = "000001BAB19001B58000924B248029883E848614006C7D2852D17D7005A17F000001B1"
FACE = Fapu(irisd0_mm=11.0, es0_mm=62.0, ens0_mm=47.0, mns0_mm=22.0, mw0_mm=50.0)


def main() -> None:
    rng = np.random.default_rng(5)
    values = np.zeros((6, 68), np.int64)
    values[:, 2:8] = np.cumsum(rng.integers(-20, 20, (6, 6)), axis=0)
    few = np.zeros((6, 68), bool)
    few[:, [0, 1, 2, 3, 4, 47]] = True
    track = FapTrack(
        values=np.where(few, values, 0), mask=few, visemes=rng.integers(0, 2, (6, 4)),
        expressions=rng.integers(0, 2, (6, 6)), frame_numbers=np.array([0, 1, 4, 5, 30, 31]), rate_hz=29.97,
    )  # fmt: skip
    epf = (
        b"FBM 1 FFR 0 ISI 1 FRR 12 8 1 TC 1 2 1 3 FMT 3 2" + b" 1 0" * 8 + b" 0 3 0 0 1 1 0 0 0 0 0 FQU 3 FIX"
        + b" 600" * 66 + b" FIN" + b" -600" * 66 + b" FPX" + b" 120" * 66 + b" FPN" + b" -120" * 66
        + b" FBM 1 FFR 4 ISI 0 SKN 31 FBM 1 FFR 5 ISI 1 FQU 0"
    )  # fmt: skip
    streams = {
        "worked-example.fba": bytes.fromhex(WORKED_EXAMPLE),
        "visual-stream.fba": bytes.fromhex("000001B061000001B523" + WORKED_EXAMPLE),
        "fields.fba": encode(track, EncoderOptions(intra_every=3, plane_start_codes="intra")),
        "orders.fba": encode_orders(parse_epf(epf), track, clamp=True),
        "fitted.fba": encode(track, EncoderOptions(ranges="fitted", quant=2)),
        "moving.fba": encode(track, EncoderOptions(moving_only=True, plane_start_codes="all", quant=0)),
        "intra.fba": _damaged(encode(track, EncoderOptions(intra_every=1))),
        "near.fba": encode(track, EncoderOptions(max_error_mm=0.5, fapu=FACE)),
        "track.fap": format_fap(track).encode(),
        "orders.epf": epf,
    }
    corpus = ROOT / "fuzz" / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for name, data in streams.items():
        (corpus / name).write_bytes(data)
        print(f"{name}: {len(data)} bytes")


def _damaged(stream: bytes) -> bytes:
    """Three hits, so that finding the way back is in the corpus too."""
    hurt = bytearray(stream)
    for at in range(len(hurt) // 4, len(hurt), len(hurt) // 4):
        hurt[at] ^= 0x55
    return bytes(hurt)


if __name__ == "__main__":
    main()
