"""The face in Pipecat itself: its own ``run_test``, and its WebRTC transport with a client on the loopback.

``make oracles`` runs it in an environment of its own, for Pipecat pins other versions than ours.
"""

import asyncio
import math
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from aiortc import RTCPeerConnection, RTCSessionDescription
from pipecat.frames.frames import (
    EndFrame,
    InterruptionFrame,
    OutputImageRawFrame,
    TTSAudioRawFrame,
    TTSStartedFrame,
    TTSStoppedFrame,
    TTSTextFrame,
)
from pipecat.pipeline.pipeline import Pipeline
from pipecat.pipeline.worker import PipelineWorker
from pipecat.tests.utils import SleepFrame, run_test
from pipecat.transports.base_transport import TransportParams
from pipecat.transports.smallwebrtc.connection import SmallWebRTCConnection
from pipecat.transports.smallwebrtc.transport import SmallWebRTCTransport
from pipecat.workers.runner import WorkerRunner

from fapengine.agents.face import AgentOptions
from fapengine.agents.pictures import Picture
from fapengine.agents.pipecat import FapengineVideoService
from fapengine.recognition.choice import new_recognizer
from fapengine.voices.espeak import EspeakVoice
from tests.direct_recognizer import DirectRecognizer
from tests.frameworks.check_livekit import StandInPainter
from tests.frameworks.clock import in_time
from tests.leaping import LeapingLoop

TEXT = "My mama bought a big pumpkin, and Bob made plum jam for me."
MAX_OFF_S, MAX_PIPELINE_OFF_S = 0.04, 0.03
"""Distance of 95 % of the pictures from their sound: by the clock of a machine that has time, and on virtual time."""
CODE_BITS, CODE_PX = 10, 24
RATE_HZ = 25
"""Pictures a second."""
HELD_S = 0.08
"""Time for which aiortc's receiver holds sound, and not pictures: four packets (``JitterBuffer(prefetch=4)``)."""


def sound_frames(samples: np.ndarray, rate_hz: int, piece_s: float = 0.04) -> list[TTSAudioRawFrame]:
    step = int(rate_hz * piece_s)
    pieces = (samples[start : start + step].tobytes() for start in range(0, len(samples), step))
    return [TTSAudioRawFrame(audio=piece, sample_rate=rate_hz, num_channels=1) for piece in pieces]


async def through(face: FapengineVideoService, sent: list[object]) -> list[object]:
    await face._face.ready()
    down, _ = await run_test(face, frames_to_send=sent, start_timeout=20)
    return list(down)


def kinds(frames: list[object]) -> list[str]:
    return [key for key, _ in groupby(type(frame).__name__ for frame in frames)]


async def _slowly(takes_s: float, given: np.ndarray) -> list[tuple[float, object]]:
    """Frames that a face pushes whose images take a time, each with the time at which it came."""
    face = FapengineVideoService(size=(64, 64), hears=False)
    face._face.painter.close()
    face._face.painter = StandInPainter(takes_s)
    push, pushed = face.push_frame, []

    async def spy(frame: object, *more: object) -> None:
        pushed.append((time.monotonic(), frame))
        await push(frame, *more)

    face.push_frame = spy
    sent = [TTSStartedFrame(), *sound_frames(given, 24_000), TTSStoppedFrame(), SleepFrame(len(given) / 24_000 + 0.5)]
    await run_test(face, frames_to_send=sent)
    return pushed


def _in_virtual_time(
    monkeypatch: pytest.MonkeyPatch, takes_s: float, length_s: float
) -> tuple[list[tuple[float, object]], np.ndarray]:
    loop, given = LeapingLoop(), np.random.default_rng(1).integers(-9000, 9000, round(24_000 * length_s), np.int16)
    loop.lend(monkeypatch)
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        return runner.run(_slowly(takes_s, given)), given


