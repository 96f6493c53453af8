"""Quality of the recognizers: lips by the phones that they hear, against those by the true phones and filmed lips.

    python -m bench.recognizers [--filmed FOLDER] [--noise DB] [--long MINUTES] [--languages]
    python -m bench.recognizers [--filmed FOLDER] --transcripts SENTENCES

Speech: ten sentences in each of flite's four voices, whose phones are known (Debian's flite). Figures: correlation of
the planner's opening of the lips (60 Hz) over a sentence, median, lowest tenth and worst; the same while somebody
speaks, all sentences in one, because a mouth that is shut in the silences is right there whatever else it does; p b m
that have one within 80 ms, and recognized ones without a true one; median error of the starts of phones.
``--filmed`` is a folder with ``sentences.tsv`` (id, text), the sounds, and ``../speech_train.npz``, whose lips are the
truth. Speed is that of one core (processor time). ``--long`` also hears a recording of so many minutes, made of the
sentences, with the text and without, and measures memory and speed.
``--languages`` aligns eight other languages, spoken by four speakers of espeak-ng other than the one who pronounces the
words for the aligner; all are one program's, and some sound unlike people.

Sound alone is streamed 150 ms behind. The small network was trained on other sentences of the same four voices;
``--weights FILE`` hears with other weights (``bench.recognizer_train --without``), ``--voices`` with some of the
voices alone.

``--transcripts`` measures instead how transcripts fare in bad sound: so many sentences, drawn with a fixed seed, filmed
ones or flite's (the limits were chosen on the filmed ones), in clean sound, through a telephone, in pink noise and in a
room. Figures: correlation of a whole sentence (median) and while speaking, right texts that are refused, refused texts
of another of these sentences (filmed ones share words), and refused ones of :data:`SENTENCES`.

To compare another recognizer, add a row to :data:`RECOGNIZERS`.
"""

import argparse
import os
import resource
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from bench.rivals import rivals
from fapengine.app.hearing import MAX_UNHEARD
from fapengine.files.sound import load_sound
from fapengine.recognition.loudness import loudness_db
from fapengine.recognition.protocol import RATE_HZ, Recognizer
from fapengine.recognition.recording import follow, listen
from fapengine.recognition.small_net import read_weights
from fapengine.recognition.small_recognizer import JointRecognizer, SmallRecognizer
from fapengine.recognition.sphinx import words_of
from fapengine.recognition.sphinx_aligner import SphinxAligner
from fapengine.recognition.sphinx_recognizer import SphinxRecognizer
from fapengine.speech.phone_track import PhoneTrack
from fapengine.voices.espeak import EspeakVoice
from tests.unit.recognition.speech import (
    VOICES,
    Spoken,
    closures,
    in_noise,
    in_room,
    met,
    opening_mm,
    over_telephone,
    spoken,
    spoken_by_espeak,
)

SENTENCES = (
    "Bright sunshine shimmers on the ocean.", "My baby brother bumped the big blue bowl.",
    "Please give me five more minutes before you leave.", "The weather forecast for tomorrow is probably wrong.",
    "Many people prefer to walk home from the market.", "What time does the first train to Birmingham depart?",
    "A voice agent needs a face that people can read.", "Vivid purple poppies bloom behind the barn.",
    "Thank you very much for calling, how may I help you?", "She used the phone to book a table for four.",
)  # fmt: skip
OTHER_LANGUAGES = {
    "de": (
        "Guten Morgen, wie geht es Ihnen heute?", "Mein Bruder wohnt seit vielen Jahren in Hamburg.",
        "Wir möchten bitte zwei Tassen Kaffee bestellen.", "Am Abend spielen die Kinder gern im Park.",
    ),
    "fr": (
        "Bonjour, comment allez-vous aujourd'hui?", "Mon petit frère habite à Paris depuis longtemps.",
        "Nous voudrions deux tasses de café, s'il vous plaît.", "Le soir, les enfants jouent dans le parc.",
    ),
    "es": (
        "Buenos días, cómo está usted hoy?", "Mi hermano pequeño vive en Barcelona desde hace mucho tiempo.",
        "Por favor, queremos dos tazas de café.", "Por la tarde los niños juegan en el parque.",
    ),
    "it": (
        "Buongiorno, come sta oggi?", "Mio fratello abita a Palermo da molti anni.",
        "Vorremmo due tazze di caffè, per favore.", "La sera i bambini giocano volentieri nel parco.",
    ),
    "ru": (
        "Доброе утро, как вы себя чувствуете?", "Мой брат много лет живёт в Москве.",
        "Мы хотели бы заказать две чашки кофе.", "Вечером дети играют в парке.",
    ),
    "nl": (
        "Goedemorgen, hoe gaat het met u?", "Mijn broer woont al jaren in Utrecht.",
        "Wij willen graag twee koppen koffie, alstublieft.", "Morgen komen de kinderen bij ons spelen.",
    ),
    "pt": (
        "Bom dia, como vai o senhor?", "O meu irmão mora em Lisboa há muitos anos.",
        "Queremos duas xícaras de café, por favor.", "À tarde as crianças brincam no parque.",
    ),
    "pl": (
        "Dzień dobry, jak się pan czuje?", "Mój brat mieszka w Warszawie od wielu lat.",
        "Poproszę dwie filiżanki kawy.", "Po południu dzieci bawią się w parku.",
    ),
}  # fmt: skip
SPEAKERS = ("f2", "m1", "m3", "pablo")
LATE_S = 0.083
FILMED_HZ = 25.0
UPPER, LOWER = 13, 14
"""Numbers of the inner lips' middles among MediaPipe's points."""

