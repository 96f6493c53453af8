"""A voice service over the network: a text in, pieces of audio with times out as they come."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fapengine._late import Late
from fapengine.errors import ResourceError, UsageError
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.pronounce import pronounce
from fapengine.voices.protocol import Speech
from fapengine.voices.services import MAX_S, SERVICES, Gathered, Piece, Service

if TYPE_CHECKING:
    import aiohttp
else:
    aiohttp = Late("aiohttp", "aiohttp", "voices of services")

CONNECT_S, SILENT_S = 10.0, 20.0
"""Limits in s for connecting, and for the time without any message."""
MAX_MESSAGE = 16 << 20
"""Bytes of a message."""


async def stream(service: Service, text: str) -> AsyncIterator[Piece]:
    """Speak a text; yield the pieces as they come.

    Parameters
    ----------
    service : Service
        A new one for each text.
    """
    requests = service.requests(text)
    limits = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_S, sock_read=SILENT_S)
    try:
        async with aiohttp.ClientSession(timeout=limits) as session:
            pieces = _posted if service.url.startswith("http") else _exchanged
            async for piece in pieces(session, service, requests):
                yield piece
    except (aiohttp.ClientError, OSError, TimeoutError) as error:
        raise ResourceError(f"voice: {service.url.partition('?')[0]}: {error or type(error).__name__}") from error
    if not service.over:
        raise ResourceError(f"voice: {service.url.partition('?')[0]} closed the connection before the end")


async def _exchanged(
    session: aiohttp.ClientSession, service: Service, requests: list[str | bytes]
) -> AsyncIterator[Piece]:
    """Talk over a WebSocket."""
    async with session.ws_connect(service.url, headers=service.headers, max_msg_size=MAX_MESSAGE) as socket:
        for request in requests:
            await (socket.send_str(request) if isinstance(request, str) else socket.send_bytes(request))
        while not service.over:
            message = await asyncio.wait_for(socket.receive(), SILENT_S)
            if message.type not in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                return
            yield service.feed(message.data)


async def _posted(
    session: aiohttp.ClientSession, service: Service, requests: list[str | bytes]
) -> AsyncIterator[Piece]:
    """Post, and read the answer line by line."""
    async with session.post(service.url, data=requests[0], headers=service.headers) as answer:
        if answer.status != 200:
            reason = (await answer.content.read(300)).decode("utf-8", "replace")
            raise ResourceError(f"voice: {service.url}: status {answer.status}: {reason}")
        line = b""
        async for data in answer.content.iter_any():
            *whole, line = (line + data).split(b"\n")
            if len(line) > MAX_MESSAGE:
                raise ResourceError(f"voice: {service.url}: a line of more than {MAX_MESSAGE >> 20} MiB")
            for each in whole:
                if each.strip():
                    yield service.feed(each)
        if line.strip():
            yield service.feed(line)
        service.over = True


@dataclass(frozen=True, slots=True)
class ServiceVoice:
    """A voice of a service, as :class:`~fapengine.voices.protocol.Voice`: it returns whole utterances."""

    service: str
    """Name in :data:`~fapengine.voices.services.SERVICES`."""
    voice: str
    """The service's own name of the voice."""
    key: str
    language: str = "en-us"
    """Voice of espeak-ng that pronounces words where the service gives no phones."""
    base: str = ""
    """Address instead of the service's own."""
    most_s: float = MAX_S
    """Longest audio of one text, s; more is refused."""

    @classmethod
    def named(cls, name: str, environment: dict[str, str] | None = None, *, most_s: float = MAX_S) -> ServiceVoice:
        """Make a voice of ``SERVICE:VOICE``, with the key from ``SERVICE_API_KEY``."""
        service, _, voice = name.partition(":")
        if service not in SERVICES or not voice:
            raise UsageError(f"voice: got {name!r:.60}, expected SERVICE:VOICE, one of {', '.join(SERVICES)}")
        variable = f"{service.upper()}_API_KEY"
        key = (os.environ if environment is None else environment).get(variable, "")
        if not key:
            raise UsageError(f"voice: {service} requires a key in the environment variable {variable}")
        return cls(service, voice, key, most_s=min(most_s, MAX_S))

    def open(self) -> Service:
        """Make the service that speaks one text."""
        kind = SERVICES[self.service]
        return kind(self.voice, self.key, base=self.base) if self.base else kind(self.voice, self.key)

    def speak(self, text: str) -> Speech:
        """Speak a text, and wait for all of it."""

        async def gather() -> Gathered:
            gathered = Gathered(self.most_s)
            async for piece in stream(self.open(), text):
                gathered.add(piece)
            return gathered

        return asyncio.run(gather()).speech(lambda words: pronounce(words, EspeakVoice(self.language)))
