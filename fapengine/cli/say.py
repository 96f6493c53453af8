"""``fapengine say``: a sentence to a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared


def say(
    voice: shared.VoiceOptions,
    manner: shared.MannerOptions,
    drawing: shared.DrawingOptions,
    avatar: shared.AvatarOptions,
    live_output: shared.LiveOptions,
    text: Annotated[
        str | None, typer.Argument(help="What to say; - reads it from standard input. Not with --mic.")
    ] = None,
    output: shared.Output = Path("out/talk.mp4"),
    shapes: shared.Shapes = None,
    head: shared.HeadName = "default",
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
    live: Annotated[
        bool,
        typer.Option(
            "--live",
            help="Speak and move now, in a window or on the terminal; writes no file.",
            rich_help_panel=shared.LIVE,
        ),
    ] = False,
    mic: Annotated[
        bool,
        typer.Option(
            "--mic",
            help="With --live and without a text: the microphone moves the face, half a second behind it. Ctrl-C ends.",
            rich_help_panel=shared.LIVE,
        ),
    ] = False,
    mic_device: Annotated[
        str | None,
        typer.Option(
            "--mic-device",
            metavar="DEVICE",
            help="Of --mic: a number or a part of its name; `fapengine doctor` lists them.",
            rich_help_panel=shared.LIVE,
        ),
    ] = None,
    ear: Annotated[
        Path | None,
        typer.Option("--ear", metavar="EAR", help="Of --mic: what hears, as of animate.", rich_help_panel=shared.LIVE),
    ] = None,
    window: Annotated[
        bool | None,
        typer.Option(
            "--window/--no-window",
            help="Of --live; by default where there is a display.",
            rich_help_panel=shared.LIVE,
        ),
    ] = None,
) -> None:
    """Say a sentence: writes a video of a talking face, its FAPs, the sound, and a picture of every phone.

        fapengine say "Hello there." --expression joy:0.4 -o out/hello.mp4
        fapengine say "[laughs] Oh really? 🤔 Yes." -o out/marks.mp4
        fapengine say "Hello there." --into avatar.glb -o out/hello.glb
        fapengine say "Hello there." --live
        fapengine say --live --mic --sink vmc://127.0.0.1

    Beside OUT.mp4 stand OUT.fap, OUT.wav and OUT.png (contact sheet); so they do beside an animation, or a folder of
    numbered pictures. Marks in the text move the face and are not spoken.

    With --live nothing is written: the sound is played, and the face follows the sound card's clock. With --live --mic
    nobody need write a text: you say it.
    """
    import sys

    from fapengine.app.mouth_cues import RHUBARB
    from fapengine.app.performance import LEAD_S, TAIL_S, perform
    from fapengine.app.report import Report
    from fapengine.app.talk import check, outputs_of, refuse_unknown
    from fapengine.cli._progress import working
    from fapengine.cli._talking import print_reports, write
    from fapengine.cli._verb import with_flags
    from fapengine.errors import UsageError
    from fapengine.files.paths import is_standard, standard_output
    from fapengine.speech.marks import read_marks
    from fapengine.speech.text.normal_form import decoded, speakable

    output = standard_output(output, ".json" if shapes == RHUBARB else ".fap")
    chosen, how, into = manner.value(), drawing.value(), avatar.value()
    if mic or mic_device is not None:
        if text is not None or not live:
            given = f"the text {text!r:.40}" if text is not None else "no --live"
            raise UsageError(f"--mic: got {given} with it, expected --live and no text")
        from fapengine.cli._say_live import listen_now, print_heard

        heard = listen_now(mic_device, chosen, live_output.value(), ear=ear, head=head, drawing=how, window=window)
        print_heard(heard, as_json=as_json)
        return
    if text is None:
        raise UsageError("text: got none, expected what to say; --live --mic lets you say it")
    check(output, chosen, how, shapes=shapes, into=into)
    if not live:
        writing.check(
            outputs_of(output, sound=True), [head, manner.profile, drawing.background, avatar.into, avatar.mapping]
        )
    report = Report(shows=working)
    if text == "-" and sys.stdin is None:
        raise UsageError("text: got -, but standard input is closed; expected a text")
    words = decoded(sys.stdin.buffer.read()) if text == "-" else text
    with report.stage("voice"):
        speech = voice.value().load().speak(words).padded(lead_s=LEAD_S, tail_s=TAIL_S)
    marked = read_marks(words, ssml=voice.ssml)
    shown = " ".join(speakable(marked.text).text.split()) if voice.ssml else speakable(marked.text).text.strip()
    for remark in speech.remarks:
        typer.echo(f"fapengine: {with_flags(remark, {'ssml=True': '--ssml'})}", err=True)
    if strict:
        refuse_unknown(speech.phones, f"voice {voice.voice}")
    if live:
        from fapengine.cli._say_live import print_live, say_now

        done = say_now(
            speech, shown, chosen, live_output.value(), head=head, drawing=how, window=window,
        )  # fmt: skip
        print_live(done, as_json=as_json)
        return
    with report.stage("plan"):
        performance = perform(
            speech.phones, (speech.samples, speech.sample_rate_hz), chosen, text=shown, marks=speech.marks
        )
    write(performance, output, report, head=head, drawing=how, into=into)
    print_reports([report], as_json=as_json, err=is_standard(output))
