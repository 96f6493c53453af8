"""The whole server over real sockets: in by OSC, out as frames, and to the end in good order."""

import asyncio
import socket
from itertools import pairwise

import aiohttp
import pytest

from fapengine.errors import ResourceError, UsageError
from fapengine.server.config import Listen
from fapengine.server.server import Server
from fapengine.wire import osc
from fapengine.wire.framing import SlipDecoder, encode_slip
from tests.english import english
from tests.live.stage import Ear, Sender, config_of, on_a_loop, running, until


def test_a_sender_of_one_line_moves_a_mouth() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}")) as server:
            sender = Sender(server.osc_address)
            sender.tell("/phoneme", "sf", "a", 0.4)
            await until(lambda: max(ear.jaw("face"), default=0) > 50)
            await until(lambda: ear.jaw("face")[-1] == 0)
            sender.close()
        assert ear.missing("face") == 0
        ear.close()

    on_a_loop(main)


def test_closures_of_a_robust_sender_are_shown_and_it_hears_of_the_end() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}?session=anna")) as server:
            sender, told = Sender(server.osc_address), []
            sender.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            sender.utter("anna", 0, "maba")

            def finished() -> bool:
                told.extend(sender.answers())
                return any("finished" in message.arguments for message in told)

            await until(finished)
            kinds = [message.address for message in told]
            assert kinds[0] == "/fap/1/welcome"
            assert "/fap/1/ack" in kinds
            jaw = ear.jaw("anna")
            assert max(jaw) > 50
            sender.close()
        assert ear.jaw("anna")[-1] == 0
        ear.close()

    on_a_loop(main)


def test_words_by_osc_move_the_lips_as_they_come_and_a_simple_sender_hears_of_the_end() -> None:
    async def main() -> None:
        async with running(config_of()) as server:
            sender, told = Sender(server.osc_address), []
            sender.tell("/tts/events", "i", 1)
            begin_us, words = 300_000, ("Mama", "may", "hum")
            for index, word in enumerate(words):
                times = begin_us + index * 300_000, 300_000
                sender.tell("/fap/1/words", "siiisii", "face", 7, index, 1, word, *times)
            sender.tell("/fap/1/utt/end", "sii", "face", 7, len(words))
            shown: list[str] = []
            server.hub.listeners.on_command("face", lambda _, command, now_s: shown.extend(
                phone.label for phone in getattr(command, "phones", ())
            ))  # fmt: skip

            def finished() -> bool:
                told.extend(sender.answers())
                return any(message.arguments[0] == "finished" for message in told if message.address == "/tts/event")

            await until(finished)
            assert [label for label in shown if label in ("m", "p", "b")] == ["m", "m", "m", "m"]
            sender.close()

    on_a_loop(main)


def test_udp_and_tcp_share_a_port_and_may_drive_one_session() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}")) as server:
            reader, writer = await asyncio.open_connection(*server.osc_address)
            writer.write(encode_slip(osc.message("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 3)))
            slip, told = SlipDecoder(), []
            while not told:
                told += slip.feed(await reader.read(4096))
            assert osc.parse_packet(told[0])[0].address == "/fap/1/welcome"
            sender = Sender(server.osc_address)
            sender.utter("anna", 0, "mama")
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            while not any(b"started" in packet for packet in told):  # events go to who said hello
                told += slip.feed(await reader.read(4096))
            writer.close()
            await writer.wait_closed()
            await until(lambda: server.ingress.counts.streams == 0)
            sender.close()
        ear.close()

    on_a_loop(main)


def test_told_to_stop_it_lets_faces_come_to_rest_and_says_so() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}")) as server:
            sender = Sender(server.osc_address)
            sender.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            sender.utter("anna", 0, "maaaaaaaaaaaaaaaaaaaa")
            await until(lambda: len(ear.jaw("anna")) > 30 and ear.jaw("anna")[-1:] > [50])
            open_at = len(ear.jaw("anna")) - 1
        assert any("cancelled" in message.arguments for message in sender.answers())
        jaw = ear.jaw("anna")[open_at:]
        assert jaw[-1] == 0
        times_s = [frame.time_us * 1e-6 for frame in ear.frames["anna"][open_at:]]
        speeds = [(a - b) / (t - s) for (a, b), (s, t) in zip(pairwise(jaw), pairwise(times_s), strict=True) if t > s]
        assert 0 < max(speeds) < max(jaw) / 0.04  # a fade of 0.2 s at its fastest; it does not snap shut
        sender.close()
        ear.close()

    on_a_loop(main)


def test_a_token_keeps_strangers_out() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}", token="open sesame")) as server:
            sender = Sender(server.osc_address)
            sender.tell("/phoneme", "s", "a")
            sender.tell("/fap/1/hello", "sissis", "anna", 1, "ipa", "", 1, "wrong")
            await until(lambda: server.receiver.counts.refused == 2)
            assert server.hub.engine.sessions == ()
            sender.tell("/fap/1/hello", "sissis", "anna", 1, "ipa", "", 1, "open sesame")
            await until(lambda: server.hub.engine.sessions == ("anna",))
            sender.close()
        ear.close()

    on_a_loop(main)


def test_texts_are_spoken_by_the_servers_voice() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}")) as server:
            sender = Sender(server.osc_address)
            sender.tell("/tts/text", "s", "Mama.")
            await until(lambda: max(ear.jaw("face"), default=0) > 50)
            sender.tell("/tts/text", "s", "...")  # nothing to be spoken
            await until(lambda: (server.texts.spoken, server.texts.refused) == (1, 1))
            for _ in range(2):
                for _ in range(10):
                    sender.tell("/tts/text", "s", "Mama. " * 40)
                await asyncio.sleep(0.05)
            await until(lambda: server.texts.refused > 1)  # too many at once
            sender.tell("/tts/stop")
            sender.close()
        ear.close()

    on_a_loop(main)


