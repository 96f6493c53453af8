"""One face driven by phones, words with times, sound and texts, one after the other, and stopped in all of them."""

import asyncio

import numpy as np
import pytest
from numpy.typing import NDArray

from fapengine.clients.sender import Client
from fapengine.errors import UsageError
from fapengine.recognition.protocol import RATE_HZ
from fapengine.server.server import Server
from fapengine.speech.phone_track import Phone
from tests.live.stage import Ear, config_of, on_a_loop, running, until
from tests.patient import PatientClock
from tests.unit.recognition.speech import BABY, FAPU_MM, spoken

PHONES = [Phone(label, n / 8, (n + 1) / 8) for n, label in enumerate("mamapapa")]
WORDS = [("My", 0.1, 0.3), ("baby", 0.35, 0.75), ("mumbles", 0.8, 1.4), ("a", 1.45, 1.5), ("poem", 1.55, 2.0)]
AHEAD_S = 0.6
LIMIT_S = 300.0


def opening(ear: Ear, session: str, zero_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times from an engine time on, and mm by which the lips are open in the middle."""
    ear.listen()
    frames = ear.frames[session]
    at_s = np.array([frame.time_us * 1e-6 - zero_s for frame in frames])
    values = np.array([frame.values for frame in frames])
    return at_s, -(values[:, 3] + values[:, 4]) * FAPU_MM


async def over(face: Client, number: int) -> str:
    return await asyncio.to_thread(face.wait_until_finished, number, LIMIT_S)


async def at(clock: PatientClock, time_s: float) -> None:
    """Wait for a time of the clock."""
    await until(lambda: clock() >= time_s)


def moved(ear: Ear, since_s: float) -> float:
    at_s, open_mm = opening(ear, "anna", since_s)
    return float(open_mm[at_s > 0].max(initial=0.0))


@pytest.mark.parametrize("tcp", [False, True])
def test_words_move_the_lips_when_they_are_said(tcp: bool) -> None:
    """In three pieces, as a TTS tells them; the second comes when the first is being said."""

    async def main() -> None:
        ear, clock = Ear.open(), PatientClock()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}"), clock=clock) as server:
            host, port = server.osc_address
            with Client(host, port, session="anna", tcp=tcp, clock=clock) as face:
                await asyncio.to_thread(face.wait)
                zero_s = clock() + AHEAD_S
                number = face.send_words(WORDS[:2], at_s=zero_s)
                await at(clock, zero_s - AHEAD_S / 2)
                face.send_words(WORDS[2:4], utterance=number)
                face.send_words(WORDS[4:], utterance=number)
                face.end(number)
                assert await over(face, number) == "finished"
                await at(clock, zero_s + 2.6)
            assert server.hub.counts.skipped == 0
        at_s, open_mm = opening(ear, "anna", zero_s)

        def during(start_s: float, end_s: float) -> NDArray[np.float64]:
            found: NDArray[np.float64] = open_mm[(at_s >= start_s) & (at_s <= end_s)]
            return found

        assert during(-0.4, -0.1).max() < 0.5  # nothing before its time
        for word, start_s, end_s in WORDS:
            if word[0] in "Mbmp":  # each begins with shut lips, and opens
                assert during(start_s - 0.03, start_s + 0.15).min() < 0.5, word
                assert during(start_s, end_s).max() > 2, word
        assert during(2.3, 2.5).max() < 0.5
        ear.close()

    on_a_loop(main)


async def ready(server: Server) -> None:
    server.hub.open("warm")
    server.hearing.hear("warm", 1 << 29, np.zeros(320, np.int16), RATE_HZ, is_placed=False, is_last=True)
    await until(lambda: server.hearing.counts.heard_s > 0)
    server.hearing.drop("warm")


def test_a_session_may_switch_between_all_of_them() -> None:
    async def main() -> None:
        ear, clock = Ear.open(), PatientClock()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}"), clock=clock) as server:
            await ready(server)
            host, port = server.osc_address
            speech = spoken("rms", BABY).samples[: RATE_HZ * 3 // 2]
            with Client(host, port, session="anna", clock=clock) as face:
                for kind in ("phones", "words", "sound", "phones", "sound", "words"):
                    began_s = clock()
                    if kind == "phones":
                        number = face.send_phones(PHONES)
                    elif kind == "words":
                        number = face.send_words(WORDS[:3])
                        face.end(number)
                    else:
                        number = face.send_audio(speech, RATE_HZ)
                        face.end(number)
                    assert await over(face, number) == "finished", kind
                    assert moved(ear, began_s) > 2, kind
                began_s = clock()
                face.send_text("Mama.")  # the server's own voice
                await until(lambda: moved(ear, began_s) > 2)
            assert server.hub.engine.counters("anna").dropped == 0
        ear.close()

    on_a_loop(main)


def test_a_barge_in_empties_phones_words_sound_and_texts() -> None:
    async def main() -> None:
        ear, clock = Ear.open(), PatientClock()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}"), clock=clock) as server:
            await ready(server)
            host, port = server.osc_address
            with Client(host, port, session="anna", clock=clock) as face:
                long = [("mama", n * 0.5, n * 0.5 + 0.4) for n in range(20)]
                numbers = [face.send_audio(np.tile(spoken("rms", BABY).samples, 3), RATE_HZ), face.send_words(long)]
                numbers.append(face.send_phones(PHONES * 1))
                face.send_text("My mama may make more mumbling mammals, and many more, and more.")
                await until(lambda: max(ear.jaw("anna"), default=0) > 50)
                face.cancel()
                assert [await over(face, number) for number in numbers] == ["cancelled"] * 3
                cancelled_s = clock()
                await at(clock, cancelled_s + 1.2)
                at_s, open_mm = opening(ear, "anna", cancelled_s)
                assert np.abs(open_mm[at_s > 0.4]).max() < 0.5
                assert server.hub.engine.state("anna") == "idle"
                number = face.send_words(WORDS[:2])  # and goes on with what is said next
                face.end(number)
                assert await over(face, number) == "finished"
        ear.close()

    on_a_loop(main)


def test_words_that_cannot_be_are_refused() -> None:
    with Client(port=9, session="anna") as face:
        with pytest.raises(UsageError, match="starts at"):
            face.send_words([("one", 1.0, 2.0), ("two", 0.2, 0.5)])
        with pytest.raises(UsageError, match="voice"):
            face.send_words([("one", 0.0, 1.0)], voice="no such language")
        number = face.begin(audio=True)
        face.send_audio(np.zeros(800, np.int16), 16_000, utterance=number)
        with pytest.raises(UsageError, match="got phones and sound"):
            face.send_words(WORDS, utterance=number)
        face.cancel()
