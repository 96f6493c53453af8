"""``fapengine animate``: a recording, or phone timings and their sound, to a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import _hearing
from fapengine.cli import options as shared


def animate(
    source: Annotated[
        Path, typer.Argument(help="Sound or video; or phone timings, whose format is found from the content.")
    ],
    manner: shared.MannerOptions,
    drawing: shared.DrawingOptions,
    avatar: shared.AvatarOptions,
    audio: Annotated[
        Path | None, typer.Option("--audio", "-a", help="The sound of timings: WAV, MP3, FLAC, Ogg or any video.")
    ] = None,
    output: shared.Output = Path("out/talk.mp4"),
    shapes: shared.Shapes = None,
    text: _hearing.Text = None,
    transcript: _hearing.Transcript = None,
    language: _hearing.Language = "en-us",
    channel: _hearing.Channel = None,
    ear: _hearing.EarModel = None,
    voice: Annotated[
        str, typer.Option("--voice", "-v", help="Whose pronunciation, where the timings have words only.")
    ] = "en-us",
    head: shared.HeadName = "default",
    strict: shared.Strict = False,
    timings: shared.TimingOptions = shared.TimingOptions(),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Animate a recording, or phone timings that another tool made.

        fapengine animate talk.wav --text talk.txt -o out/talk.mp4
        fapengine animate talk.TextGrid --audio talk.wav -o out/talk.mp4
        fapengine animate talk.wav --into avatar.glb -o out/spoken.glb
        fapengine animate two.wav --channel each -o out/two.mp4    # two speakers

    Phones of a recording are heard: with its words (--text, --transcript) about as well as if they were timed by hand;
    without them the mouth still follows. Music and noise do not move it.

    Two speakers in two channels give two tracks: out/two-1.mp4 and out/two-2.mp4.
    """
    from fapengine.app.hearing import is_sound, with_loudness
    from fapengine.app.mouth_cues import RHUBARB
    from fapengine.app.performance import perform, pronounced
    from fapengine.app.report import Report
    from fapengine.app.talk import check, outputs_of, refuse_unknown
    from fapengine.cli._hearing import channels_of, hear_with_bar, transcript_of
    from fapengine.cli._progress import working
    from fapengine.cli._talking import print_reports, write
    from fapengine.errors import UsageError
    from fapengine.files.paths import is_standard, standard_output
    from fapengine.files.sound import load_sound

    listens = is_sound(source)
    of_timings = {"--audio": audio, **timings.given}
    of_sound = {"--text": text, "--transcript": transcript, "--ear": ear}
    for name, value in (of_timings if listens else of_sound).items():
        if value is not None:
            kind = (
                "a recording; expected phone timings" if listens else "no name of a recording; expected .wav, .mp3, ..."
            )
            raise UsageError(f"{name}: got {value}, but {source} is {kind} with it")
    output = standard_output(output, ".json" if shapes == RHUBARB else ".fap")
    chosen, how, into = manner.value(), drawing.value(), avatar.value()
    inputs = [source, *([audio] if audio else [])]
    has_words = text is not None or transcript is not None
    tracks = channels_of(channel, source if listens else None, output, has_words=has_words)
    for _, path in tracks:
        check(path, chosen, how, shapes=shapes, into=into)
    has_sound = listens or audio is not None
    writing.check(
        [name for _, path in tracks for name in outputs_of(path, sound=has_sound, inputs=inputs, recording=True)],
        [*inputs, text, ear, head, manner.profile, drawing.background, avatar.into, avatar.mapping],
    )
    words = transcript_of(text, transcript) if listens else None
    reports: list[Report] = []
    for number, path in tracks:
        report = Report(shows=working)
        reports.append(report)
        if listens:
            with report.stage("listen"):
                hearing = hear_with_bar(source, transcript=words, language=language, channel=number, ear=ear)
            phones, report.notes = hearing.phones, hearing.notes
        else:
            with report.stage("read"):
                phones = pronounced(timings.load(source), voice)
        with report.stage("read"):
            recording = source if listens else audio
            sound = load_sound(recording, channel=number) if recording else None
            if sound is not None and not listens:
                phones = with_loudness(phones, *sound)
        if strict:
            refuse_unknown(phones, str(source))
        with report.stage("plan"):
            performance = perform(phones, sound, chosen, text=source.name)
        for remark in performance.remarks:
            typer.echo(f"fapengine: {remark}", err=True)
        write(performance, path, report, head=head, drawing=how, inputs=inputs, recording=recording, into=into)
    print_reports(reports, as_json=as_json, err=is_standard(output))
