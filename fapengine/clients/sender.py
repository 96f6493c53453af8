"""The client of a live server: ``with Client() as face: face.say(phones)``.

The sockets around :class:`fapengine.wire.speech_osc.sender.OscSender`. A thread of the client sends, repeats and
receives; all methods may be called from any thread and return at once. Times are ``time.monotonic()``.
"""

import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import frozen
from fapengine.clients.pipes import CONNECT_S, Datagrams, Stream, TcpFraming
from fapengine.engine.command_table import Command, shifted
from fapengine.engine.commands import Anchor, Pause, Resume
from fapengine.engine.gesture_methods import GestureMethods
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.wire.speech_osc import schema
from fapengine.wire.speech_osc.handshake import PING_S
from fapengine.wire.speech_osc.sender import OscSender

if TYPE_CHECKING:
    from fapengine.voices.choice import VoiceChoice
    from fapengine.voices.pronounce import Pronouncer
    from fapengine.voices.protocol import Voice

PORT = 9110
"""Port of ``fapengine serve``."""
LINGER_S = 5.0
"""Longest wait of :meth:`Client.close` for what was sent to arrive."""
SILENT_S = 0.5
"""Longest wait of :meth:`Client.close` for an engine that does not answer."""
IDLE_S = 0.25
"""Longest pause of the thread."""
LOST_S, AWAY_PING_S = 1.0, 0.5
"""Of a client that a server sent to another process: time without an answer until it returns to the known port; time
between pings."""
KEPT_EVENTS = 256
KEPT_OVER = 1024
"""Number of ended utterances that are remembered."""
Phones = PhoneTrack | Iterable[Phone | schema.WirePhone]


