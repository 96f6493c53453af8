"""``fapengine align``: find the phones of a recording, with or without a transcript."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared
from fapengine.cli._hearing import RecognitionOptions, hear_with_bar


def align(
    sound: Annotated[Path, typer.Argument(help="Recording: WAV, FLAC, MP3, Ogg, Opus, M4A or any video.")],
    recognition: RecognitionOptions = RecognitionOptions(),
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Output file: .TextGrid (Praat), .ctm (Kaldi), .json or .pho (MBROLA)."),
    ] = Path("out/talk.TextGrid"),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Find the time of each phone in a recording.

        fapengine align talk.wav --transcript-file talk.txt -o talk.TextGrid
        fapengine align talk.wav -o talk.json    # without a transcript

    With a transcript (--transcript, --transcript-file), half of the phones are within 10 ms of their true times.
    Without one, one in ten of p, b and m is missed. Correct a TextGrid by hand in Praat, then use it with
    `fapengine animate`.
    """
    from dataclasses import replace

    from fapengine.app.hearing import write_phones
    from fapengine.cli._printing import print_result, print_rows
    from fapengine.speech.formats.writing import check_writable

    check_writable(output.suffix)
    tracks = recognition.channels(sound, output)
    writing.check([path for _, path in tracks], [sound, recognition.text, recognition.recognizer])
    how = recognition.value()
    results = []
    for number, path in tracks:
        hearing = hear_with_bar(sound, replace(how, channel=number))
        write_phones(hearing, path)
        spoken = sum(not phone.is_silence for phone in hearing.phones.phones)
        results.append({
            "file": str(path), "duration_s": hearing.phones.duration_s, "phones": spoken,
            "heard": list(hearing.notes),
            "mismatches": [
                {"start_s": each.start_s, "end_s": each.end_s, "words": list(each.words)} for each in hearing.mismatches
            ],
        })  # fmt: skip
        if not as_json:
            rows = [("phones", path, "bold"), ("speech", f"{hearing.phones.duration_s:.2f} s, {spoken} phones")]
            print_rows([*rows, *(("heard", note, "yellow") for note in hearing.notes)])
    if as_json:
        print_result(results[0] if len(results) == 1 else results, as_json=True)