Array = np.ndarray


def pronounce(word: str):
    return EspeakVoice("en-us").speak(word).phones.phones


def aligned(speech: Spoken) -> PhoneTrack:
    return follow([speech.samples], SphinxAligner(words_of(speech.text), pronounce)).phones


def alone(speech: Spoken) -> PhoneTrack:
    return listen([speech.samples]).phones


class Streamed:
    """A recognizer as it hears live, new for each sentence, made for the first. Stateful."""

    def __init__(self, make: Callable[[], Recognizer]) -> None:
        self._make = make

    @cached_property
    def _recognizer(self) -> Recognizer:
        return self._make()

    def __call__(self, speech: Spoken) -> PhoneTrack:
        """Hear a sentence."""
        self._recognizer.reset()
        return PhoneTrack.from_phones(self._recognizer.push(speech.samples) + self._recognizer.end())


RECOGNIZERS: dict[str, Callable[[Spoken], PhoneTrack]] = {
    "with the text": aligned,
    "sound alone": alone,
    "sound alone, streamed: sphinx": Streamed(partial(SphinxRecognizer, 0.15)),
    "sound alone, streamed: small": Streamed(partial(SmallRecognizer, 0.15)),
    "sound alone, streamed: both": Streamed(partial(JointRecognizer, 0.15)),
    **rivals(),
}
"""Name to what makes phones of a sentence; rivals where ``make oracles`` installed them."""


@dataclass(frozen=True)
class Clip:
    """A sentence with the opening of the lips that is taken for true."""

    speech: Spoken
    opening: Array
    rate_hz: float


def loudness_opening(clip: Clip) -> Array:
    """Open as wide as it is loud: what companion apps do."""
    levels = 10 ** (loudness_db(clip.speech.samples) / 20)
    smooth = np.convolve(levels, np.ones(8) / 8, mode="same")
    return np.interp(np.arange(len(clip.opening)) / clip.rate_hz, np.arange(len(smooth)) / 100, smooth)


def likeness(one: Array, other: Array) -> float:
    return 0.0 if not one.std() or not other.std() else float(np.corrcoef(one, other)[0, 1])


def while_speaking(clips: Sequence[Clip], openings: Sequence[Array]) -> float:
    """Correlation from the first phone of each sentence to its last, all sentences in one."""
    shown, true = [], []
    for clip, opening in zip(clips, openings, strict=True):
        said = [phone for phone in clip.speech.phones.phones if not phone.is_silence]
        at_s = np.arange(len(clip.opening)) / clip.rate_hz
        speaking = (at_s >= said[0].start_s) & (at_s <= said[-1].end_s)
        shown.append(opening[speaking])
        true.append(clip.opening[speaking])
    return likeness(np.concatenate(shown), np.concatenate(true))


def processor_s() -> float:
    """Time that this process and those that it started have worked."""
    return sum(os.times()[:4])


def figures(name: str, clips: Sequence[Clip], hear: Callable[[Spoken], PhoneTrack], *, phones: bool) -> str:
    off_s, asked, hits, told, false = [], 0, 0, 0, 0
    shown: list[Array] = []
    began_s = processor_s()
    tracks = [hear(clip.speech) for clip in clips]
    took_s = processor_s() - began_s
    for clip, track in zip(clips, tracks, strict=True):
        opening = opening_mm(track, len(clip.opening) / clip.rate_hz, clip.rate_hz)
        shown.append(opening)
        truth, found = closures(clip.speech.phones), closures(track)
        asked, hits = asked + len(truth), hits + met(truth, found)
        told, false = told + len(found), false + len(found) - met(found, truth)
        starts = np.array([phone.start_s for phone in track.phones])
        off_s += [float(np.abs(starts - phone.start_s).min()) for phone in clip.speech.phones.phones if len(starts)]
    sound_s = sum(len(clip.speech.samples) for clip in clips) / RATE_HZ
    row = likenesses(name, clips, shown)
    if phones:
        row += f"  {hits}/{asked} {100 * hits / asked:5.1f} %  {false}/{told} {100 * false / max(told, 1):4.1f} %"
        row += f"  {1000 * np.median(off_s):4.0f} ms"
    return f"{row}  {sound_s / took_s:5.1f} x real time"