def test_each_sound_has_its_picture_and_all_of_it_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    pushed, given = _in_virtual_time(monkeypatch, 0.017, 1.01)
    down = [frame for _, frame in pushed]
    passed = b"".join(frame.audio for frame in down if isinstance(frame, TTSAudioRawFrame))
    assert passed == given.tobytes()
    pictures = [frame for frame in down if isinstance(frame, OutputImageRawFrame)]
    assert sum(frame.sync_with_audio for frame in pictures) == 26
    talk = [
        "sound" if isinstance(frame, TTSAudioRawFrame) else "picture"
        for frame in down
        if isinstance(frame, TTSAudioRawFrame) or getattr(frame, "sync_with_audio", False)
    ]
    assert talk == (["sound", "picture", "sound"] * 26)[: len(talk)]
    after = kinds(down)
    assert after.index("TTSStoppedFrame") > len(after) - 1 - after[::-1].index("TTSAudioRawFrame")


@pytest.mark.parametrize("takes_s", [0.005, 0.06, 0.1, 0.2, 1e6])
def test_sound_never_waits_for_pictures(monkeypatch: pytest.MonkeyPatch, takes_s: float) -> None:
    pushed, given = _in_virtual_time(monkeypatch, takes_s, 4.0)
    heard = [(at_s, frame) for at_s, frame in pushed if isinstance(frame, TTSAudioRawFrame)]
    assert b"".join(frame.audio for _, frame in heard) == given.tobytes()
    played_s = 0.0
    for at_s, frame in heard:
        assert at_s - heard[0][0] <= played_s + 1e-6
        played_s += len(frame.audio) / 48_000
    shown = sum(isinstance(frame, OutputImageRawFrame) for _, frame in pushed)
    assert shown >= min(100, int(0.9 * 4.0 / takes_s))
    print(f"a picture takes {takes_s:g} s: {shown} shown")


def test_a_painter_that_dies_ends_neither_sound_nor_pipeline() -> None:
    speech = EspeakVoice("en-us").speak(TEXT)
    face = FapengineVideoService(size=(64, 64), hears=False)

    async def killed() -> list[object]:
        asyncio.get_running_loop().call_later(1.0, face._face.painter._child.kill)
        sent = [TTSStartedFrame(), *sound_frames(speech.samples, speech.sample_rate_hz), TTSStoppedFrame()]
        return await through(face, [*sent, SleepFrame(speech.duration_s + 1.0)])

    down = asyncio.run(killed())
    assert b"".join(frame.audio for frame in down if isinstance(frame, TTSAudioRawFrame)) == speech.samples.tobytes()
    assert face._face.pictures.counts.restarts == 1
    assert isinstance(down[-1], EndFrame | OutputImageRawFrame | TTSStoppedFrame)


def test_an_interruption_drops_what_was_not_sent() -> None:
    speech = EspeakVoice("en-us").speak(TEXT)
    face = FapengineVideoService(size=(64, 64))
    sent = [
        TTSStartedFrame(), *sound_frames(speech.samples, speech.sample_rate_hz), SleepFrame(2.5), InterruptionFrame(),
        SleepFrame(0.5),
    ]  # fmt: skip
    down = asyncio.run(through(face, sent))
    passed = b"".join(frame.audio for frame in down if isinstance(frame, TTSAudioRawFrame))
    assert 0 < len(passed) < len(speech.samples.tobytes())
    names = [type(frame).__name__ for frame in down]
    assert "TTSAudioRawFrame" not in names[names.index("InterruptionFrame") :]


def test_words_with_times_come_out_later_by_as_much_as_their_sound() -> None:
    speech = EspeakVoice("en-us").speak("My mama.")
    face = FapengineVideoService(size=(64, 64), hears=False)
    word = TTSTextFrame("mama", text_type="word")
    word.pts = 1
    sent = [TTSStartedFrame(), *sound_frames(speech.samples, speech.sample_rate_hz), word, TTSStoppedFrame()]
    down = asyncio.run(through(face, sent))
    told = next(frame for frame in down if isinstance(frame, TTSTextFrame))
    assert told.pts > 1
    assert isinstance(down[-1], TTSStoppedFrame | OutputImageRawFrame | EndFrame)


