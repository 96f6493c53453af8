"""``fapengine animate``: turn a recording, or phone timings, into a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared
from fapengine.cli._hearing import RecognitionOptions, hear_with_bar
from fapengine.speaking import MannerOptions


def animate(
    source: Annotated[
        Path, typer.Argument(help="Audio or video, or phone timings. The format of timings is detected.")
    ],
    manner: MannerOptions,
    drawing: shared.DrawingOptions,
    avatar: shared.AvatarOptions,
    audio: Annotated[
        Path | None, typer.Option("--audio", "-a", help="Sound of the timings: WAV, MP3, FLAC, Ogg or any video.")
    ] = None,
    output: shared.Output = Path("out/talk.mp4"),
    shapes: shared.Shapes = None,
    recognition: RecognitionOptions = RecognitionOptions(),
    voice: shared.WordsVoice = None,
    head: shared.HeadName = "default",
    strict: shared.Strict = False,
    timings: shared.TimingOptions = shared.TimingOptions(),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Animate a recording, or phone timings from another tool.

        fapengine animate talk.wav --transcript-file talk.txt -o out/talk.mp4
        fapengine animate talk.TextGrid --audio talk.wav -o out/talk.mp4
        fapengine animate talk.wav --into avatar.glb -o out/spoken.glb
        fapengine animate two.wav --channel each -o out/two.mp4    # two speakers

    The phones of a recording are recognized. With a transcript (--transcript, --transcript-file) they are nearly as
    accurate as timed by hand; without one, the mouth still follows the speech. Music and noise do not move it.

    Writes the same files next to the output as `say`, but no copy of a recording next to visemes.

    With --channel each, two speakers in two channels give two videos: out/two-1.mp4 and out/two-2.mp4.
    """
    from dataclasses import replace

    from fapengine.app.hearing import is_sound
    from fapengine.app.manner import manner_of
    from fapengine.app.outputs import EVENT_SETS, SaveOptions, check_output
    from fapengine.app.performance import animated
    from fapengine.app.report import Report
    from fapengine.app.talk import outputs_of
    from fapengine.cli._printing import print_remarks, working
    from fapengine.cli._talking import print_reports, write
    from fapengine.files.paths import is_standard, standard_output

    listens = is_sound(source)
    output = standard_output(output, ".json" if shapes in EVENT_SETS else ".fap")
    chosen, how, into = manner_of(manner), drawing.value(), avatar.value()
    inputs = [source, *([audio] if audio else [])]
    tracks = recognition.channels(source if listens else None, output)
    recording = source if listens else audio
    saving = SaveOptions(head=head, drawing=how, shapes=shapes, into=into, recording=recording)
    names = [outputs_of(path, sound=recording is not None, inputs=inputs, recording=True) for _, path in tracks]
    writing.check(
        [name for files, _ in names for name in files],
        [
            *inputs,
            recognition.text,
            recognition.recognizer,
            head,
            manner.profile,
            drawing.background,
            avatar.into,
            avatar.mapping,
        ],
        beside=[name for _, beside in names for name in beside],
    )
    check_output(output, saving, rate_hz=chosen.rate_hz)
    heard = recognition.value()
    reports: list[Report] = []
    for number, path in tracks:
        reports.append(report := Report(shows=working))
        performance = animated(
            source, audio, chosen, replace(heard, channel=number), voice=voice, how=timings.how, strict=strict,
            report=report, hears=hear_with_bar,
        )  # fmt: skip
        performance = replace(performance, text=source.name)
        print_remarks(performance.doubts)
        write(performance, path, replace(saving, report=report), inputs=inputs)
    print_reports(reports, as_json=as_json, err=is_standard(output))