def likenesses(name: str, clips: Sequence[Clip], openings: Sequence[Array]) -> str:
    r = [likeness(opening, clip.opening) for opening, clip in zip(openings, clips, strict=True)]
    speaking = while_speaking(clips, openings)
    return f"{name:38s} {np.median(r):6.3f} {np.percentile(r, 10):6.3f} {min(r):6.3f} {speaking:8.3f}"


def spoken_clips(voices: Sequence[str] = VOICES) -> list[Clip]:
    clips = []
    for voice in voices:
        for text in SENTENCES:
            speech = spoken(voice, text)
            clips.append(Clip(speech, opening_mm(speech.phones, len(speech.samples) / RATE_HZ), 60.0))
    return clips


def filmed_clips(folder: Path) -> list[Clip]:
    from fapengine.speech.alphabets.convert import SILENCES, to_ipa
    from fapengine.speech.phone_track import SILENCE, Phone

    data = np.load(folder.parent / "speech_train.npz", allow_pickle=False)
    points = data["marker_mediapipe"].tolist()
    steps = data["marker_delta"].T.astype(np.int32)
    clips = []
    for line in (folder / "sentences.tsv").read_text().split("\n"):
        name, _, text = line.partition("\t")
        if not text:
            continue
        index = data["ids"].tolist().index(name)
        start, length = int(data["offset"][index]), int(data["n_frames"][index])
        moved = np.cumsum(steps[start : start + length], axis=0).reshape(length, -1, 3) * float(data["marker_step_mm"])
        opening = moved[:, points.index(UPPER), 1] - moved[:, points.index(LOWER), 1]
        mine = np.flatnonzero(data["phone_clip"] == index)
        phones = [
            Phone(
                SILENCE if label.lower() in SILENCES else to_ipa(label, "arpabet")[0],
                float(data["phone_start"][n]), float(data["phone_end"][n]),
            )
            for n, label in zip(mine, data["phone"][mine].tolist(), strict=True)
        ]  # fmt: skip
        samples, _ = load_sound(folder / f"{name}.flac", rate_hz=RATE_HZ)
        clips.append(Clip(Spoken(text, samples, PhoneTrack.from_phones(phones, tolerance_s=0.01)), opening, FILMED_HZ))
    return clips


def in_pink_noise(clips: Sequence[Clip], snr_db: float | None) -> list[Clip]:
    """The same sentences beside noise, if a ratio is given."""
    if snr_db is None:
        return list(clips)
    return [
        replace(clip, speech=replace(clip.speech, samples=in_noise(clip.speech.samples, snr_db, seed)))
        for seed, clip in enumerate(clips)
    ]


def in_bad_sound(clips: Sequence[Clip]) -> dict[str, list[Clip]]:
    def changed(change: Callable[[Array, int], Array]) -> list[Clip]:
        return [
            replace(clip, speech=replace(clip.speech, samples=change(clip.speech.samples, seed)))
            for seed, clip in enumerate(clips)
        ]

    return {
        "clean": list(clips),
        "telephone": changed(lambda samples, _: over_telephone(samples)),
        "pink noise, 5 dB": changed(lambda samples, seed: in_noise(samples, 5.0, seed)),
        "reverberation, .6 s": changed(in_room),
    }


def another(text: str, texts: Sequence[str], number: int) -> str:
    others = [one for one in dict.fromkeys(texts) if one != text]
    return others[number % len(others)]


def transcripts(clips: Sequence[Clip]) -> None:
    print(f"{'':20s} {'r':>6s} {'speaking':>8s}  refused: right, another of these, one of SENTENCES")
    texts = [clip.speech.text for clip in clips]
    for name, changed in in_bad_sound(clips).items():
        shown, refused = [], [0, 0, 0]
        for index, clip in enumerate(changed):
            own = clip.speech.text
            for kind, text in enumerate((own, another(own, texts, index), another(own, SENTENCES, index))):
                recording = follow([clip.speech.samples], SphinxAligner(words_of(text), pronounce))
                refused[kind] += recording.unheard > MAX_UNHEARD
                if kind == 0:
                    shown.append(opening_mm(recording.phones, len(clip.opening) / clip.rate_hz, clip.rate_hz))
        r = np.median([likeness(opening, clip.opening) for opening, clip in zip(shown, changed, strict=True)])
        counts = ", ".join(f"{count}/{len(clips)}" for count in refused)
        print(f"{name:20s} {r:6.3f} {while_speaking(changed, shown):8.3f}  {counts}", flush=True)


