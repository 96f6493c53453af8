"""Who gets a call, on virtual time: places, and the start of rendering processes."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from aiortc import RTCConfiguration, RTCPeerConnection, RTCSessionDescription

from fapengine.errors import ResourceError, UsageError
from fapengine.server.calls.calls import ANSWER_EVERY_S, MAX_WAITING, OFFERS, OFFERS_HZ, START_EVERY_S, Calls
from fapengine.server.film.film import FilmForm
from tests.leaping import LeapingLoop


class Studio:
    """Stateful: when each film began, and which are watched."""

    def __init__(self) -> None:
        self.begun_s: list[float] = []
        self.open: list[tuple[str, FilmForm]] = []
        self.fails = False

    def __contains__(self, film: tuple[str, FilmForm]) -> bool:
        return film in self.open

    def watch(self, session: str, form: FilmForm, watcher: Any) -> Callable[[], None]:
        if self.fails:
            raise ResourceError("painter: its process cannot be started")
        self.begun_s.append(asyncio.get_running_loop().time())
        self.open.append((session, form))
        return lambda: self.open.remove((session, form))


class Hub:
    """Stateful: which sessions are held."""

    def __init__(self) -> None:
        self.held: list[str] = []

    def clock(self) -> float:
        return asyncio.get_running_loop().time()

    def hold(self, session: str) -> Callable[[], None]:
        self.held.append(session)
        return lambda: self.held.remove(session)


def run(work: Callable[[Calls, Any, Any], Coroutine[Any, Any, None]], most: int = 8) -> None:
    async def whole() -> None:
        hub, studio = Hub(), Studio()
        calls = Calls(hub, studio, None, most=most)  # type: ignore[arg-type]
        try:
            await work(calls, hub, studio)
        finally:
            await calls.close()
            await asyncio.gather(*(peer.close() for peer in PEERS))
            PEERS.clear()
            await asyncio.sleep(1.0)  # tasks of the library end
        assert hub.held == []
        assert studio.open == []
        assert calls.counts.watching == 0

    loop = LeapingLoop()
    try:
        loop.run_until_complete(whole())
    finally:
        loop.close()


PEERS: list[RTCPeerConnection] = []


async def offer(*kinds: str) -> tuple[RTCPeerConnection, bytes]:
    peer = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    PEERS.append(peer)
    for kind in kinds or ("audio",):
        peer.addTransceiver(kind, direction="recvonly")
    await peer.setLocalDescription(await peer.createOffer())
    return peer, str(peer.localDescription.sdp).encode()


async def ask(calls: Calls, caller: str, session: str = "anna") -> str:
    """Call, and never connect."""
    name, _ = await calls.watch(session, (await offer())[1], "127.0.0.1", caller)
    return name


async def connect(calls: Calls, caller: str, session: str = "anna") -> str:
    peer, data = await offer()
    name, answer = await calls.watch(session, data, "127.0.0.1", caller)
    await peer.setRemoteDescription(RTCSessionDescription(answer, "answer"))
    call = calls._calls[name]
    while call.peer.connectionState in ("new", "connecting"):
        await asyncio.sleep(0.01)
    return name


def test_an_address_that_never_connects_takes_two_places_and_others_get_in() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        names = []
        for _ in range(20):
            names.append(await ask(calls, "10.0.0.1"))
            await asyncio.sleep(1 / OFFERS_HZ)
        assert [name in calls._calls for name in names] == [False] * 18 + [True] * MAX_WAITING
        assert "another call needed its place" in (await calls.end(names[0]) or "")
        assert calls.counts.lost == 18
        await ask(calls, "10.0.0.2")
        assert len(calls) == MAX_WAITING + 1
        assert studio.begun_s == []  # nothing is rendered for who is not connected

    run(work)


def test_a_newcomer_ends_the_oldest_that_is_not_connected_and_never_one_that_is() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        names = [await connect(calls, "10.0.0.1"), await ask(calls, "10.0.0.2"), await ask(calls, "10.0.0.3")]
        await ask(calls, "10.0.0.4")
        assert [name in calls._calls for name in names] == [True, False, True]
        for number in range(2):
            await calls.end(next(name for name in calls._calls if name != names[0]))
            await connect(calls, f"10.0.1.{number}")
        with pytest.raises(UsageError, match="one more than 3"):
            await ask(calls, "10.0.0.5")

    run(work, most=3)


def test_offers_that_come_together_are_answered_one_by_one_and_the_oldest_call_ends() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        offers = [(await offer())[1] for _ in range(8)]
        answered_s: list[float] = []

        async def call(number: int) -> str:
            name, _ = await calls.watch("anna", offers[number], "127.0.0.1", f"10.0.0.{number % 2}")
            answered_s.append(asyncio.get_running_loop().time())
            return name

        names = await asyncio.gather(*map(call, range(8)))
        assert np.diff(answered_s).min() >= 0.99 * ANSWER_EVERY_S
        assert [name in calls._calls for name in names] == [False] * 4 + [True] * 2 * MAX_WAITING

    run(work)


def test_rendering_begins_when_a_call_is_connected_and_every_two_seconds_for_one_address() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        name = await ask(calls, "10.0.0.9")
        await asyncio.sleep(2 * START_EVERY_S)
        assert studio.begun_s == []
        await calls.end(name)
        for number in range(6):  # calls and hangs up, again and again
            name = await connect(calls, "10.0.0.1", f"a{number}")
            await asyncio.sleep(0.5)
            await calls.end(name)
        assert len(studio.begun_s) <= 2
        studio.begun_s.clear()
        await asyncio.gather(*(connect(calls, "10.0.0.2", f"b{number}") for number in range(2)))
        await connect(calls, "10.0.0.3", "c")
        await connect(calls, "10.0.0.3", "c")  # its film is there already: no wait, no process
        await asyncio.sleep(3 * START_EVERY_S)
        assert len(studio.begun_s) == len(calls) == 4
        gap_s = sorted(studio.begun_s)[-1] - sorted(studio.begun_s)[0]
        assert START_EVERY_S - 1e-9 <= gap_s < START_EVERY_S + 0.5
        assert len(calls._started_s) <= 2

    run(work)


def test_a_call_does_not_keep_what_only_receivers_of_images_need() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        name, _ = await calls.watch("anna", (await offer("audio", "video"))[1], "127.0.0.1", "10.0.0.1")
        peers = [entry.peer for entry in calls._calls.values()]
        receivers = [transceiver.receiver for peer in peers for transceiver in peer.getTransceivers()]
        assert len(receivers) == 2
        assert all(one._RTCRtpReceiver__remote_bitrate_estimator is None for one in receivers)
        await calls.end(name)

    run(work)


def test_offers_of_one_address_are_answered_at_a_rate() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        _, data = await offer()
        answered, begun_s = 0, asyncio.get_running_loop().time()
        for number in range(40):
            with suppress(UsageError):
                await calls.end((await calls.watch("anna", data, "127.0.0.1", "10.0.0.1"))[0])
                answered += 1
            await asyncio.sleep(0.05)
            await calls.end((await calls.watch("ben", data, "127.0.0.1", f"10.0.1.{number}"))[0])
        length_s = asyncio.get_running_loop().time() - begun_s
        assert OFFERS < answered <= OFFERS + 1 + length_s * OFFERS_HZ < 30

    run(work)


def test_a_call_ends_in_words_if_its_rendering_cannot_begin() -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        studio.fails = True
        name = await connect(calls, "10.0.0.1")
        await asyncio.sleep(0.1)
        assert len(calls) == 0
        assert "cannot be started" in (await calls.end(name) or "")

    run(work)


def test_who_cannot_be_answered_nor_closed_keeps_nobody_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    async def work(calls: Calls, hub: Any, studio: Any) -> None:
        closes = asyncio.Event()

        def refuse(session: str) -> None:
            raise UsageError("sessions: full")

        with monkeypatch.context() as patch:
            patch.setattr(hub, "hold", refuse)
            patch.setattr(RTCPeerConnection, "close", lambda peer: closes.wait())
            with pytest.raises(UsageError, match="full"):
                await asyncio.wait_for(ask(calls, "10.0.0.1"), 60)
        assert len(calls) == 0
        await ask(calls, "10.0.0.2")
        closes.set()

    run(work)
