"""Audio, video, images, and phone timings."""

from typing import Any

import numpy as np

from fapengine.app.inspection.report import FileKind, Report, Source, Table, level_bars
from fapengine.errors import DataError
from fapengine.files.pictures import draw_timeline, opened
from fapengine.files.sound import SOUND_SUFFIXES, inspect_sound, stream_sound
from fapengine.files.timings import load_timings
from fapengine.files.video import inspect_film
from fapengine.speech import ipa
from fapengine.speech.formats.registry import FORMATS, guess_format
from fapengine.speech.phone_track import PhoneTrack, find_unknown
from fapengine.speech.plausible import remarks_on

PIECE_S, FLOOR_DB = 0.05, -60.0
"""Length of a piece of sound whose level is plotted, and the level below which nothing is drawn."""
IMAGE_FORMATS = {".gif": "GIF", ".webp": "WEBP", ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}


def _recording(source: Source) -> Report:
    facts, levels = describe_recording(source)
    text = []
    if film := facts.get("film"):
        text.append(f"film: {film['width']}x{film['height']}, {film['rate_hz']:g} frames/s, {film['codec']}")
    sound = facts.get("sound")
    if sound is None:
        return Report(facts=facts, text=[*text, "no sound"], plot="has no sound, so there is nothing to plot")
    channels = "mono" if sound["channels"] == 1 else f"{sound['channels']} channels"
    text.append(f"sound: {sound['seconds']:.2f} s, {sound['sample_rate_hz']} Hz, {channels}")
    text.append(f"level: {sound['level_db']:.1f} dB, peak {sound['peak_db']:.1f} dB below full scale")
    if sound["clipped"]:
        text.append(f"{sound['clipped']} samples at full scale: it may be clipped")
    above = np.maximum(np.array(levels) - FLOOR_DB, 0)
    title = f"Level in pieces of {PIECE_S:g} s, dB above {FLOOR_DB:g} dB of full scale"
    return Report(facts=facts, text=text, plot=lambda: level_bars(above, title, sound["seconds"]))


