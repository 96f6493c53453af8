"""The client of a live server: ``with Client() as face: face.send_phones(phones)``.

All methods may be called from any thread and return at once: a thread of the client sends, repeats and receives
(:mod:`.connection`). Times are ``time.monotonic()``.
"""

import secrets
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Self

from numpy.typing import ArrayLike

from fapengine._arrays import as_sound
from fapengine._strict_toml import checked
from fapengine.clients.connection import Connection, TcpFraming
from fapengine.engine.command_table import Command, shifted
from fapengine.engine.commands import Anchor, GestureMethods, Pause, Resume
from fapengine.errors import ResourceError, UsageError
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.sender import OscSender

if TYPE_CHECKING:
    from fapengine.voices.choice import VoiceChoice
    from fapengine.voices.protocol import Voice

PORT = 9110
"""Port of ``fapengine serve``."""
Phones = PhoneTrack | Iterable[Phone | schema.WirePhone]


class Client(Connection, GestureMethods):
    """A sender's connection to one session of an engine.

    Stateful.

    Parameters
    ----------
    host : str
    port : int
    session : str
        Name of the face, 1..32 bytes.
    fallback_addresses : sequence of (str, int)
        Hosts and ports of other servers that share the sessions of the first, tried in turn if it does not answer.
    tcp : bool or ``"slip"`` or ``"length"``
        UDP by default. TCP with SLIP (OSC 1.1) or lengths before packets (OSC 1.0).
    phone_set, language : str
        Of the phones' labels; ``Phone`` objects are IPA.
    token : str
        If the engine requires one.
    on_event : callable, optional
        Called in the client's thread with each :class:`~fapengine.wire.speech_osc.schema.Notice`. An exception in it
        ends the connection; the next call raises it.
    clock : callable
        Monotonic clock in seconds.

    Raises
    ------
    ResourceError
        If the host is unknown, or TCP finds no server. UDP does not notice: see :meth:`wait`.
    UsageError
        If the session's name is too long.

    Examples
    --------
    ::

        with Client(session="anna") as face:
            face.express("joy", 0.6)
            number = face.send_phones([Phone("m", 0.0, 0.1), Phone("a", 0.1, 0.3)])
            face.wait_until_finished(number)
    """

    @checked
    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = PORT,
        *,
        session: str = "face",
        fallback_addresses: Sequence[tuple[str, int]] = (),
        tcp: bool | TcpFraming = False,
        phone_set: str = "ipa",
        language: str = "",
        token: str = "",
        on_event: Callable[[schema.Notice], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.session = session
        sender = OscSender(
            session, phone_set=phone_set, language=language, token=token, instance=secrets.randbelow(2**31 - 1) + 1,
            reliable=bool(tcp), follows=True,
        )  # fmt: skip
        super().__init__(
            sender, [(host, port), *fallback_addresses], "slip" if tcp is True else tcp or None, on_event, clock
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            with suppress(ResourceError, UsageError):  # lost or closed: the block's own error matters
                self.cancel()
        self.close()

    # Speech ---------------------------------------------------------------------------------------------------------

    def send_phones(
        self, phones: Phones, *, at_s: float | None = None, audio: bool = False, duration_s: float | None = None
    ) -> int:
        """Speak phones that are all known.

        Parameters
        ----------
        phones : PhoneTrack or iterable of Phone or WirePhone
            With times from the beginning of their audio.
        at_s : float, optional
            Start of the audio, on the client's clock; by default now, or after the utterances before. Phones that are
            known half a second before they sound look best.
        audio : bool
            The face waits until :meth:`audio_position` reports that the audio has begun.
        duration_s : float, optional
            Of the audio; by default until the end of the last phone.

        Returns
        -------
        int
            Number of the utterance.
        """
        with self._sending() as now_s:
            number = self._begin(now_s, at_s, audio)
            self._sender.append(number, _phones(phones))
            self._sender.end(number, duration_s=duration_s)
            return number

    def begin(self, *, at_s: float | None = None, audio: bool = False) -> int:
        """Begin an utterance; :meth:`append` its phones as they become known, then :meth:`end` it."""
        with self._sending() as now_s:
            return self._begin(now_s, at_s, audio)

    def _begin(self, now_s: float, at_s: float | None, audio: bool) -> int:
        if audio and at_s is not None:
            raise UsageError("at_s: got audio, too, expected one of both")
        anchor: Anchor = "audio" if audio else "now" if at_s is None else "at"
        return self._sender.begin(now_s, anchor=anchor, at_s=at_s or 0.0)

    def append(self, utterance: int, phones: Phones) -> None:
        """Add phones to an utterance.

        Raises
        ------
        UsageError
            If it was ended.
        """
        with self._sending():
            if utterance not in self._ended:
                self._sender.append(utterance, _phones(phones))

    def send_words(
        self,
        words: Iterable[tuple[str, float, float]],
        *,
        utterance: int | None = None,
        voice: "str | VoiceChoice | Voice" = "en-us",
        at_s: float | None = None,
        audio: bool = False,
    ) -> int:
        """Speak words with known times, as a TTS reports them with its audio.

        espeak-ng on this machine pronounces them, and the phones are fitted to their times.

        Parameters
        ----------
        words : iterable of (str, float, float)
            Word, start and end in seconds from the beginning of the utterance; in order. More may follow.
        utterance : int, optional
            An open one, to which they are added; by default they begin one. :meth:`end` it after the last words.
        voice : str, VoiceChoice or Voice
            Language of the words.
        at_s, audio
            Beginning of a new utterance, as of :meth:`send_phones`.

        Returns
        -------
        int
            Number of the utterance.

        Raises
        ------
        UsageError
            If times are out of order, no word can be pronounced, or the utterance was ended or has audio.
        ResourceError
            If espeak-ng is not installed.
        """
        spoken = self._pronounced(list(words), voice)
        with self._sending() as now_s:
            if utterance is None:
                utterance = self._begin(now_s, at_s, audio)
            if utterance not in self._ended:
                self._sender.append(utterance, spoken)
            return utterance

    def _pronounced(self, words: list[tuple[str, float, float]], voice: "str | VoiceChoice | Voice") -> list[Phone]:
        from fapengine.voices.choice import VoiceChoice, loaded, pronouncer_of
        from fapengine.voices.pronounce import Pronouncer

        chosen = VoiceChoice(voice) if isinstance(voice, str) else voice
        known = pronouncer_of(chosen) if isinstance(chosen, VoiceChoice) else Pronouncer(loaded(chosen))
        return known.words(words)

    def send_audio(self, samples: ArrayLike, rate_hz: int, *, utterance: int | None = None) -> int:
        """Send audio as it arrives; the engine's recognizer finds its phones.

        The face follows the audio with a delay of 0.25 s, so play it that much later; or :meth:`begin` the utterance at
        the time at which it will be heard.

        Parameters
        ----------
        samples : (N,) or (N, channels) array_like
            int16, or float in -1..1; of any length, as it comes from a microphone or a TTS. Channels are averaged.
        rate_hz : int
            8000..48000.
        utterance : int, optional
            An open one, which the audio continues; by default it begins one. :meth:`end` it after the last samples.

        Returns
        -------
        int
            Number of the utterance.

        Raises
        ------
        UsageError
            If the utterance was ended, has phones or begins now (:meth:`begin` without a time), or the rate is out of
            range or has changed.
        """
        pcm, rate_hz = as_sound((samples, rate_hz), "samples")
        with self._sending() as now_s:
            number = self._sender.begin(now_s, anchor="sound") if utterance is None else utterance
            if number not in self._ended:
                self._sender.sound(number, pcm, rate_hz, now_s)
            return number

    def end(self, utterance: int, *, duration_s: float | None = None) -> None:
        """End an utterance: no phone follows."""
        with self._sending():
            if utterance not in self._ended:
                self._sender.end(utterance, duration_s=duration_s)

    def revise(self, utterance: int, phones: Phones) -> None:
        """Replace all phones of an utterance; those that were shown already are not shown again."""
        with self._sending() as now_s:
            if utterance not in self._ended:
                self._sender.revise(utterance, _phones(phones), now_s)

    def cancel(self, utterance: int | None = None, *, fade_s: float = 0.2) -> None:
        """Stop speaking at once (barge-in): one utterance, or all. A repeat changes nothing."""
        with self._sending() as now_s:
            for number in self._sender.live if utterance is None else (utterance,):
                self._note_end(number, "cancelled")
            self._sender.cancel(now_s, utterance=utterance, fade_s=fade_s)

    def audio_position(
        self, utterance: int, position_s: float, *, at_s: float | None = None, rate: float = 1.0
    ) -> None:
        """Report the audio position of an utterance, 4 to 10 times a second; the face follows it.

        Parameters
        ----------
        utterance : int
        position_s : float
            In the utterance.
        at_s : float, optional
            Time at which this position is heard, on the client's clock; by default now. Sound cards report it.
        rate : float
            0: the audio is paused.
        """
        with self._sending() as now_s:
            self._sender.audio(utterance, position_s, now_s, at_s=at_s, rate=rate)

    def pause(self, *, fade_s: float = 0.2) -> None:
        """Pause; the mouth returns to neutral."""
        self.send_command(Pause(fade_s))

    def resume(self) -> None:
        """Continue from where it was paused."""
        self.send_command(Resume())

    def seek(self, utterance: int, position_s: float) -> None:
        """Continue from another position in an utterance."""
        self._send(schema.SeekUtterance(self.session, utterance, round(position_s * 1e6)))

    def send_text(self, text: str, *, voice: str = "") -> None:
        """Speak a text with the engine's own voice, if it has one."""
        self._send(schema.SpeakText(self.session, text, voice))

    # The rest of the face -------------------------------------------------------------------------------------------

    def send_command(self, command: Command) -> None:
        """Send a command that is the same for every sender; its times are on the client's clock.

        Raises
        ------
        UsageError
            If it concerns an utterance: there are other methods for that.
        """
        if not command.SPEC.is_direct:
            raise UsageError(f"command: got {type(command).__name__}, expected one that concerns no utterance")
        message = schema.SessionCommand(self.session, shifted(command, -self.now_s))
        self._send(message, repeats=command.SPEC.is_repeatable)


def _phones(phones: Phones) -> Iterable[Phone | schema.WirePhone]:
    return phones.phones if isinstance(phones, PhoneTrack) else phones
