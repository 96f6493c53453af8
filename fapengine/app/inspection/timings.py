"""Phone timings."""

from typing import Any

from fapengine.app.inspection.report import FileKind, Report, Source, Table
from fapengine.files.pictures import draw_timeline
from fapengine.files.timings import load_timings
from fapengine.speech import ipa
from fapengine.speech.formats.registry import FORMATS, guess_format
from fapengine.speech.phone_track import PhoneTrack, find_unknown
from fapengine.speech.plausible import remarks_on

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
