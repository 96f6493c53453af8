"""A face as a camera, and as a stream that PyAV receives. The camera is a stand-in: no system here has one."""

import asyncio
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from fapengine.errors import ResourceError, UsageError
from fapengine.server.config import Listen, ServerConfig
from fapengine.server.sinks.kinds import parse_sink
from fapengine.server.sinks.opening import open_sink
from tests.live.stage import on_a_loop, running, until
from tests.processes import free_port, start
from tests.unit.server.test_server_sinks import Stage

LISTENER = """
import av, numpy, sys, time
def receive():
    with av.open(sys.argv[1], options={"listen": "1"}) as stream:
        codecs = [s.codec_context.name for s in stream.streams]
        seen, loud = 0, 0
        for frame in stream.decode():
            if isinstance(frame, av.VideoFrame):
                seen += 1
                middle = frame.to_ndarray(format="rgb24")[60:70, 60:70].mean(axis=(0, 1))
            else:
                loud = max(loud, float(numpy.abs(frame.to_ndarray()).max()))
            if seen > 20 and loud > 0.1:
                return codecs, frame.time, middle
    raise OSError("the stream ended")
while True:
    try:
        codecs, time_s, middle = receive()
        break
    except (OSError, EOFError, av.error.FFmpegError) as error:  # that connection broke off: receive the next one
        print(repr(error), file=sys.stderr, flush=True)
        time.sleep(0.1)
print(*codecs)
print(time_s > 0, *middle.round())
"""


class Camera:
    """What pyvirtualcam's camera is to us. Stateful."""

    made: list["Camera"] = []  # noqa: RUF012  the test empties it

    def __init__(self, **options: object) -> None:
        if options["device"] == "none":
            raise RuntimeError("v4l2loopback is not loaded")
        self.options, self.pictures, self.is_closed = options, [], False
        Camera.made.append(self)

    def send(self, picture: np.ndarray) -> None:
        self.pictures.append(picture.copy())

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("pyvirtualcam")
    module.Camera, module.PixelFormat = Camera, SimpleNamespace(I420="i420")  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pyvirtualcam", module)
    Camera.made.clear()


def config(*urls: str) -> ServerConfig:
    return ServerConfig(listen=Listen(port=0, web_port=None), sinks=urls)


@pytest.mark.usefixtures("stand_in")
def test_a_camera_is_shown_the_face_again_and_again() -> None:
    async def main() -> None:
        async with running(config("camera://?size=64&fps=50&session=anna")) as server:
            assert server.sink_names == ["camera://?session=anna"]
            camera = Camera.made[0]
            await until(lambda: len(camera.pictures) > 5)
            assert camera.options == {"width": 64, "height": 64, "fps": 50.0, "fmt": "i420", "device": None}
            assert camera.pictures[0].shape == (96, 64)
            assert camera.pictures[0][32, 32] > 110  # luma of skin
        assert camera.is_closed

    on_a_loop(main)


@pytest.mark.usefixtures("stand_in")
def test_a_camera_that_is_not_there_is_told() -> None:
    async def main() -> None:
        with pytest.raises(ResourceError, match="v4l2loopback"):
            async with running(config("camera://?device=none")):
                pass

    on_a_loop(main)


def test_without_the_library_the_line_that_mends_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvirtualcam", None)

    async def main() -> None:
        with pytest.raises(ResourceError, match=r'pip install "fapengine\[camera\]"'):
            async with running(config("camera://")):
                pass

    on_a_loop(main)


def test_a_stream_is_received_with_picture_and_sound() -> None:
    port = free_port()
    url = f"rtmp://127.0.0.1:{port}/live/secret"
    command = [sys.executable, "-c", LISTENER, url]

    async def main() -> None:
        async with running(config(f"{url}?size=128&fps=25")) as server:
            assert server.sink_names == [f"rtmp://127.0.0.1:{port}"]  # the key is shown nowhere
            with start(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as listener:
                sink = server.sinks[0]
                await until(lambda: sink.counts.sent > 10)  # it came later than the server, and was found
                received = asyncio.create_task(asyncio.to_thread(listener.communicate, timeout=300))
                while not received.done():  # a receiver that came again has missed what was said before
                    await server.hub.speak("face", "Mama, bring me some jam. And a pipe, please, and bananas.")
                    await asyncio.wait([received], timeout=20)
                told, errors = received.result()
            codecs, last = told.splitlines()
            assert codecs == "h264 aac", errors
            grows, red, *_, blue = last.split()
            assert grows == "True"
            assert float(red) > max(140, float(blue) + 15)  # skin

    on_a_loop(main)


def test_a_protocol_that_ffmpeg_does_not_speak_is_refused() -> None:
    """PyAV's wheels have no SRT; where one has, the address is taken and a receiver waited for."""

    async def main() -> None:
        try:
            async with running(config("srt://127.0.0.1:9?size=64")) as server:
                assert server.sink_names == ["srt://127.0.0.1:9"]
        except ResourceError as error:
            assert "does not support srt; send rtmp://" in str(error)  # noqa: PT017  one of both

    on_a_loop(main)


@pytest.mark.parametrize(
    "url",
    ["camera://host", "camera://?size=no", "camera://?size=65", "camera://?fps=0", "rtmp://127.0.0.1",
     "rtmp://127.0.0.1/a?kbit_s=1", "srt://127.0.0.1", "srt://127.0.0.1:9/path", "srt://127.0.0.1:9?size=99999"],
)  # fmt: skip
def test_addresses_that_cannot_be_are_refused(url: str) -> None:
    async def main() -> None:
        await open_sink(None, parse_sink(url), studio=object())  # type: ignore[arg-type]

    with pytest.raises(UsageError):
        asyncio.run(main())


def test_where_nothing_draws_there_are_no_pictures() -> None:
    with pytest.raises(UsageError, match="renders"):
        asyncio.run(open_sink(Stage().hub, parse_sink("camera://")))
