"""docs/pictures/sound-and-lips.svg: the sound of a sentence, its phones, and the opening of the lips.

python -m design.sound_and_lips
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.speech.phone_track import PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.protocol import Speech
from fapengine.voices.sounding import SoundLevel

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "sound-and-lips.svg"
SENTENCE = "Papa, my puppet may hop up."
FRAME_HZ = 240.0
STEP_S = 0.002
"""Width of one bar of the sound."""
CLOSED = "pbm"


def draw_sound(axes: Axes, speech: Speech) -> None:
    """Draw the highest and lowest sample of each step."""
    step = round(STEP_S * speech.sample_rate_hz)
    rows = speech.samples[: len(speech.samples) // step * step].reshape(-1, step) / 32768
    axes.fill_between(np.arange(len(rows)) * STEP_S, rows.min(1), rows.max(1), color="#37474f", lw=0)
    axes.set_ylabel("sound")
    axes.set_yticks([])


def draw_phones(axes: Axes, phones: PhoneTrack, sound: SoundLevel) -> None:
    """Draw labels in their boxes; of a stop, the silent part is dark."""
    for phone in phones.phones:
        if phone.is_silence:
            continue
        closed = phone.label[0] in CLOSED
        axes.axvspan(phone.start_s, phone.end_s, color="#b0bec5" if closed else "#eceff1", lw=0)
        axes.axvline(phone.start_s, color="white", lw=1)
        burst_s = phone.start_s
        while closed and burst_s < phone.end_s and sound.stays_quiet(burst_s, burst_s + STEP_S):
            burst_s += STEP_S
        axes.axvspan(phone.start_s, burst_s, color="#546e7a", lw=0)
        axes.text((phone.start_s + phone.end_s) / 2, 0.5, phone.label, ha="center", va="center", fontsize=11)
    axes.set_ylabel("phones")
    axes.set_yticks([])


def draw_opening(axes: Axes, phones: PhoneTrack) -> None:
    """Draw the opening of the inner lips; 20 FAPU are 0.4 mm on the recorded face."""
    values = plan(phones, load_profile("grid_s1_en"), rng=np.random.default_rng(1), rate_hz=FRAME_HZ).track.values
    opening = -(values[:, fap.column(4)] + values[:, fap.column(5)])
    axes.plot(np.arange(len(opening)) / FRAME_HZ, opening, color="#c62828", lw=1.4)
    axes.axhline(20, color="#90a4ae", lw=0.8, ls="--")
    axes.set_ylabel("opening, FAPU")
    axes.set_xlabel("s")
    axes.set_ylim(-30, None)


def main() -> None:
    speech = EspeakVoice("en-us").speak(SENTENCE).padded(lead_s=0.15, tail_s=0.2)
    sound = SoundLevel(speech.samples, speech.sample_rate_hz)
    mpl.rcParams.update({"svg.hashsalt": "fapengine", "svg.fonttype": "none"})
    figure, (top, middle, bottom) = plt.subplots(
        3, 1, figsize=(11, 5), sharex=True, height_ratios=(3, 1, 4), layout="constrained"
    )
    draw_sound(top, speech)
    draw_phones(middle, speech.phones, sound)
    draw_opening(bottom, speech.phones)
    for phone in speech.phones.phones:
        if phone.label[0] in CLOSED:
            for axes in (top, bottom):
                axes.axvspan(phone.start_s, phone.end_s, color="#b0bec5", alpha=0.35, lw=0)
    top.set_title(SENTENCE, fontsize=11)
    top.set_xlim(0, speech.duration_s)
    for axes in (top, middle, bottom):
        axes.spines[["top", "right", "left"]].set_visible(False)
    figure.savefig(PICTURE, metadata={"Date": None})
    print(PICTURE, PICTURE.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