class Client(GestureMethods):
    """A sender's connection to one session of an engine.

    Stateful.

    Parameters
    ----------
    host : str
    port : int
    session : str
        Name of the face, 1..32 bytes.
    others : sequence of (str, int)
        Hosts and ports of other servers that share the sessions of the first, tried in turn if it does not answer.
    tcp : bool or ``"slip"`` or ``"length"``
        UDP by default. TCP with SLIP (OSC 1.1) or lengths before packets (OSC 1.0).
    phone_set, language : str
        Of the phones' labels; ``Phone`` objects are IPA.
    token : str
        If the engine wants one.
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
            number = face.say([Phone("m", 0.0, 0.1), Phone("a", 0.1, 0.3)])
            face.wait_until_over(number)
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = PORT,
        *,
        session: str = "face",
        others: Sequence[tuple[str, int]] = (),
        tcp: bool | TcpFraming = False,
        phone_set: str = "ipa",
        language: str = "",
        token: str = "",
        on_event: Callable[[schema.Notice], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._sender = OscSender(
            session,
            phone_set=phone_set,
            language=language,
            token=token,
            instance=secrets.randbelow(2**31 - 1) + 1,
            reliable=bool(tcp),
            follows=True,
        )
        self.session = session
        self._clock, self._on_event = clock, on_event
        self._framing: TcpFraming | None = "slip" if tcp is True else tcp or None
        self._homes, self._has_answered = deque([(host, port), *others]), False
        """Known addresses, the current one first; and whether the current one has answered."""
        self._at = host, port
        self._went_s = clock()
        self._is_away = False
        """Whether the server has sent us to an unknown port."""
        self._pipe = self._opened(host, port)
        self._changed = threading.Condition()
        self._events: deque[schema.Notice] = deque(maxlen=KEPT_EVENTS)
        self._over: dict[int, str] = {}
        self._voices: dict[VoiceChoice, Pronouncer] = {}
        self._voices_lock = threading.Lock()
        self._fault: ResourceError | UsageError | None = None
        self._stops = False
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_out.setblocking(False)
        self._thread = threading.Thread(target=self._work, name=f"fapengine client {session}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            with suppress(ResourceError, UsageError):  # lost or closed: the block's own error matters
                self.cancel()
        self.close()

    # Speech ---------------------------------------------------------------------------------------------------------

    def say(
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
        with self._telling() as now_s:
            number = self._begin(now_s, at_s, audio)
            self._sender.append(number, _phones(phones))
            self._sender.end(number, duration_s=duration_s)
            return number

    def begin(self, *, at_s: float | None = None, audio: bool = False) -> int:
        """Begin an utterance; :meth:`append` its phones as they become known, then :meth:`end` it."""
        with self._telling() as now_s:
            return self._begin(now_s, at_s, audio)

    def _begin(self, now_s: float, at_s: float | None, audio: bool) -> int:
        if audio and at_s is not None:
            raise UsageError("say: got both at_s and audio, expected one")
        anchor: Anchor = "audio" if audio else "now" if at_s is None else "at"
        return self._sender.begin(now_s, anchor=anchor, at_s=at_s or 0.0)

    def append(self, utterance: int, phones: Phones) -> None:
        """Add phones to an utterance.

        Raises
        ------
        UsageError
            If it was ended.
        """
        with self._telling():
            if utterance not in self._over:
                self._sender.append(utterance, _phones(phones))

    def words(
        self,
        words: Iterable[tuple[str, float, float]],
        *,
        utterance: int | None = None,
        voice: "str | VoiceChoice | Voice" = "en-us",
        at_s: float | None = None,
        audio: bool = False,
    ) -> int:
        """Speak words whose times are known, as a TTS reports them with its audio.

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
            Beginning of a new utterance, as of :meth:`say`.

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
        with self._telling() as now_s:
            if utterance is None:
                utterance = self._begin(now_s, at_s, audio)
            if utterance not in self._over:
                self._sender.append(utterance, spoken)
            return utterance

    def _pronounced(
        self, words: list[tuple[str, float, float]], voice: "str | VoiceChoice | Voice"
    ) -> list[Phone]:  # fmt: skip
        from fapengine.voices.choice import VoiceChoice
        from fapengine.voices.pronounce import Pronouncer

        chosen = VoiceChoice(voice) if isinstance(voice, str) else voice
        if not isinstance(chosen, VoiceChoice):
            return Pronouncer(chosen).words(words)
        with self._voices_lock:
            pronouncer = self._voices.get(chosen) or Pronouncer(chosen.load())
            self._voices[chosen] = pronouncer
        return pronouncer.words(words)

    def sound(self, samples: ArrayLike, rate_hz: int, *, utterance: int | None = None) -> int:
        """Let the engine's recognizer find the phones of audio, as it arrives.

        The face follows the audio with a delay of 0.5 s, so play it that much later; or :meth:`begin` the utterance at
        the time at which it will be heard.

        Parameters
        ----------
        samples : (N,) int16
            Mono; of any length, as it comes from a microphone or a TTS.
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
        pcm = frozen(samples, "samples", ("N",), np.int16)
        with self._telling() as now_s:
            number = self._sender.begin(now_s, anchor="sound") if utterance is None else utterance
            if number not in self._over:
                self._sender.sound(number, pcm, rate_hz, now_s)
            return number

    def end(self, utterance: int, *, duration_s: float | None = None) -> None:
        """End an utterance: no phone follows."""
        with self._telling():
            if utterance not in self._over:
                self._sender.end(utterance, duration_s=duration_s)

    def revise(self, utterance: int, phones: Phones) -> None:
        """Replace all phones of an utterance; those that were shown already are not shown again."""
        with self._telling() as now_s:
            if utterance not in self._over:
                self._sender.revise(utterance, _phones(phones), now_s)

    def cancel(self, utterance: int | None = None, *, fade_s: float = 0.2) -> None:
        """Stop speaking at once (barge-in): one utterance, or all. A repeat changes nothing."""
        with self._telling() as now_s:
            for number in self._sender.live if utterance is None else (utterance,):
                self._note_over(number, "cancelled")
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
            Time at which this position is heard, on the client's clock; by default now. A sound card knows it better.
        rate : float
            0: the audio is paused.
        """
        with self._telling() as now_s:
            self._sender.audio(utterance, position_s, now_s, at_s=at_s, rate=rate)

    def pause(self, *, fade_s: float = 0.2) -> None:
        """Pause; the mouth comes to rest."""
        self.tell(Pause(fade_s))

    def resume(self) -> None:
        """Continue from where it was paused."""
        self.tell(Resume())

    def seek(self, utterance: int, position_s: float) -> None:
        """Continue from another position in an utterance."""
        self._tell(schema.SeekUtterance(self.session, utterance, round(position_s * 1e6)))

    def say_text(self, text: str, *, voice: str = "") -> None:
        """Speak a text with the engine's own voice, if it has one."""
        self._tell(schema.SpeakText(self.session, text, voice))

    # The rest of the face -------------------------------------------------------------------------------------------

    def tell(self, command: Command) -> None:
        """Send a command that is the same for every sender; its times are on the client's clock.

        Raises
        ------
        UsageError
            If it concerns an utterance: there are other methods for that.
        """
        if not command.SPEC.is_direct:
            raise UsageError(f"command: got {type(command).__name__}, expected one that speaks of no utterance")
        message = schema.SessionCommand(self.session, shifted(command, -self.now_s))
        self._tell(message, repeats=command.SPEC.is_repeatable)

    # The connection -------------------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """The client's clock."""
        return self._clock()

    @property
    def welcome(self) -> schema.Welcome | None:
        """The engine's answer with its limits; None before it."""
        return self._sender.handshake.welcome

    @property
    def is_connected(self) -> bool:
        """Whether the engine was heard in the last seconds."""
        with self._changed:
            return self._fault is None and self._sender.handshake.is_connected(self._clock())

    def events(self) -> list[schema.Notice]:
        """Take the events that have arrived: started, underrun, late, concealed, finished, cancelled, error."""
        with self._changed:
            taken = list(self._events)
            self._events.clear()
            return taken

    def wait(self, timeout_s: float = CONNECT_S) -> Self:
        """Wait until the engine has answered.

        Raises
        ------
        ResourceError
            If it does not in time.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: self._sender.handshake.welcome is not None or self._fault is not None, timeout_s
            )
            if self._fault is not None:
                raise self._fault
            if self._sender.handshake.welcome is None:
                raise ResourceError(
                    f"engine at {self._pipe.name}: no answer within {timeout_s:g} s; does it run there?"
                )
        return self

    def wait_until_over(self, utterance: int, timeout_s: float | None = None) -> str:
        """Wait until an utterance is over; return how: ``"finished"``, ``"cancelled"``, ``"error"`` or ``"lost"``.

        ``"lost"``: its time is over and nothing was heard; also if the timeout or the connection ended first.
        """
        with self._changed:
            self._changed.wait_for(
                lambda: utterance in self._over or self._fault is not None or utterance not in self._sender.live,
                timeout_s,
            )
            return self._over.get(utterance, "lost")

    def close(self) -> None:
        """Close, as soon as everything sent has arrived; it is still spoken. A second call does nothing."""
        if self._stops:
            return
        with self._changed:
            self._linger()
        self._stops = True
        self._wake()
        self._thread.join()
        self._pipe.close()
        self._wake_in.close()
        self._wake_out.close()

    def _linger(self) -> None:
        """Wait until everything sent has arrived, as long as the engine answers."""
        now_s = begun_s = self._clock()
        while self._fault is None and not self._sender.is_settled() and now_s < begun_s + LINGER_S:
            if now_s - max(begun_s, self._sender.handshake.heard_s) > SILENT_S:
                break
            self._changed.wait(0.1)
            now_s = self._clock()

    @contextmanager
    def _telling(self) -> Iterator[float]:
        if self._stops:
            raise _ClosedError("client: is closed")
        with self._changed:
            if self._fault is not None:
                raise self._fault
            yield self._clock()
        self._wake()

    def _tell(self, message: schema.FromSender, *, repeats: bool = False) -> None:
        with self._telling() as now_s:
            self._sender.tell(message, now_s, repeats=repeats)

    def _wake(self) -> None:
        with suppress(BlockingIOError):  # full of wakes that are still to be read
            self._wake_out.send(b"\0")

    # The thread -----------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        try:
            while not self._stops:
                self._send_due()
                with self._changed:
                    wait_s = min(max(self._sender.next_s(self._clock()) - self._clock(), 0.0), IDLE_S)
                self._hear(self._pipe.receive(wait_s, self._wake_in))
                if self._is_away and self._is_lost():
                    # where it has answered, it is gone; where it never has, that port cannot be reached from here
                    self._go(*self._homes[0], follows=self._has_answered, is_away=False)
                elif len(self._homes) > 1 and self._clock() - self._went_s > LOST_S / 2 and self._is_lost():
                    self._homes.rotate(-1)
                    self._go(*self._homes[0], follows=True, is_away=False)
            self._send_due()
        except (OSError, DataError) as error:
            self._fail(ResourceError(f"engine at {self._pipe.name}: the connection is lost ({error})"))
        except ResourceError as error:  # where it was sent, or where it came from, cannot be reached
            self._fail(error)
        except UsageError as error:
            self._fail(error)
            raise  # a program's mistake: the thread's hook shows its place

    def _fail(self, fault: ResourceError | UsageError) -> None:
        with self._changed:
            self._fault = fault
            self._changed.notify_all()

    def _send_due(self) -> None:
        with self._changed:
            packets = self._sender.due(self._clock())
            if packets:
                self._changed.notify_all()
        for packet in packets:
            self._pipe.send(packet)

    def _opened(self, host: str, port: int) -> Stream | Datagrams:
        return Stream(host, port, self._framing) if self._framing else Datagrams(host, port)

    def _is_lost(self) -> bool:
        with self._changed:
            return self._pipe.is_refused or self._sender.handshake.is_unanswered(self._clock(), LOST_S)

    def _go(self, host: str, port: int, *, follows: bool, is_away: bool) -> None:
        """Connect to another address."""
        pipe = self._opened(host, port)
        self._pipe.close()
        self._pipe, self._is_away, self._has_answered = pipe, is_away, False
        self._at, self._went_s = (host, port), self._clock()
        often = is_away or len(self._homes) > 1
        with self._changed:
            self._sender.move(self._clock(), follows=follows, ping_s=AWAY_PING_S if often else PING_S)

    def _hear(self, packets: list[bytes]) -> None:
        for packet in packets:
            with self._changed:
                heard = self._sender.receive(packet, self._clock())
                moved = next((item for item in heard if isinstance(item, schema.Moved)), None)
                self._has_answered |= any(isinstance(item, schema.Welcome) for item in heard)
                notices = [item for item in heard if isinstance(item, schema.Notice) and item.utterance >= 0]
                for notice in notices:
                    self._events.append(notice)
                    if notice.kind in ("finished", "cancelled", "error") and notice.reason != "checksum":
                        self._note_over(notice.utterance, notice.kind)
                self._changed.notify_all()
            for notice in notices:
                self._call(notice)
            if moved is not None:
                host = moved.host or self._at[0]
                self._go(host, moved.port, follows=True, is_away=(host, moved.port) != self._homes[0])
                return

    def _call(self, notice: schema.Notice) -> None:
        if self._on_event is None:
            return
        try:
            self._on_event(notice)
        except _ClosedError:
            if not self._stops:  # else it had something to tell while the client closed
                raise
        except Exception as error:  # it is the user's and may raise anything
            raise UsageError(f"on_event: raised {error!r}") from error

    def _note_over(self, utterance: int, how: str) -> None:
        self._over.setdefault(utterance, how)
        while len(self._over) > KEPT_OVER:
            del self._over[next(iter(self._over))]


class _ClosedError(UsageError):
    """A call after the client was closed."""


def _phones(phones: Phones) -> Iterable[Phone | schema.WirePhone]:
    return phones.phones if isinstance(phones, PhoneTrack) else phones
