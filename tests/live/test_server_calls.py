"""``fapengine serve --webrtc``: an aiortc caller on the loopback, and what a server's calls refuse."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

import aiohttp
import numpy as np
import pytest

from bench import calls as bench
from fapengine.mesh.default_head.head import build_head
from fapengine.mpeg4 import fap
from fapengine.server.calls import calls as module
from fapengine.server.calls.offer import addresses_for
from fapengine.server.calls.tracks import FilmTracks
from fapengine.server.config import CallChoice, Face, Listen, ServerConfig, SoundChoice
from fapengine.server.server import Server
from fapengine.trajectory.style import Style
from tests.english import english
from tests.leaping import LeapingLoop
from tests.live.caller import SDP, Mouth, caller, speak, watch
from tests.live.stage import on_a_loop, until
from tests.unit.recognition.speech import BABY, spoken

LIMIT_S = 300.0
Serving = tuple[Server, str, aiohttp.ClientSession]


@asynccontextmanager
async def serving(
    *, head: str = "default", **listen: object
) -> AsyncIterator[tuple[Server, str, aiohttp.ClientSession]]:
    config = ServerConfig(
        listen=Listen(port=0, web_port=0, metrics_port=0, **listen),  # type: ignore[arg-type]
        face=Face(head=head), style=Style.speech_only(), calls=CallChoice(on=True, size=64, max_calls=2),
        sound=SoundChoice(recognizer="small"),
    )  # fmt: skip
    server = Server(config, english(), build_head())
    await server.start()
    running = asyncio.create_task(server.run())
    host, port = server.sites[0]
    try:
        async with aiohttp.ClientSession() as http:
            yield server, f"http://{host}:{port}", http
    finally:
        server.stop()
        await running


def test_a_caller_sees_lips_shut_on_the_m_that_it_hears(monkeypatch: pytest.MonkeyPatch) -> None:
    """Caller and server share a virtual time, which stands still while anything is spoken, drawn, coded or sent."""
    loop = LeapingLoop()
    monkeypatch.setattr(FilmTracks, "picture", FilmTracks.picture)  # which the measurement changes
    monkeypatch.setattr(bench, "Server", partial(Server, clock=loop.time))
    with monkeypatch.context() as patch, asyncio.Runner(loop_factory=lambda: loop) as runner:
        loop.lend(patch)
        seen = runner.run(bench.call("My mama bought plum jam."))
    told = bench.measured(seen)
    assert min(len(told["dark_shut"]), len(told["dark_open"])) >= 4
    assert max(told["dark_shut"]) < min(told["dark_open"])
    assert told["pictures_hz"] > 27.0
    assert max(told["arrival_p95_ms"], told["reports_p95_ms"]) < 10.0  # half a block of sound
    pictures = [(entry.stamp_s, entry.value[0]) for entry in seen.caller.pictures]
    begun_s, begun_ms = pictures[0]
    late_ms = [1000 * (stamp_s - begun_s) - (code_ms - begun_ms) % 2**16 for stamp_s, code_ms in pictures]
    assert np.allclose(late_ms, 0.0, atol=1.0)  # both tracks are stamped with the engine's time, ms
    assert np.allclose(np.diff([entry.stamp_s for entry in seen.caller.sounds]), 0.02)


def test_sound_that_comes_in_moves_the_face_and_goes_out_with_it() -> None:
    speech = spoken("rms", BABY)

    async def main() -> None:
        async with serving() as (server, url, http):
            jaws = [0]
            server.hub.hold("anna")
            server.hub.listeners.on_frame("anna", lambda frame: jaws.append(int(frame.faps[fap.column(3)])))
            sees = await watch(http, f"{url}/whep?session=anna", np.mean)
            says = await speak(http, f"{url}/whip?session=anna", np.tile(speech.samples, 100), 16_000)
            await until(lambda: max(jaws) > 100, LIMIT_S)
            await until(lambda: bool(np.abs(sees.sound[-48_000:].astype(int)).max(initial=0) > 3000), LIMIT_S)
            async with http.get(f"{url.rsplit(':', 1)[0]}:{server.sites[1][1]}/metrics") as answer:
                told = await answer.text()
            assert 'fapengine_calls{kind="watching"} 1.0' in told
            assert 'fapengine_calls{kind="speaking"} 1.0' in told
            third = caller(http)
            third.peer.addTrack(Mouth(speech.samples, 16_000))
            with pytest.raises(AssertionError, match="one more than 2"):
                await third.post(f"{url}/whip?session=berta")
            assert await says.end() == 200
            assert await says.end() == 410
            assert await sees.end() == 200
            assert len(server.studio) == 0
            for one in (sees, says, third):
                await one.close()

    on_a_loop(main, 2 * LIMIT_S)


def test_strangers_and_nonsense_are_refused_in_words_and_nobody_is_called_elsewhere() -> None:
    async def main() -> None:
        async with serving(token="t", origins=("https://shop.example",)) as (server, url, http):
            bearer = {"Authorization": "Bearer t"}
            own = caller(http)
            own.peer.addTransceiver("audio", direction="recvonly")
            await own.peer.setLocalDescription(await own.peer.createOffer())
            offer = own.peer.localDescription.sdp
            for headers, data, query, status in (
                (SDP, offer, "", 403),
                (SDP | bearer | {"Origin": "https://evil.example"}, offer, "", 403),
                (bearer, offer, "", 415),
                (SDP | bearer, "hello", "", 400),
                (SDP | bearer, "v=0\r\nm=audio 9 UDP/TLS/RTP/SAVPF 111\r\na=rtpmap:111", "", 400),
                (SDP | bearer, offer.replace("a=setup", "a=xetup"), "", 400),
                (SDP | bearer, offer + "m=audio 9 UDP/TLS/RTP/SAVPF 0\r\n", "", 400),
                (SDP | bearer, "v" * 200_000, "", 400),
                (SDP | bearer, offer, "?session=" + "x" * 500, 400),
            ):
                async with http.post(f"{url}/whep{query}", data=data, headers=headers) as answer:
                    assert (answer.status, data[:20]) == (status, data[:20])
                    assert "Traceback" not in await answer.text()
            async with http.delete(f"{url}/whep/nobody", headers=bearer) as answer:
                assert answer.status == 404
            async with http.patch(f"{url}/whep/nobody", headers=bearer) as answer:
                assert answer.status == 405
            async with http.options(f"{url}/whep", headers={"Origin": "https://shop.example"}) as answer:
                assert answer.headers["Access-Control-Allow-Origin"] == "https://shop.example"
                assert "Authorization" in answer.headers["Access-Control-Allow-Headers"]
            calls = server.calls
            assert calls is not None
            assert calls.counts.refused == 8
            assert 'fapengine_page_total{kind="refused"} 1.0' in server.metrics.text().decode()  # the session
            assert len(calls) == len(server.studio) == calls.counts.begun == 0
            await own.close()

            good = await watch(http, f"{url}/whep", np.mean, "t")
            answer_sdp = good.peer.remoteDescription.sdp
            places = {line.split()[4] for line in answer_sdp.splitlines() if line.startswith("a=candidate:")}
            assert places == set(addresses_for("127.0.0.1"))  # where it was asked, and the machine's own
            peer = next(iter(calls._calls.values())).peer
            remote = peer.getTransceivers()[0].sender.transport.transport.getRemoteCandidates()
            assert all(candidate.type == "prflx" for candidate in remote)  # none that the offer named
            await good.close()

    on_a_loop(main)


def test_a_call_ends_in_words_when_nothing_can_be_drawn_or_nobody_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CONNECT_S", 0.1)

    async def main() -> None:
        async with serving(head="nowhere") as (server, url, http):
            calls = server.calls
            assert calls is not None
            one = await watch(http, f"{url}/whep", np.mean)
            await until(lambda: calls.counts.begun == 1 and not len(calls))
            async with http.delete(one.place) as answer:
                assert answer.status == 410
                assert "nowhere" in await answer.text() or "not connected" in await answer.text()
            await one.close()
            silent = caller(http)
            silent.peer.addTransceiver("audio", direction="recvonly")
            await silent.peer.setLocalDescription(await silent.peer.createOffer())
            async with http.post(f"{url}/whep", data=silent.peer.localDescription.sdp, headers=SDP) as answer:
                place = f"{url}{answer.headers['Location']}"
                assert answer.headers["Digital-Source-Type"].endswith("/trainedAlgorithmicMedia")
            await silent.close()  # it never comes
            await until(lambda: not len(calls))
            assert calls.counts.lost >= 1
            assert calls.counts.watching == 0
            async with http.delete(place) as answer:
                assert answer.status == 410

    on_a_loop(main)


def test_the_measure_reads_stamps_that_begin_anew_at_zero() -> None:
    wire = bench.Wire({1000: 5.0, 3000: 5.1}, [(1000, 50.0), (2**32 - 500, 49.0)])
    assert wire.arrived_s(2000) == 5.1
    assert wire.sent_s(900, 90_000) == pytest.approx(50.01)


def test_config() -> None:
    with pytest.raises(ValueError, match=r"192\.0\.2\.7"):
        CallChoice(host="my machine")
    with pytest.raises(ValueError, match="even"):
        CallChoice(size=65)
    with pytest.raises(ValueError, match="workers"):
        replace(ServerConfig(listen=Listen(workers=2)), sinks=("camera://",))
