"""``fapengine say``: turn a sentence into a talking face."""

from pathlib import Path
from typing import Annotated

import typer

from fapengine.cli import options as shared
from fapengine.speaking import SpeakingOptions


def say(
    speaking: SpeakingOptions,
    voices: shared.VoiceList,
    drawing: shared.DrawingOptions,
    avatar: shared.AvatarOptions,
    live_output: shared.LiveOptions,
    text: Annotated[
        str | None, typer.Argument(help="Text to say. Use - to read standard input. Cannot be used with --mic.")
    ] = None,
    output: shared.Output = Path("out/talk.mp4"),
    shapes: shared.Shapes = None,
    head: shared.HeadName = "default",
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
    live: Annotated[
        bool, shared.live("--live", help="Play now, in a window or in the terminal. Writes no file.")
    ] = False,
    mic: Annotated[
        bool,
        shared.live(
            "--mic",
            help="Drive the face from the microphone, with about 0.25 s of latency. Requires --live and no TEXT.",
        ),
    ] = False,
    mic_device: Annotated[
        str | None,
        shared.live(
            metavar="DEVICE",
            help="Microphone for --mic: its number, or part of its name. `fapengine doctor` lists devices.",
        ),
    ] = None,
    recognizer: Annotated[
        Path | None,
        shared.live(
            metavar="NAME",
            help="Speech recognizer for --mic: small, sphinx, both or MODEL.onnx. See `fapengine animate --help`.",
        ),
    ] = None,
    window: Annotated[
        bool | None,
        shared.live("--window/--no-window", help="Show --live in a window. Default: on if there is a display."),
    ] = None,
) -> None:
    """Turn a sentence into a talking face. Writes a video, its FAPs, the sound and a contact sheet.

        fapengine say "Hello there." --expression joy:0.4 -o out/hello.mp4
        fapengine say "[laughs] Oh really? 🤔 Yes." -o out/marks.mp4
        fapengine say "I am [Siobhan]{ʃɪˈvɔːn}." -o out/name.mp4
        fapengine say "Hello there." --into avatar.glb -o out/hello.glb
        fapengine say "Hello there." --live
        fapengine say --live --mic --sink vmc://127.0.0.1

    Also writes OUT.wav next to every output but an image; next to an avatar or a video also OUT.fap, and next to a
    video OUT.png (a contact sheet). Files of other programs are not replaced. Inline cues such as [laughs] or emoji
    move the face and are not spoken. [word]{IPA} gives the sounds of a word.

    With --live, nothing is written: the sound plays now, and the face stays in sync with it. Add --mic to speak
    yourself instead of giving a text.
    """
    import sys
    from functools import partial

    from fapengine.app.manner import manner_of, voice_of
    from fapengine.app.outputs import EVENT_SETS, SaveOptions, check_output
    from fapengine.app.performance import perform_speech, spoken
    from fapengine.app.report import Report
    from fapengine.app.talk import outputs_of
    from fapengine.cli._printing import print_remarks, working
    from fapengine.cli._talking import print_reports, write
    from fapengine.errors import UsageError
    from fapengine.files.paths import is_standard, standard_output
    from fapengine.speech.plausible import refuse, remarks_on, sound_remarks
    from fapengine.speech.text.normal_form import decoded

    output = standard_output(output, ".json" if shapes in EVENT_SETS else ".fap")
    chosen, how, into = manner_of(speaking), drawing.value(), avatar.value()
    open_face = partial(live_output.open_face, chosen)
    if mic or mic_device is not None:
        if text is not None or not live:
            need = "requires --live" if not live else "cannot be used with a text; use --live --mic without TEXT"
            raise UsageError(f"--mic: {need}")
        from fapengine.app.say_live import listen_live
        from fapengine.cli._say_live import open_screen, print_live

        screen = partial(open_screen, None, head=head, drawing=how, window=window, rate_hz=chosen.rate_hz)
        heard = listen_live(chosen, open_face, screen, microphone=mic_device, recognizer=recognizer)
        print_live(heard, as_json=as_json)
        return
    if text is None:
        raise UsageError("text: missing; give a text, or use --live --mic to speak")
    report = Report(shows=working)
    saving = SaveOptions(head=head, drawing=how, shapes=shapes, into=into, report=report)
    if not live:
        files, beside = outputs_of(output, sound=True)
        read = [head, speaking.profile, drawing.background, avatar.into, avatar.mapping]
        writing.check(files, read, beside=beside)
    check_output(output, saving, rate_hz=chosen.rate_hz)
    if text == "-" and sys.stdin is None:
        raise UsageError("text: - reads standard input, but it is closed")
    words = decoded(sys.stdin.buffer.read()) if text == "-" else text
    speech = spoken(words, voice_of(speaking), report=report)
    sound = speech.samples, speech.sample_rate_hz
    remarks = (*speech.remarks, *remarks_on(speech.phones), *sound_remarks(sound, speech.phones))
    if strict:
        refuse(remarks, f"voice {speaking.voice}")
    print_remarks(remarks)
    if live:
        from fapengine.app.say_live import say_live
        from fapengine.cli._say_live import note, open_screen, print_live

        screen = partial(open_screen, speech.phones, head=head, drawing=how, window=window, rate_hz=chosen.rate_hz)
        done = say_live(
            speech, speech.text, chosen, open_face, screen,
            on_silence=lambda reason: note(f"no sound ({reason}); the face follows the system clock"),
        )  # fmt: skip
        print_live(done, as_json=as_json)
        return
    with report.stage("plan"):
        performance = perform_speech(speech, chosen)
    write(performance, output, saving)
    print_reports([report], as_json=as_json, err=is_standard(output))
