"""``fapengine animate``: turn a recording, or phone timings, into a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import _hearing
from fapengine.cli import options as shared
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
    text: _hearing.Text = None,
    transcript: _hearing.Transcript = None,
    language: _hearing.Language = None,
    channel: _hearing.Channel = None,
    recognizer: _hearing.RecognizerName = None,
    voice: shared.WordsVoice = None,
    head: shared.HeadName = "default",
    strict: shared.Strict = False,
    timings: shared.TimingOptions = shared.TimingOptions(),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Animate a recording, or phone timings from another tool.

        fapengine animate talk.wav --text talk.txt -o out/talk.mp4
        fapengine animate talk.TextGrid --audio talk.wav -o out/talk.mp4
        fapengine animate talk.wav --into avatar.glb -o out/spoken.glb
        fapengine animate two.wav --channel each -o out/two.mp4    # two speakers

    The phones of a recording are recognized. With a transcript (--text, --transcript) they are nearly as accurate as
    timed by hand; without one, the mouth still follows the speech. Music and noise do not move it.

    With --channel each, two speakers in two channels give two videos: out/two-1.mp4 and out/two-2.mp4.
    """
    from dataclasses import replace

    from fapengine.app.hearing import is_sound, with_loudness
    from fapengine.app.manner import manner_of
    from fapengine.app.outputs import RHUBARB, SaveOptions, check_output
    from fapengine.app.performance import perform, read_timings
    from fapengine.app.report import Report
    from fapengine.app.talk import outputs_of
    from fapengine.cli._hearing import channels_of, hear_with_bar, transcript_of
    from fapengine.cli._printing import working
    from fapengine.cli._talking import print_remarks, print_reports, write
    from fapengine.errors import UsageError
    from fapengine.files.paths import is_standard, standard_output
    from fapengine.files.sound import load_sound
    from fapengine.speech.plausible import refuse

    listens = is_sound(source)
    of_timings = {"--audio": audio, **timings.given}
    of_sound = {"--text": text, "--transcript": transcript, "--recognizer": recognizer}
    for name, value in (of_timings if listens else of_sound).items():
        if value is not None:
            kind = "a recording; it needs phone timings" if listens else "not a recording; it needs .wav, .mp3, ..."
            raise UsageError(f"{name}: cannot be used here: {source} is {kind}")
    output = standard_output(output, ".json" if shapes == RHUBARB else ".fap")
    chosen, how, into = manner_of(manner), drawing.value(), avatar.value()
    inputs = [source, *([audio] if audio else [])]
    has_words = text is not None or transcript is not None
    tracks = channels_of(channel, source if listens else None, output, has_words=has_words)
    recording = source if listens else audio
    saving = SaveOptions(head=head, drawing=how, shapes=shapes, into=into, recording=recording)
    names = [outputs_of(path, sound=recording is not None, inputs=inputs, recording=True) for _, path in tracks]
    writing.check(
        [name for files, _ in names for name in files],
        [*inputs, text, recognizer, head, manner.profile, drawing.background, avatar.into, avatar.mapping],
        beside=[name for _, beside in names for name in beside],
    )
    check_output(output, saving, rate_hz=chosen.rate_hz)
    words = transcript_of(text, transcript) if listens else None
    reports: list[Report] = []
    for number, path in tracks:
        report = Report(shows=working)
        reports.append(report)
        if listens:
            with report.stage("listen"):
                hearing = hear_with_bar(
                    source, transcript=words, language=language, channel=number, recognizer=recognizer
                )
            phones, report.notes = hearing.phones, hearing.notes
        else:
            with report.stage("read"):
                phones = read_timings(source, voice, language=language, **timings.how)
        with report.stage("read"):
            spoken_s = None if listens else phones.duration_s
            sound = load_sound(recording, channel=number, spoken_s=spoken_s) if recording else None
            if sound is not None and not listens:
                phones = with_loudness(phones, *sound)
        with report.stage("plan"):
            performance = perform(phones, sound, chosen, text=source.name)
        if strict:
            refuse(performance.doubts, str(source))
        print_remarks(performance.doubts)
        write(performance, path, replace(saving, report=report), inputs=inputs)
    print_reports(reports, as_json=as_json, err=is_standard(output))