@pytest.mark.timeout(240)
def test_a_client_sees_lips_shut_on_the_m_that_it_hears(monkeypatch: pytest.MonkeyPatch) -> None:
    """Video and sound as an aiortc client gets them: each picture carries its number, beside the face.

    On virtual time, so that no work takes any: the distance is that of the pipeline, the transport and the packets.
    """
    loop = LeapingLoop()
    loop.lend(monkeypatch)
    monkeypatch.setattr("fapengine.agents.face.RecognizerProcess.open", lambda: DirectRecognizer(new_recognizer(None)))
    p95_s, openness = _called(lambda: loop)
    assert p95_s <= MAX_PIPELINE_OFF_S
    assert openness < 0.35  # .26 seen; pictures that are late by a phone mix both


@pytest.mark.timeout(240)
def test_so_does_a_client_by_the_clock() -> None:
    in_time(_called, lambda found: found[0] <= MAX_OFF_S and found[1] < 0.35)


def _called(loop: Callable[[], asyncio.AbstractEventLoop] | None = None) -> tuple[float, float]:
    """Call once: how far pictures were from their sound, s (95 %), and how open m p b were, of open vowels."""
    speech = EspeakVoice("en-us").speak(TEXT)
    with asyncio.Runner(loop_factory=loop) as runner:
        seen, heard = runner.run(_call(speech.samples, speech.sample_rate_hz))
    sound = np.concatenate([samples for _, _, samples in heard]).astype(float)
    starts = np.cumsum([0, *(len(samples) for _, _, samples in heard)])[:-1]
    first = _found(speech.samples.astype(float), speech.sample_rate_hz, sound)
    sounds_s = _played(heard)
    talking = [(at_s, code, dark) for at_s, _, code, dark in seen if code]  # the transport's stamps of pictures drift
    if len({code for _, code, _ in talking}) <= 0.5 * speech.duration_s * RATE_HZ:
        return math.inf, math.inf  # most pictures were skipped: the machine has too much to do
    off_s, dark_of = [], {}
    shown = set()
    for at_s, code, dark in talking:
        position_s = (code - 1) / RATE_HZ
        dark_of[code] = dark
        if code not in shown:
            shown.add(code)
            playing_s = (np.interp(at_s, sounds_s, starts) - first) / 48_000
            off_s.append(playing_s - position_s)
    p95_s = np.percentile(np.abs(off_s), 95)
    spread = ", ".join(f"{1e3 * off:.0f}" for off in np.percentile(off_s, [5, 25, 50, 75, 95]))
    print(f"sound ahead of video, ms (5, 25, 50, 75, 95 %): {spread}; {len(off_s)} pictures")
    at = {"shut": [], "open": []}
    for phone in speech.phones.phones:
        code = 1 + round(RATE_HZ * (phone.start_s + 0.4 * phone.duration_s))
        if code in dark_of and phone.duration_s > 0.04 and phone.label in ("m", "p", "b", "ɑː", "ʌ", "æ", "ɔː", "eɪ"):
            at["shut" if phone.label in "mpb" else "open"].append(dark_of[code])
    print("dark pixels of the mouth:", at)
    line = min(dark_of.values())  # the line between shut lips is as dark
    return float(p95_s), float((np.median(at["shut"]) - line) / (np.median(at["open"]) - line))


def _played(received: list[tuple]) -> np.ndarray:  # type: ignore[type-arg]
    """Times at which a player plays what it got: by its timestamp, as soon as half of the packets allow."""
    arrived_s, stamps_s = np.array([entry[:2] for entry in received]).T
    return stamps_s + np.median(arrived_s - stamps_s) - HELD_S


def _found(sent: np.ndarray, rate_hz: int, received: np.ndarray) -> int:
    """Sample of the received sound, 48 kHz, at which the sent one begins."""
    wanted = np.interp(np.arange(0, len(sent) / rate_hz, 1 / 48_000), np.arange(len(sent)) / rate_hz, sent)
    size = 1 << int(np.ceil(np.log2(len(received) + len(wanted))))
    match = np.fft.irfft(np.fft.rfft(received, size) * np.conj(np.fft.rfft(wanted, size)), size)
    return int(np.argmax(match[: len(received)]))