def language_clips(language: str) -> list[Clip]:
    clips = []
    for text, speaker in zip(OTHER_LANGUAGES[language], SPEAKERS, strict=True):
        speech = spoken_by_espeak(f"{language}+{speaker}", text)
        clips.append(Clip(speech, opening_mm(speech.phones, len(speech.samples) / RATE_HZ), 60.0))
    return clips


def languages() -> None:
    print("\nother languages, with the text")
    for language in OTHER_LANGUAGES:

        def said(word: str, language: str = language):
            return EspeakVoice(language).speak(word).phones.phones

        def hear(speech: Spoken, said=said) -> PhoneTrack:
            return follow([speech.samples], SphinxAligner(words_of(speech.text), said, dictionary=False)).phones

        print(figures(language, language_clips(language), hear, phones=True), flush=True)


def table(title: str, clips: list[Clip], *, phones: bool) -> None:
    print(f"\n{title}: {len(clips)} sentences")
    head = f"{'':38s} {'r':>6s} {'10 %':>6s} {'worst':>6s} {'speaking':>8s}"
    print(head + ("  p b m met       false       starts" if phones else ""))
    for name, hear in RECOGNIZERS.items():
        print(figures(name, clips, hear, phones=phones), flush=True)
    print(likenesses("loudness (control)", clips, [loudness_opening(clip) for clip in clips]))
    true = [opening_mm(c.speech.phones, len(c.opening) / c.rate_hz, c.rate_hz) for c in clips]
    late = [np.roll(opening, round(LATE_S * clip.rate_hz)) for opening, clip in zip(true, clips, strict=True)]
    print(likenesses("the true phones, 83 ms late (control)", clips, late))
    if not phones:
        print(likenesses("the true phones", clips, true))


def long_recording(minutes: float) -> None:
    parts = [spoken("rms", text) for text in SENTENCES]
    pause = np.zeros(RATE_HZ // 2, np.int16)
    once_s = sum(len(part.samples) + len(pause) for part in parts) / RATE_HZ
    rounds = max(round(60 * minutes / once_s), 1)
    words = words_of(" ".join(SENTENCES)) * rounds
    truth, start_s = [], 0.0
    for part in parts * rounds:
        truth += [start_s + at_s for at_s in closures(part.phones)]
        start_s += (len(part.samples) + len(pause)) / RATE_HZ
    for name, hear in (
        ("with the text", lambda sound, heard: follow(sound, SphinxAligner(words, pronounce), on_heard=heard)),
        ("sound alone", lambda sound, heard: listen(sound, on_heard=heard)),
    ):
        pieces = (samples for _ in range(rounds) for part in parts for samples in (part.samples, pause))
        grown: list[float] = []
        began_s = processor_s()
        recording = hear(pieces, lambda _, grown=grown: grown.append(resident_mib()))
        took_s = processor_s() - began_s
        hits = met(truth, closures(recording.phones))
        print(
            f"\n{start_s / 60:.1f} minutes, {name}: {start_s / took_s:.1f} x real time, p b m met {hits}/{len(truth)}"
        )
        print(f"{len(recording.mismatches)} mismatches; memory {grown[len(grown) // 5]:.0f} MiB after a fifth of it,")
        print(f"{grown[-1]:.0f} MiB at the end", flush=True)


def resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--filmed", type=Path, help="folder of sounds whose lips are filmed")
    parser.add_argument("--noise", type=float, metavar="DB", help="beside pink noise of this ratio")
    parser.add_argument("--long", type=float, default=0.0, metavar="MINUTES")
    parser.add_argument("--languages", action="store_true", help="eight other languages as well")
    parser.add_argument("--transcripts", type=int, metavar="SENTENCES", help="transcripts in bad sound, instead")
    parser.add_argument("--weights", type=Path, help="other weights of the small recognizer; only it is measured then")
    parser.add_argument("--voices", nargs="+", choices=VOICES, default=VOICES, metavar="VOICE")
    options = parser.parse_args()
    if options.transcripts:
        clips = filmed_clips(options.filmed) if options.filmed else spoken_clips(options.voices)
        chosen = np.random.default_rng(1).permutation(len(clips))[: options.transcripts]
        transcripts([clips[index] for index in chosen])
        return
    if options.weights:
        weights = read_weights(options.weights.read_bytes())
        RECOGNIZERS.clear()
        RECOGNIZERS["small"], RECOGNIZERS["both"] = (
            Streamed(partial(SmallRecognizer, weights=weights)),
            Streamed(partial(JointRecognizer, weights=weights)),
        )
    if options.languages:
        languages()
    flite = in_pink_noise(spoken_clips(options.voices), options.noise)
    table(f"flite, {', '.join(options.voices)}", flite, phones=True)
    if options.filmed:
        table("filmed lips", in_pink_noise(filmed_clips(options.filmed), options.noise), phones=False)
    if options.long:
        long_recording(options.long)


if __name__ == "__main__":
    main()
