"""A microphone that moves a face on any screen: what is said there is shown, half a second later."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from fapengine.app.face import SESSION, Face, Ticks
from fapengine.app.manner import Manner, moods_of
from fapengine.app.say_live import LiveOutput, Screen, finish, open_face
from fapengine.ears.choice import check_ear
from fapengine.errors import UsageError
from fapengine.live.audio.microphone import Microphone
from fapengine.live.hub.hearing import DELAY_S, Hearing
from fapengine.speech.phone_track import PhoneTrack


def listen_live(
    manner: Manner,
    output: LiveOutput,
    open_screen: Callable[[], Screen],
    *,
    microphone: str | None = None,
    ear: Path | None = None,
) -> dict[str, object]:
    """Show what the microphone hears until the viewer closes the screen, or interrupts.

    Parameters
    ----------
    manner : Manner
        Expressions are shown from the beginning to the end.
    output : LiveOutput
        Its sinks get the frames; no sound is played.
    open_screen : callable
        Makes the screen, when microphone, ear and face are there.
    microphone : str, optional
        Number of the device, or a part of its name; by default the system's.
    ear : Path, optional
        Name of an ear, or a learned one (:mod:`fapengine.ears.choice`).

    Returns
    -------
    dict
        Plain values: microphone, seconds heard, phones, frames.

    Raises
    ------
    UsageError
        If the profile, an expression, a sink or the rate cannot be.
    ResourceError
        If there is no microphone, no ear, or the screen cannot be opened.
    """
    if any(isinstance(entry, str) and "@" in entry for entry in manner.expressions):
        raise UsageError("expressions: got one with times, expected none of a microphone, whose words are not known")
    check_ear(ear)  # a bad one is told now
    with Microphone(microphone) as source, open_face(manner, output) as face:
        hearing = Hearing(face.hub, max_ears=1, model=ear)
        try:
            hearing.listen(SESSION, np.zeros(0, np.int16), source.rate_hz, source=source)  # the ear starts
            for mood in moods_of(manner.expressions, PhoneTrack.of([])):
                face.express(mood.expression, mood.strength)
            with open_screen() as screen:
                ticks = Ticks(manner.rate_hz)
                with suppress(KeyboardInterrupt):  # the way to end it
                    _run(face, hearing, source, screen, ticks)
                face.stop()
                finish(face, screen, ticks)
        finally:
            hearing.close()
    return {
        "microphone": source.description, "heard_s": hearing.counts.heard_s, "phones": hearing.counts.phones,
        "delay_s": DELAY_S, "frames": ticks.frames, "skipped": ticks.skipped, "rate_hz": manner.rate_hz,
        "lost_pieces": source.dropped,
    }  # fmt: skip


def _run(face: Face, hearing: Hearing, source: Microphone, screen: Screen, ticks: Ticks) -> None:
    is_shown, begun_s = True, face.hub.clock()
    while is_shown:
        ticks.wait()
        samples = source.take()
        if len(samples):
            hearing.listen(SESSION, samples, source.rate_hz, source=source)
        now_s = face.hub.clock()
        hearing.tick(now_s)
        is_shown = screen.show(face.frame(screen.lead_s), now_s - begun_s)
