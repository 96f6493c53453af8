"""What ``fapengine inspect`` says about phone timings: the timeline as a table, as JSON, as a picture."""

import json
from pathlib import Path
from typing import Any

from fapengine.files.paths import read_bytes
from fapengine.files.pictures import save_png
from fapengine.files.timeline import draw_timeline
from fapengine.speech import ipa
from fapengine.speech.formats.registry import FORMATS, guess_format
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.unknown import find_unknown

FIRST_ROWS = 40
BAR = 24
"""Characters of the longest bar."""


def inspect_timings(
    path: Path,
    track: PhoneTrack,
    *,
    as_json: bool,
    everything: bool,
    plot: Path | None,
    file_format: str | None = None,
) -> None:
    """Print the timeline that was read from a file of phone timings."""
    timing_format = FORMATS.get(file_format or "") or guess_format(read_bytes(path), ending=path.suffix)
    report = describe(track, timing_format.name if timing_format else "", timing_format.tool if timing_format else "")
    if plot is not None:
        save_png(plot, draw_timeline(track, title=f"{path.name}: {report['phones']} {report['level']}s"))
    if as_json:
        import typer

        typer.echo(json.dumps(report, ensure_ascii=False))
    else:
        _print(track, report, everything=everything)


def describe(track: PhoneTrack, file_format: str, tool: str) -> dict[str, Any]:
    """Make the report as plain values."""
    spoken = [phone for phone in track.phones if not phone.is_silence]
    return {
        "format": file_format,
        "tool": tool,
        "level": track.level,
        "spelled": track.spelled,
        "duration_s": track.duration_s,
        "phones": len(spoken),
        "speech_s": sum(phone.duration_s for phone in spoken),
        "alphabet": track.reading.alphabet if track.reading else "",
        "alphabet_guessed": bool(track.reading and track.reading.guessed),
        "alphabet_could_be": list(track.reading.others) if track.reading else [],
        "unknown": [] if track.spelled else [str(each) for each in find_unknown(track)],
        "timeline": [
            {"start_s": p.start_s, "end_s": p.end_s, "label": p.label, "stress": p.stress, "word": p.word}
            for p in track.phones
        ],
    }


def _print(track: PhoneTrack, report: dict[str, Any], *, everything: bool) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    console.print(
        f"[bold]{report['format']}[/] ({report['tool']}): {report['phones']} {report['level']}s,"
        f" {report['speech_s']:.2f} s of speech in {report['duration_s']:.2f} s",
        soft_wrap=True,
    )
    if track.reading is not None:
        console.print(escape(str(track.reading)), soft_wrap=True)
    if report["spelled"]:
        console.print("These are words; `fapengine animate` lets a voice pronounce them.", soft_wrap=True)
    table = Table("start s", "end s", "ms", "label", "word", "", box=None, pad_edge=False)
    for column in table.columns[:3]:
        column.justify = "right"
    shown = track.phones if everything else track.phones[:FIRST_ROWS]
    longest_s = max((phone.duration_s for phone in shown), default=1.0)
    word = ""
    for phone in shown:
        strange = not (phone.is_silence or track.spelled or ipa.letters(phone.label))
        style = "dim" if phone.is_silence else "yellow" if strange else ""
        mark = {1: "ˈ", 2: "ˌ"}.get(phone.stress, "")
        table.add_row(
            f"{phone.start_s:.3f}", f"{phone.end_s:.3f}", f"{phone.duration_s * 1000:.0f}", escape(mark + phone.label),
            escape(phone.word if phone.word != word else ""), "━" * max(1, round(BAR * phone.duration_s / longest_s)),
            style=style,
        )  # fmt: skip
        word = phone.word
    console.print(table)
    if len(shown) < len(track.phones):
        console.print(f"... and {len(track.phones) - len(shown)} more: --all shows them")
    for unknown in () if track.spelled else find_unknown(track):
        console.print(f"[yellow]unknown phone[/] {escape(str(unknown))}", soft_wrap=True)
