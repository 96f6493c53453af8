"""Checks of ``fapengine doctor``: window, sound, recognizer, ports, extras. Each returns what it found."""

WATCH_S, SETTLE_S = 0.4, 1.5
"""Shortest time for which a sound card is watched, and longest time that it may take to start."""
SAMPLE_RATE_HZ = 22_050
"""Sample rate of the voice."""
MAX_FETCH_RATIO = 4.0
"""Ratio of samples fetched to samples played above which a device has no real clock, such as ALSA's null device."""
ANSWER_S = 20.0
"""Longest time that the recognizer may take to answer."""


class LackError(Exception):
    """Something is missing; its arguments are what was found, and how to fix it."""


def window() -> str:
    """Open a hidden window."""
    from fapengine.app.face import has_display
    from fapengine.render.window import try_window

    if not has_display():
        raise LackError(
            "no display (neither DISPLAY nor WAYLAND_DISPLAY is set)",
            "fapengine serve shows the face in a browser; xvfb-run -a creates a virtual display",
        )
    return try_window()


def sound() -> str:
    """Open the default device, and check that its clock runs."""
    import time

    from fapengine.audio.device import Player, devices
    from fapengine.errors import ResourceError

    outputs = devices()
    if not outputs:
        raise LackError(
            "PortAudio works, but has no output device", "connect one; without it, the face speaks silently"
        )
    names = ", ".join(device.name for device in outputs[:3])
    names += f" and {len(outputs) - 3} more" if len(outputs) > 3 else ""
    try:
        with Player(SAMPLE_RATE_HZ) as player:
            begun_s = time.monotonic()
            while (took_s := time.monotonic() - begun_s) < SETTLE_S:
                if took_s > WATCH_S and player.is_settled(time.monotonic()):
                    break
                time.sleep(0.02)
            settled, clock = player.is_settled(time.monotonic()), player.clock
            fetched_s = clock.fetched / clock.sample_rate_hz
            description = player.description
    except ResourceError as error:
        raise LackError(f"{names}; {error}", "choose another: fapengine say TEXT --live --audio-device NAME") from error
    if fetched_s > MAX_FETCH_RATIO * (took_s + 0.2):
        raise LackError(
            f"{description}: plays faster than real time; it is a null device", "choose another: --audio-device NAME"
        )
    if not settled:
        raise LackError(f"{description}: opens, but does not play", "choose another: --audio-device NAME")
    return f"{description}, {1e3 * clock.latency_s:.0f} ms of latency, followed; devices: {names}"


def port_in(port: int) -> str:
    """Check that a port is free."""
    import socket

    for kind, name in ((socket.SOCK_DGRAM, "UDP"), (socket.SOCK_STREAM, "TCP")):
        with socket.socket(socket.AF_INET, kind) as probe:
            if kind == socket.SOCK_STREAM:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError as error:
                fix = f"stop the program that uses it (ss -lunp | grep {port}), or choose another port"
                raise LackError(f"{name} port is in use ({error.strerror})", fix) from error
    return "free"


def port_out(port: int) -> str:
    """Check whether a program receives at a port."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return "a program is receiving: fapengine serve --sink vmc://127.0.0.1"
    return "no program is receiving; start VSeeFace or another VMC receiver, or send to another machine"


def extra(*modules: str) -> str:
    """Import the modules of an extra."""
    from importlib import import_module
    from importlib.metadata import PackageNotFoundError, version

    versions = []
    for name in modules:
        import_module(name)
        try:
            versions.append(f"{name} {version(name.replace('_', '-'))}")
        except PackageNotFoundError:
            versions.append(name)
    return ", ".join(versions)


def recognizer() -> str:
    """Start the speech recognizer, and let it process a second of noise."""
    import time

    import numpy as np

    from fapengine.recognition.choice import SMALL, chosen
    from fapengine.recognition.process import RecognizerProcess
    from fapengine.recognition.protocol import RATE_HZ

    noise = np.random.default_rng(1).normal(0.0, 1000.0, RATE_HZ).astype(np.int16)
    begun_s = time.monotonic()
    ready_s = np.inf
    process = RecognizerProcess.open()
    try:
        process.begin()
        process.push(noise, RATE_HZ)
        process.end()
        while not any(heard.is_over for heard in process.poll()):
            now_s = time.monotonic()
            ready_s = min(ready_s, now_s) if process.is_ready else np.inf
            if now_s - begun_s > ANSWER_S:
                raise LackError(f"its process did not answer within {ANSWER_S:g} s", "stop other programs")
            time.sleep(0.01)
    finally:
        process.close()
    speed = 1.0 / max(time.monotonic() - ready_s, 1e-3)
    found = f"{chosen(None)}, {speed:.1f} x real time, ready in {ready_s - begun_s:.1f} s"
    if str(chosen(None)) == SMALL:
        found += "; PocketSphinx is not installed, so the small recognizer is used alone"
    if speed < 1.0:
        raise LackError(f"{found}: too slow for live audio", "stop other programs, or use a faster machine")
    return found


def microphone() -> str:
    """List the input devices."""
    from fapengine.audio.device import devices

    found = devices("input")
    if not found:
        raise LackError("no input device", "connect one; only live input needs it")
    return "; ".join(f"{device.number} {device.name}{' (default)' * device.is_default}" for device in found)


FOUND = """
import importlib.metadata, importlib.util, pathlib
spec = importlib.util.find_spec("mediapipe")
if spec is not None:
    folder = pathlib.Path(spec.origin).parent
    print(importlib.metadata.version("mediapipe"), any(folder.rglob("face_landmark*.tflite")))
"""
"""Program for the detector's Python: prints the version of mediapipe, and whether its wheel has a face model."""
MODEL_URL = "https://ai.google.dev/edge/mediapipe/solutions/vision/face_landmarker"


def detector() -> str:
    """Check that the face detector has mediapipe and a model."""
    import subprocess

    from fapengine.files.landmarks import detector_python

    python = detector_python()
    told = subprocess.run([str(python), "-I", "-c", FOUND], capture_output=True, text=True, timeout=30, check=False)
    version, _, has_model = told.stdout.strip().partition(" ")
    if not version:
        raise LackError(f"{python} has no mediapipe", f"{python} -m pip install --no-deps mediapipe==0.10.21")
    if has_model != "True":
        fix = f"face_landmarker.task from {MODEL_URL}, then fapengine capture --model; or mediapipe==0.10.21"
        raise LackError(f"mediapipe {version} at {python} has no face model", fix)
    return f"mediapipe {version}, with its face model"
