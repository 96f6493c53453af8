"""Lips that follow live sound at several delays, against lips by the true phones.

    python -m bench.ear_delays

Two sentences in each of flite's four voices go through a server's engine and the ear, 20 ms at a time, on a made clock;
the ear's process is taken to answer within 30 ms. Figures: correlation of the opening of the lips with that by the true
phones, moved by the delay: mean and worst of the eight.
"""

import numpy as np

from fapengine.host import hearing
from fapengine.recognition.protocol import RATE_HZ
from tests.unit.host.test_hearing import Stage, piecewise
from tests.unit.recognition.speech import BABY, POPPIES, VOICES, Spoken, opening_mm, spoken

DELAYS_S = (0.3, 0.4, 0.5, 0.6, 1.5)
FRAME_HZ = 200 / 3


def likeness(speech: Spoken, delay_s: float) -> float:
    hearing.DELAY_S = delay_s
    stage = Stage()
    take = piecewise(speech.samples, lambda piece: stage.hearing.hear("anna", 1, piece, RATE_HZ, is_placed=False))
    duration_s = len(speech.samples) / RATE_HZ
    heard = stage.run(duration_s + delay_s + 0.1, take)[round(delay_s * FRAME_HZ) :]
    reference = opening_mm(speech.phones, duration_s, FRAME_HZ)
    return float(np.corrcoef(heard[: len(reference)], reference)[0, 1])


def main() -> None:
    print(f"{'behind the sound':>16s} {'mean r':>7s} {'worst':>6s}")
    for delay_s in DELAYS_S:
        r = [likeness(spoken(voice, text), delay_s) for voice in VOICES for text in (BABY, POPPIES)]
        print(f"{delay_s:14.1f} s {np.mean(r):7.3f} {min(r):6.3f}", flush=True)


if __name__ == "__main__":
    main()
