"""The pages of one session: all of them receive its frames and messages, and one leads the face by its audio."""

from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Protocol
from urllib.parse import urlencode

from fapengine.engine.command_table import Choice, Command, fields_of
from fapengine.engine.commands import PARAMETERS, Append, Audio, Begin, Cancel, End
from fapengine.host.hub import Hub
from fapengine.host.listeners import HubFrame, Spoken
from fapengine.server.web.messages import pack_frame, text_of

MAX_UTTERANCES = 32
MAX_RUNS = 8
"""Number of the last runs of phones that are sent to a page that joins late, if an utterance has gaps."""
POSITION_EVERY = 15
"""Frames between two messages about the position of an utterance."""
OVER = ("finished", "cancelled", "error")


class Member(Protocol):
    """One page (:class:`fapengine.server.web.connection.SendQueue`)."""

    def put_text(self, text: str) -> None:
        """Send a message."""

    def put_frame(self, frame: bytes) -> None:
        """Send a frame."""


@dataclass(slots=True)
class _Said:
    """An utterance that was sent to pages."""

    recent: deque[str] = field(default_factory=lambda: deque(maxlen=4))
    """Its last messages; senders repeat them."""
    leader: Member | None = None
    """Page that plays the audio."""


class SessionView:
    """The view of one session, shared by its pages; it exists as long as it has a page. Stateful.

    Raises UsageError if the server has no room for one more session.

    Parameters
    ----------
    hub : Hub
    session : str
        Opened if it is not open yet.
    server_plays_audio : bool
        True if the server plays the audio, and pages do not.
    """

    def __init__(self, hub: Hub, session: str, *, server_plays_audio: bool = False) -> None:
        self._hub, self.session, self.server_plays_audio = hub, session, server_plays_audio
        self._leave = [
            hub.hold(session),
            hub.listeners.on_frame(session, self._frame),
            hub.listeners.on_event(session, self._event),
            hub.listeners.on_command(session, self._command),
        ]
        self._members: dict[Member, Callable[[], None]] = {}
        self._watching: set[Member] = set()
        self._settings: dict[tuple[str, ...], str] = {}
        self._said: OrderedDict[int, _Said] = OrderedDict()
        self._speaking: int | None = None

    def __len__(self) -> int:
        return len(self._members)

    @property
    def is_paused(self) -> bool:
        """True if the face is paused."""
        return self._hub.engine.state(self.session) == "paused"

    @property
    def manner(self) -> dict[str, float]:
        """Value of each style parameter, 0 or 1 for switches."""
        style = self._hub.engine.style(self.session)
        return {name: float(getattr(style, name)) for name in PARAMETERS}

    def enter(self, member: Member) -> None:
        """Add a page, and send it the current state."""
        self._members[member] = lambda: None
        self._watching.add(member)
        self.plays(member, on=False)
        for text in (self._pins(), *self._settings.values()):
            member.put_text(text)
        for number in self._said:
            for text in self._so_far(number):
                member.put_text(text)

    def leave(self, member: Member) -> None:
        """Remove a page; the last one closes the view."""
        self._members.pop(member)()
        self._watching.discard(member)
        for said in self._said.values():
            if said.leader is member:
                said.leader = None
        if not self._members:
            for stop in self._leave:
                stop()

    def plays(self, member: Member, *, on: bool) -> None:
        """Set whether a page plays audio."""
        self._members[member]()
        self._members[member] = self._hub.listeners.on_speech(
            self.session, lambda spoken: self._spoken(member, spoken), plays=on and not self.server_plays_audio
        )

    def watches(self, member: Member, *, on: bool) -> None:
        """Set whether a page is visible; a hidden one is sent no frames."""
        if on:
            self._watching.add(member)
        else:
            self._watching.discard(member)

    def tell(self, member: Member, command: Command) -> None:
        """Apply a page's command. Of the pages that play the same audio, only the first reports its position.

        Raises UsageError if the session is closed.
        """
        if isinstance(command, Audio):
            said = self._said.get(command.utterance)
            if self.server_plays_audio or said is None or said.leader not in (None, member):
                return
            said.leader = member
        self._hub.apply(self.session, command)

    def pin(self, values: Mapping[int, int | None]) -> None:
        """Hold FAPs of the session at values, for all its pages and sinks; None releases one.

        Raises UsageError if the session is closed.
        """
        for number, value in values.items():
            self._hub.host(self.session).pin(number, value)
        self._tell_all(self._pins())

    def release(self) -> None:
        """Release every FAP. Raises UsageError if the session is closed."""
        self.pin(dict.fromkeys(self._hub.host(self.session).pins))

    def _pins(self) -> str:
        return text_of("pins", values=self._hub.host(self.session).pins)

    def _spoken(self, member: Member, spoken: Spoken) -> None:
        query = urlencode({"session": spoken.session, "utterance": spoken.utterance})
        url = None if self.server_plays_audio else f"/sound.wav?{query}"
        member.put_text(text_of("sound", utterance=spoken.utterance, url=url, text=spoken.text))

    def _frame(self, frame: HubFrame) -> None:
        if self._watching:
            packed = pack_frame(frame.number, frame.time_s, frame.faps)
            for member in self._watching:
                member.put_frame(packed)
        if self._speaking is not None and frame.number % POSITION_EVERY == 0:
            self._position(self._speaking, frame.time_s)

    def _position(self, number: int, now_s: float) -> None:
        utterance = self._hub.engine.utterance(self.session, number)
        if utterance is not None:
            position_s = utterance.position_s(now_s)
            self._tell_all(text_of("position", utterance=number, position_s=position_s, time_s=now_s))

    def _event(self, event: Any) -> None:
        if event.kind == "started":
            self._speaking = event.utterance
            self._position(event.utterance, event.time_s)
        elif event.kind in OVER:
            self._said.pop(event.utterance, None)
            self._speaking = None if self._speaking == event.utterance else self._speaking
        reason = {"reason": event.reason} if event.reason else {}
        self._tell_all(
            text_of(
                "event", kind=event.kind, utterance=event.utterance, time_s=event.time_s, count=event.count, **reason
            )
        )

    def _command(self, session: str, command: Command, now_s: float) -> None:
        match command:
            case Begin():
                self._note(command.utterance, text_of("begin", utterance=command.utterance))
            case Append():
                self._note(command.utterance, _phones(command))
            case End():
                text = text_of("end", utterance=command.utterance, duration_s=command.duration_s)
                self._note(command.utterance, text)
            case Cancel():
                some = command.utterance is None and command.first > 0
                for number in filter(command.means, self._said) if some else (command.utterance,):
                    self._tell_all(text_of("cancel", utterance=number))
            case _ if command.SPEC.is_shown:
                self._show(command)

    def _show(self, command: Command) -> None:
        """Send a setting to all pages, and keep it for pages that join later."""
        specs = {name: spec for name, spec in fields_of(type(command)).items() if spec.json}
        values = {spec.json: spec.to_json(getattr(command, name)) for name, spec in specs.items()}
        names = [values[spec.json] for spec in specs.values() if isinstance(spec, Choice)]
        text = text_of(command.SPEC.json, **values)
        self._settings[command.SPEC.json, *names] = text
        self._tell_all(text)

    def _note(self, utterance: int, text: str) -> None:
        said = self._said.setdefault(utterance, _Said())
        if text not in said.recent:
            said.recent.append(text)
            self._tell_all(text)
        while len(self._said) > MAX_UTTERANCES:
            self._said.popitem(last=False)

    def _so_far(self, number: int) -> list[str]:
        """Return few messages with all that the engine knows of an utterance."""
        utterance = self._hub.engine.utterance(self.session, number)
        if utterance is None:
            return []
        texts = [text_of("begin", utterance=number)]
        for _, run in groupby(enumerate(sorted(utterance.phones)), lambda pair: pair[1] - pair[0]):
            indices = [index for _, index in run]
            phones = tuple(utterance.phones[index] for index in indices)
            texts.append(_phones(Append(number, indices[0], phones, utterance.revision)))
        del texts[1:-MAX_RUNS]
        if utterance.duration_s is not None:
            texts.append(text_of("end", utterance=number, duration_s=utterance.duration_s))
        return texts

    def _tell_all(self, text: str) -> None:
        for member in self._members:
            member.put_text(text)


def _phones(command: Append) -> str:
    phones = [(p.label, round(p.start_s, 4), round(p.end_s, 4), p.word or None) for p in command.phones]
    return text_of(
        "phones", utterance=command.utterance, first=command.first_index, revision=command.revision, phones=phones
    )


def open_session_view(
    hub: Hub, session: str, views: dict[str, SessionView], *, server_plays_audio: bool = False
) -> SessionView:
    """Return the view of a session, opened if necessary; see :class:`SessionView`.

    Raises UsageError if the server has no room for one more session.
    """
    if session not in views or not len(views[session]):
        views[session] = SessionView(hub, session, server_plays_audio=server_plays_audio)
    return views[session]
