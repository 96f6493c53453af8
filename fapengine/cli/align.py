"""``fapengine align``: a recording to timed phones, with its text or without."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import _hearing
from fapengine.cli import options as shared


def align(
    sound: Annotated[Path, typer.Argument(help="WAV, FLAC, MP3, Ogg, Opus, M4A or any video.")],
    text: _hearing.Text = None,
    transcript: _hearing.Transcript = None,
    language: _hearing.Language = "en-us",
    channel: _hearing.Channel = None,
    ear: _hearing.EarModel = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", help=".TextGrid (Praat), .ctm (Kaldi), .json or .pho (MBROLA).")
    ] = Path("out/talk.TextGrid"),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Find when each phone of a recording is said.

        fapengine align talk.wav --text talk.txt -o talk.TextGrid
        fapengine align talk.wav -o talk.json    # its words are not known

    With the words that are said (--text, --transcript) half of the phones lie within 10 ms of where they are; without
    them, one in ten of p b m is missed. A TextGrid can be mended by hand in Praat, and animated as any timings.
    """
    import json

    from rich.console import Console
    from rich.markup import escape

    from fapengine.app.hearing import write_phones
    from fapengine.cli._hearing import channels_of, hear_with_bar, transcript_of
    from fapengine.speech.formats.writing import check_writable

    check_writable(output.suffix)
    tracks = channels_of(channel, sound, output, has_words=text is not None or transcript is not None)
    writing.check([path for _, path in tracks], [sound, text, ear])
    words = transcript_of(text, transcript)
    results = []
    console = Console(highlight=False)
    for number, path in tracks:
        hearing = hear_with_bar(sound, transcript=words, language=language, channel=number, ear=ear)
        write_phones(hearing, path)
        spoken = sum(not phone.is_silence for phone in hearing.phones.phones)
        results.append({
            "file": str(path), "duration_s": hearing.phones.duration_s, "phones": spoken,
            "heard": list(hearing.notes),
            "mismatches": [
                {"start_s": each.start_s, "end_s": each.end_s, "words": list(each.words)} for each in hearing.mismatches
            ],
        })  # fmt: skip
        if as_json:
            continue
        console.print(f"[bold]{'phones':>14}[/]  {escape(str(path))}", soft_wrap=True)
        console.print(f"{'speech':>14}  {hearing.phones.duration_s:.2f} s, {spoken} phones", soft_wrap=True)
        for note in hearing.notes:
            console.print(f"[yellow]{'heard':>14}[/]  {escape(note)}", soft_wrap=True)
    if as_json:
        told = results[0] if len(results) == 1 else results
        print(json.dumps(told, indent=2, ensure_ascii=False))  # noqa: T201  the answer itself
