"""A sender that does everything at once, until it is ended: ``talker.py PORT``, for the tests of this folder.

Session anna is told phones, berta texts that keep the voice busy, carl sound.
"""

import sys
import time

import numpy as np

from fapengine.clients.sender import Client
from fapengine.speech.phone_track import Phone
from fapengine.voices.espeak import EspeakVoice

PHONES = [Phone(label, 0.15 * n, 0.15 * n + 0.15) for n, label in enumerate("mama" * 3)]
RATE_HZ, PIECE = 16_000, 1600


def main(port: int) -> None:
    """Talk."""
    speech = EspeakVoice().speak("Many people may bring big blue bowls.")
    at = np.arange(0, len(speech.samples), speech.sample_rate_hz / RATE_HZ)
    samples = np.interp(at, np.arange(len(speech.samples)), speech.samples).astype(np.int16)
    with (
        Client(port=port, session="anna") as anna,
        Client(port=port, session="berta") as berta,
        Client(port=port, session="carl") as carl,
    ):
        while True:
            anna.cancel()
            anna.send_phones(PHONES)
            berta.send_text("Many men may map more bays. " * 12)
            heard: int | None = None
            for start in range(0, 2 * RATE_HZ, PIECE):
                heard = carl.send_audio(samples[start : start + PIECE], RATE_HZ, utterance=heard)
                time.sleep(PIECE / RATE_HZ)
            carl.end(heard or 0)


if __name__ == "__main__":
    main(int(sys.argv[1]))
