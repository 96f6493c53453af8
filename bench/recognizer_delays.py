"""Lips that follow a microphone at several delays, against lips by the true phones.

    python -m bench.recognizer_delays

Two sentences in each of flite's four voices go through a server's engine and each recognizer, 20 ms at a time, on a
made clock; the recognizer's process is taken to answer within :data:`ANSWER_S`. Figures: correlation of the opening of
the lips with that by the true phones, moved by the delay, mean and worst of the eight; p b m during which the lips are
shut, with an open mouth near them; largest change of the opening between two frames (1/67 s). Last, the widest opening
while noise, hum, clicks or music are heard.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fapengine.host import hearing
from fapengine.recognition.protocol import RATE_HZ, Recognizer
from fapengine.recognition.small_recognizer import JointRecognizer, SmallRecognizer
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from tests.unit.host import test_hearing
from tests.unit.host.test_hearing import Stage, piecewise
from tests.unit.recognition.speech import BABY, POPPIES, VOICES, Spoken, closures, no_speech, opening_mm, spoken

RECOGNIZERS: dict[str, Callable[[], Recognizer]] = {
    "both, the default": JointRecognizer, "small": SmallRecognizer, "PocketSphinx": SphinxRecognizer
}  # fmt: skip
DELAYS_S = (0.2, 0.25, 0.3, 0.4, 0.5, 1.5)
FRAME_HZ = 200 / 3
ANSWER_S = 0.01
"""Time that the recognizer's process and the pipes take; 20 ms of sound take the small recognizer 1.5 ms of a core."""
FIRST_FRAME_S = 1 / 200
"""Time of the stage's first frame."""
SHUT_MM, OPEN_MM = 0.5, 2.0
SHUT_S, OPEN_S = 0.08, 0.2
"""Time around the middle of p, b and m within which lips are shut, and open."""


def shown(samples: NDArray[np.int16], delay_s: float, recognizer: Callable[[], Recognizer]) -> NDArray[np.float64]:
    """(T,) mm: opening of the lips from the sound's beginning on, moved by the delay, at :data:`FRAME_HZ`."""
    hearing.DELAY_S, test_hearing.WORK_S = delay_s, ANSWER_S
    stage = Stage(recognizer=recognizer)
    take = piecewise(samples, lambda piece: stage.hearing.listen("anna", piece, RATE_HZ))
    lips_mm = stage.run(len(samples) / RATE_HZ + delay_s + 0.1, take)
    sound_s = FIRST_FRAME_S + np.arange(len(lips_mm)) / FRAME_HZ - delay_s
    return np.interp(np.arange(0.0, sound_s[-1], 1 / FRAME_HZ), sound_s, lips_mm)


def around(lips_mm: NDArray[np.float64], at_s: float, reach_s: float) -> NDArray[np.float64]:
    return lips_mm[max(round((at_s - reach_s) * FRAME_HZ), 0) : round((at_s + reach_s) * FRAME_HZ) + 1]


def is_met(lips_mm: NDArray[np.float64], at_s: float) -> bool:
    is_shut = around(lips_mm, at_s, SHUT_S).min() < SHUT_MM
    return bool(is_shut and around(lips_mm, at_s, OPEN_S).max() > OPEN_MM)


def reference_mm(speech: Spoken) -> NDArray[np.float64]:
    return opening_mm(speech.phones, len(speech.samples) / RATE_HZ, FRAME_HZ)


def main() -> None:
    sentences = [spoken(voice, text) for voice in VOICES for text in (BABY, POPPIES)]
    steps = [np.abs(np.diff(reference_mm(speech))).max() for speech in sentences]
    print(f"largest step by the true phones: {max(steps):.1f} mm")
    print(f"{'recognizer':18s} {'delay':>6s} {'mean r':>7s} {'worst':>6s} {'p b m':>6s} {'step':>8s}")
    for name, recognizer in RECOGNIZERS.items():
        for delay_s in DELAYS_S:
            r, met, step_mm = [], [], 0.0
            for speech in sentences:
                reference = reference_mm(speech)
                lips = shown(speech.samples, delay_s, recognizer)[: len(reference)]
                r.append(float(np.corrcoef(lips, reference)[0, 1]))
                met += [is_met(lips, at_s) for at_s in closures(speech.phones)]
                step_mm = max(step_mm, float(np.abs(np.diff(lips)).max()))
            figures = f"{np.mean(r):7.3f} {min(r):6.3f} {sum(met):3d}/{len(met)} {step_mm:5.1f} mm"
            print(f"{name:18s} {delay_s:4.2f} s {figures}", flush=True)
    for name, recognizer in RECOGNIZERS.items():
        opened = {sound: shown(samples, 0.25, recognizer).max() for sound, samples in no_speech().items()}
        print(f"{name:18s} " + ", ".join(f"{sound} {mm:.1f} mm" for sound, mm in opened.items()), flush=True)


if __name__ == "__main__":
    main()