def describe_recording(source: Source) -> tuple[dict[str, Any], list[float]]:
    """Make the values of a sound or a video, and the level of each piece of :data:`PIECE_S`, dB against full scale.

    Levels are of the mean of all channels.
    """
    film = inspect_film(source.path)
    facts: dict[str, Any] = {"format": "film" if film else "sound"}
    levels: list[float] = []
    if film:
        facts["film"] = {
            "width": film.width, "height": film.height, "rate_hz": film.rate_hz, "codec": film.codec,
        }  # fmt: skip
        if not film.has_sound:
            return facts, levels
    info = inspect_sound(source.path)
    length = max(int(PIECE_S * info.sample_rate_hz), 1)
    count, power, peak, clipped = 0, 0.0, 0, 0
    rest = np.zeros(0)
    for piece in stream_sound(source.path):
        size = np.abs(piece.astype(np.int64))
        rest = np.concatenate([rest, size])
        whole = rest[: len(rest) // length * length].reshape(-1, length)
        levels += [_db(float(np.sqrt((block**2).mean()))) for block in whole]
        rest = rest[whole.size :]
        count, power = count + len(piece), power + float((size.astype(np.float64) ** 2).sum())
        peak, clipped = max(peak, int(size.max(initial=0))), clipped + int((size >= np.iinfo(np.int16).max).sum())
    if not count:
        raise DataError(f"{source.path}: contains no audio")
    if len(rest):
        levels.append(_db(float(np.sqrt((rest**2).mean()))))
    facts["sound"] = {
        "seconds": count / info.sample_rate_hz, "sample_rate_hz": info.sample_rate_hz, "channels": info.channels,
        "level_db": _db((power / count) ** 0.5), "peak_db": _db(peak), "clipped": clipped,
    }  # fmt: skip
    return facts, levels


def _db(size: float) -> float:
    """Level against full scale, dB; -120 for silence."""
    return round(20 * float(np.log10(max(size / 32768, 1e-6))), 1)


def _image(source: Source) -> Report:
    """Describe an image or an animation."""
    with opened(source.data, tuple(dict.fromkeys(IMAGE_FORMATS.values())), str(source.path)) as image:
        frames, duration_ms = getattr(image, "n_frames", 1), 0
        for number in range(frames):
            image.seek(number)
            image.load()
            duration_ms += image.info.get("duration", 0)
        facts = {
            "format": str(image.format), "width": image.width, "height": image.height, "frames": frames,
            "seconds": duration_ms / 1000,
        }  # fmt: skip
    moving = f", {facts['frames']} frames, {facts['seconds']:.2f} s" if frames > 1 else ""
    text = [f"{facts['format']}: {facts['width']}x{facts['height']}{moving}"]
    return Report(facts=facts, text=text, plot="is an image itself, so there is nothing to plot")


RECORDING = FileKind(
    name="audio, video",
    endings=tuple(sorted(SOUND_SUFFIXES)),
    fits=lambda source: source.format is None and source.ending in SOUND_SUFFIXES,
    describe=_recording,
)
IMAGE = FileKind(
    name="an image", endings=tuple(IMAGE_FORMATS), fits=lambda source: source.ending in IMAGE_FORMATS, describe=_image
)


ROWS_SHOWN = 40
BAR = 24
"""Characters of the longest bar."""


def _timings(source: Source) -> Report:
    track = load_timings(
        source.path, format=source.format, tier=source.tier, alphabet=source.alphabet, columns=source.columns
    )
    found = FORMATS.get(source.format or "") or guess_format(source.data, ending=source.path.suffix)
    facts = describe_timings(track, found.name if found else "", found.tool if found else "")
    text: list[str | Table] = [
        f"{facts['format']} ({facts['tool']}): {facts['phones']} {facts['level']}s,"
        f" {facts['speech_s']:.2f} s of speech in {facts['duration_s']:.2f} s"
    ]
    if track.reading.alphabet:
        text.append(str(track.reading))
    if track.reading.language:
        text.append(f"language: {track.reading.language}")
    if track.spelled:
        text.append("These are words; `fapengine animate` lets a voice pronounce them.")
    text.append(_timeline(track))
    title = f"{source.path.name}: {facts['phones']} {facts['level']}s"
    return Report(facts=facts, text=text, plot=lambda: draw_timeline(track, title=title), warnings=facts["remarks"])


def describe_timings(track: PhoneTrack, found: str, tool: str) -> dict[str, Any]:
    """Make the values of a timeline."""
    spoken = [phone for phone in track.phones if not phone.is_silence]
    return {
        "format": found,
        "tool": tool,
        "level": track.level,
        "spelled": track.spelled,
        "duration_s": track.duration_s,
        "phones": len(spoken),
        "speech_s": sum(phone.duration_s for phone in spoken),
        "alphabet": track.reading.alphabet,
        "alphabet_guessed": track.reading.guessed,
        "alphabet_could_be": list(track.reading.others),
        "language": track.reading.language,
        "remarks": list(remarks_on(track)),
        "unknown": [] if track.spelled else [str(each) for each in find_unknown(track)],
        "timeline": [
            {"start_s": p.start_s, "end_s": p.end_s, "label": p.label, "stress": p.stress, "word": p.word}
            for p in track.phones
        ],
    }


def _timeline(track: PhoneTrack) -> Table:
    """Make a row of each phone; silences are dim, unknown phones yellow."""
    longest_s = max((phone.duration_s for phone in track.phones), default=1.0)
    rows, styles, word = [], [], ""
    for phone in track.phones:
        strange = not (phone.is_silence or track.spelled or ipa.letters(phone.label))
        styles.append("dim" if phone.is_silence else "yellow" if strange else "")
        mark = {1: "ˈ", 2: "ˌ"}.get(phone.stress, "")
        rows.append([
            f"{phone.start_s:.3f}", f"{phone.end_s:.3f}", f"{phone.duration_s * 1000:.0f}", mark + phone.label,
            phone.word if phone.word != word else "", "━" * max(1, round(BAR * phone.duration_s / longest_s)),
        ])  # fmt: skip
        word = phone.word
    return Table(
        columns=("start s", "end s", "ms", "label", "word", ""), right=3, rows=rows, styles=styles, shown=ROWS_SHOWN
    )


TIMINGS = FileKind(
    name="phone timings",
    fits=lambda source: source.format is not None or guess_format(source.data, ending=source.path.suffix) is not None,
    describe=_timings,
)