def test_metrics_tell_what_happens() -> None:
    async def main() -> None:
        config = config_of("osc://127.0.0.1:9", token="t")
        listen = Listen(port=0, web_port=None, metrics_port=0, token="t")
        async with running(type(config)(listen=listen, style=config.style, sinks=config.sinks)) as server:
            sender = Sender(server.osc_address)
            sender.tell("/fap/1/hello", "sissis", "anna", 1, "ipa", "", 1, "t")
            sender.tell("/nobody/knows")
            await until(lambda: server.receiver.counts.unknown == 1 and server.hub.counts.frames > 3)
            (site,) = server.sites
            async with aiohttp.ClientSession() as web:
                async with web.get(f"http://{site[0]}:{site[1]}/metrics") as answer:
                    assert answer.status == 403
                async with web.get(
                    f"http://{site[0]}:{site[1]}/metrics", headers={"Authorization": "Bearer t"}
                ) as answer:
                    assert answer.content_type == "text/plain"
                    text = await answer.text()
            lines = dict(line.rsplit(" ", 1) for line in text.splitlines() if not line.startswith("#"))
            assert lines['fapengine_sessions{state="idle"}'] == "1.0"
            assert lines['fapengine_wire_total{kind="unknown"}'] == "1.0"
            assert lines['fapengine_intake_total{kind="datagrams"}'] == "2.0"
            assert float(lines["fapengine_frames_total"]) > 3
            assert float(lines["fapengine_tick_seconds_count"]) > 2
            assert float(lines['fapengine_sent_total{sink="osc://127.0.0.1:9"}']) > 0
            server.hub.close("anna")
            assert 'fapengine_speech_total{kind="cancelled"} 0.0' in server.metrics.text().decode()
            sender.close()

    on_a_loop(main)


def test_ports_that_are_taken_leave_nothing_open() -> None:
    async def main() -> None:
        taken = socket.socket()
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        for listen in (
            Listen(port=port, web_port=None), Listen(port=0, web_port=None, metrics_port=port),
        ):  # fmt: skip
            server = Server(type(config_of())(listen=listen), english())
            with pytest.raises(ResourceError, match=f"TCP port {port} on 127"):
                await server.start()
            with pytest.raises(UsageError, match=r"expected start\(\) before"):
                _ = server.osc_address
            assert server.sinks == server.sites == []
        taken.close()
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        datagrams.bind(("127.0.0.1", 0))
        server = Server(config_of(port=datagrams.getsockname()[1]), english())
        with pytest.raises(ResourceError, match="UDP port"):
            await server.start()
        datagrams.close()
        with pytest.raises(UsageError, match="sink: got"):
            await Server(config_of("what://is:1"), english()).start()

    on_a_loop(main)


def test_a_fault_of_the_engine_ends_the_server_and_not_in_silence() -> None:
    async def main() -> None:
        server = Server(config_of(), english())
        await server.start()

        def fail(now_s: float) -> None:
            raise ZeroDivisionError

        server.hub.engine.frame = fail  # type: ignore[method-assign, assignment]
        with pytest.raises(ZeroDivisionError):
            await server.run()

    on_a_loop(main)