async def _call(
    samples: np.ndarray, rate_hz: int
) -> tuple[list[tuple[float, float, int, int]], list[tuple[float, float, np.ndarray]]]:
    size = (256, 256)
    face = FapengineVideoService(options=AgentOptions(size=size, frame_rate_hz=RATE_HZ))
    _number_pictures(face)
    client, connection = RTCPeerConnection(), SmallWebRTCConnection()
    params = TransportParams(
        audio_out_enabled=True, video_out_enabled=True, video_out_width=size[0], video_out_height=size[1],
        video_out_framerate=30, audio_out_10ms_chunks=1,
    )  # fmt: skip
    transport = SmallWebRTCTransport(connection, params)
    worker = PipelineWorker(Pipeline([face, transport.output()]), cancel_on_idle_timeout=False)
    runner = WorkerRunner()
    await runner.add_workers(worker)
    seen: list[tuple[float, float, int, int]] = []
    heard: list[tuple[float, float, np.ndarray]] = []
    readers = []

    @client.on("track")
    def on_track(track: object) -> None:
        readers.append(asyncio.ensure_future(_read(track, seen, heard)))

    client.addTransceiver("audio", direction="recvonly")
    client.addTransceiver("video", direction="recvonly")
    await client.setLocalDescription(await client.createOffer())
    await connection.initialize(client.localDescription.sdp, client.localDescription.type)
    answer = connection.get_answer()
    await client.setRemoteDescription(RTCSessionDescription(answer["sdp"], answer["type"]))
    running = asyncio.ensure_future(runner.run())
    await connection.connect()
    await face._face.ready()
    await asyncio.sleep(2.0)
    for frame in [TTSStartedFrame(), *sound_frames(samples, rate_hz), TTSStoppedFrame()]:
        await worker.queue_frame(frame)
    await asyncio.sleep(len(samples) / rate_hz + 2.5)
    for reader in readers:
        reader.cancel()
    await client.close()
    await worker.cancel()
    await asyncio.wait_for(running, 20)
    return seen, heard


def _number_pictures(face: FapengineVideoService) -> None:
    """Write into each picture, at its top, the number of its frame of sound; 0 in silence."""
    make, draw = face._face.frame, face._face.drawn
    said = 0
    numbers: dict[float, int] = {}

    def frame(now_s: float) -> object:
        nonlocal said
        made = make(now_s)
        said += bool(made[0].sounds)
        numbers[face._face.plays_s] = said if made[0].sounds else 0
        return made

    async def drawn(most_s: float) -> Picture | None:
        picture = await draw(most_s)
        if picture is None:
            return None
        code = numbers[picture.due_s]
        pixels = np.frombuffer(picture.pixels, np.uint8).reshape(256, 256, 3).copy()
        for bit in range(CODE_BITS):
            pixels[:CODE_PX, bit * CODE_PX : (bit + 1) * CODE_PX] = 255 * (code >> bit & 1)
        return replace(picture, pixels=pixels.tobytes())

    face._face.frame, face._face.drawn = frame, drawn  # type: ignore[method-assign]


async def _read(
    track: object, seen: list[tuple[float, float, int, int]], heard: list[tuple[float, float, np.ndarray]]
) -> None:
    while True:
        frame = await track.recv()  # type: ignore[attr-defined]
        now_s = time.monotonic()
        if track.kind == "audio":  # type: ignore[attr-defined]
            pieces = frame.to_ndarray().reshape(-1, len(frame.layout.channels))[:, 0]
            heard.append((now_s, float(frame.pts * frame.time_base), pieces.copy()))
            continue
        pixels = frame.to_ndarray(format="rgb24").astype(int)
        bits = pixels[4 : CODE_PX - 4, :, :].mean(axis=(0, 2))
        code = sum((bits[bit * CODE_PX + 6 : (bit + 1) * CODE_PX - 6].mean() > 128) << bit for bit in range(CODE_BITS))
        mouth = pixels[158:196, 98:158]
        seen.append((now_s, float(frame.pts * frame.time_base), int(code), int((mouth[..., 1] < 80).sum())))
