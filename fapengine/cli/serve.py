"""``fapengine serve``: a live server for text, phones and audio that shows faces."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine import speaking
from fapengine.cli import options as shared

if TYPE_CHECKING:
    from collections.abc import Callable

    from fapengine.mesh.face_mesh import FaceMesh
    from fapengine.profiles import Profile
    from fapengine.server.cluster.workers import Workers
    from fapengine.server.config import ServerConfig
    from fapengine.server.server import Server
    from fapengine.server.watchdog import Watchdog


def serve(
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="TOML configuration file. Command-line options override it.")
    ] = None,
    host: Annotated[
        str | None,
        typer.Option(
            help="Address to listen on. Use 0.0.0.0 for all interfaces, and set --token. [default: 127.0.0.1]"
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(
            "--port", "-p", min=0, max=65535, help="Port for OSC, UDP and TCP. 0 picks a free port. [default: 9110]"
        ),
    ] = None,
    web_port: Annotated[
        int | None,
        typer.Option(
            "--web-port",
            "-w",
            min=0,
            max=65535,
            help="Port for the web page and WebSocket. 0 picks a free port. [default: 8110]",
        ),
    ] = None,
    no_page: Annotated[bool, typer.Option("--no-page", help="Do not serve the web page.")] = False,
    sink: Annotated[
        list[str],
        typer.Option(
            "--sink",
            "-s",
            help=f"Send frames to this URL: {shared.SINKS}. ?session=NAME chooses a face. Repeatable.",
            autocompletion=shared.complete_sink,
        ),
    ] = [],  # noqa: B006  typer copies it
    play: Annotated[
        str | None,
        typer.Option(
            metavar="SESSION",
            help="Play this session's voice on the server's audio output. The default session is 'face'.",
        ),
    ] = None,
    device: shared.Device = None,
    mic: Annotated[
        str | None,
        typer.Option(
            metavar="DEVICE",
            help="Drive the session 'face' from a microphone on the server: default, its number, or part of its name.",
        ),
    ] = None,
    recognizer: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Speech recognizer for incoming audio: small, sphinx, both or MODEL.onnx. See `fapengine animate"
            " --help`.",
        ),
    ] = None,
    webrtc: Annotated[
        bool,
        typer.Option(
            "--webrtc",
            help="Enable WebRTC on the web port: /whep streams video and audio, /whip receives audio, /call.html is a"
            " demo page.",
        ),
    ] = False,
    token: Annotated[
        str | None, typer.Option(envvar="FAPENGINE_TOKEN", help="Secret that clients and browsers must present.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=256,
            help="Number of worker processes, one per core. A dispatcher process assigns sessions to them. Linux only."
            " [default: 1]",
        ),
    ] = None,
    nats: Annotated[
        str | None,
        typer.Option(
            metavar="nats://HOST:PORT", help="Share sessions with every server that uses the same NATS server."
        ),
    ] = None,
    metrics_port: Annotated[
        int | None,
        typer.Option(min=0, max=65535, help="Port for Prometheus metrics, at /metrics. 0 picks a free port."),
    ] = None,
    log: Annotated[
        str | None, typer.Option(help="Log format: text or json (one object per line). [default: text]")
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log every utterance.")] = False,
    profile: speaking.ProfileName | None = None,
    head: Annotated[str | None, typer.Option(help="Head shown on the web page. Same values as `say --head`.")] = None,
    fps: speaking.Fps | None = None,
    articulation: speaking.Articulation | None = None,
    jaw: speaking.Jaw | None = None,
    lips: speaking.Lips | None = None,
    loudness: speaking.Loudness | None = None,
    liveliness: speaking.Liveliness | None = None,
    method: speaking.MethodName | None = None,
    without: speaking.Without = (),
    seed: speaking.Seed | None = None,
    voice: speaking.Voice | None = None,
    wpm: speaking.Rate | None = None,
    ssml: speaking.Ssml | None = None,
) -> None:
    """Run a live server: receives text, phones or audio, and shows faces in the browser and in other programs.

        fapengine serve
        fapengine serve --sink vmc://127.0.0.1:39539 --sink osc://127.0.0.1:9100
        fapengine serve --workers 8

    Any OSC client can make the face speak (python-osc, Pure Data, Max), on port 9110:

        /phoneme s "m"      /phoneme s "a" f 0.2      /viseme s "O"
        /tts/text s "Hello there."      /tts/stop

    For lossless delivery and clock synchronization, use fapengine.Client. See docs/osc.md. Use --sink to send the face
    to other programs.

    One process uses one core. --workers 8 starts eight that share the ports; if one fails, the others continue.
    --nats nats://HOST:4222 does the same across machines.

    Ctrl-C or SIGTERM returns all faces to neutral and stops the server.
    """
    from dataclasses import replace

    from fapengine.errors import UsageError
    from fapengine.server.config import ServerConfig, load_config, overridden
    from fapengine.server.sinks.kinds import parse_sink

    for url in sink:
        parse_sink(url)
    own = load_config(config) if config else ServerConfig()
    listen = overridden(
        own.listen, host=host, port=port, web_port=web_port, metrics_port=metrics_port, token=token, workers=workers
    )
    speaker = overridden(own.sound, session=play, device=device, microphone=mic, recognizer=recognizer)
    if speaker.device and not speaker.session:
        raise UsageError("--audio-device: requires --play SESSION")
    style = overridden(
        own.style,
        articulation=articulation,
        jaw=jaw,
        lips=lips,
        loudness_db=loudness,
        liveliness=liveliness,
        method=method,
    )
    calls = overridden(own.calls, on=True if webrtc else None)
    if calls.on and (no_page or listen.web_port is None):
        raise UsageError("--webrtc: requires the web page; remove --no-page, or set --web-port")
    chosen = ServerConfig(
        listen=replace(
            listen,
            web_port=None if no_page else listen.web_port,
            provenance=listen.provenance and speaking.PROVENANCE not in without,
        ),
        face=overridden(own.face, profile=profile, head=head, rate_hz=fps, seed=seed),
        style=style.without(without),
        voice=overridden(own.voice, name=voice, rate_wpm=wpm, ssml=ssml),
        sound=speaker,
        calls=calls,
        limits=own.limits,
        bus=overridden(own.bus, url=nats),
        log=overridden(own.log, format=log, level="debug" if verbose else None),
        sinks=(*own.sinks, *sink),
    )
    _start(chosen)


def _start(config: "ServerConfig") -> None:
    import asyncio

    from fapengine._late import needed
    from fapengine.files.heads.load import load_head
    from fapengine.files.profiles import load_profile
    from fapengine.server.logs import begin_log
    from fapengine.server.watchdog import start_watchdog

    for name in ("aiohttp", "prometheus_client"):
        needed(name, name, "serve")
    if config.calls.on:
        from fapengine.server.calls.calls import need_aiortc

        need_aiortc()
    begin_log(config.log.level, config.log.format)
    face = load_head(config.face.head) if config.listen.web_port is not None else None
    profile = load_profile(config.face.profile)
    if config.has_parent:  # workers load head and profile themselves; this checks that they can
        asyncio.run(_run_workers(config))
        return
    with start_watchdog(config.sinks, config.face.rate_hz) as watchdog:
        asyncio.run(_run(config, profile, face, watchdog))


def stop_on_signals(stop: "Callable[[], None]") -> None:
    """Call ``stop`` at Ctrl-C and SIGTERM; needs the event loop."""
    import asyncio
    import signal

    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        try:
            loop.add_signal_handler(number, stop)
        except NotImplementedError:  # Windows
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(stop))


async def _run(config: "ServerConfig", profile: "Profile", head: "FaceMesh | None", guard: "Watchdog") -> None:
    from fapengine.server.intake.rates import collecting_in_pieces
    from fapengine.server.server import Server
    from fapengine.server.server import serve as serve_until_stopped

    server = Server(config, profile, head)
    server.hub.listeners.on_frames(lambda frames: guard.tell(frames.sessions))
    stop_on_signals(server.stop)
    with collecting_in_pieces():
        await serve_until_stopped(server, lambda: _announce(server))


async def _run_workers(config: "ServerConfig") -> None:
    from fapengine.server.cluster.workers import Workers
    from fapengine.server.server import serve as serve_until_stopped

    workers = Workers(config)
    stop_on_signals(workers.stop)
    await serve_until_stopped(workers, lambda: _announce(workers))


def _announce(server: "Server | Workers") -> None:
    """Print all addresses, or log them as JSON."""
    import logging
    from urllib.parse import quote

    from fapengine.server.server import Server

    config = server.config
    host, port = server.osc_address
    sites = list(server.sites)
    lines = [("OSC in", f"{spelled(host, port)} (UDP and TCP)")]
    if config.listen.web_port is not None:
        query = f"?token={quote(config.listen.token, safe='')}" if config.listen.token else ""
        site = spelled(*sites.pop(0))
        lines.append(("page", f"http://{site}/{query}"))
        if config.calls.on:
            lines.append(("calls", f"http://{site}/call.html{query} (WHEP: /whep, WHIP: /whip)"))
    lines += [("sink", sink) for sink in server.sink_names]
    if isinstance(server, Server):
        lines += _sound_lines(server)
    else:
        if config.bus.url is not None:
            lines.append(("bus", f"{config.bus.name}: {server.bus.machines if server.bus else 0} machines"))
        lines.append(("workers", " ".join(f"{number}:{process}" for number, process in server.processes.items())))
    if config.listen.metrics_port is not None:
        lines.append(("metrics", f"http://{spelled(*sites.pop(0))}/metrics"))
    log = logging.getLogger("fapengine.server")
    if config.log.format == "json":
        log.info("ready", extra={"listens": [{"what": what, "where": where} for what, where in lines]})
    else:
        for what, where in lines:
            typer.echo(f"{what:<8} {where}")
        typer.echo("Ctrl-C stops.")
    if isinstance(server, Server) and server.speaker is not None and server.speaker.is_silent:
        log.warning("no sound; the face follows the system clock: %s", server.speaker.description)
    if config.listen.host not in ("127.0.0.1", "::1", "localhost") and not config.listen.token:
        log.warning("no token is set: anyone on the network can connect")


def _sound_lines(server: "Server") -> list[tuple[str, str]]:
    lines = []
    if server.speaker is not None:
        lines.append(("sound", f"{server.speaker.session}: {server.speaker.description}"))
    if server.microphone is not None:
        lines.append(("listens", f"{server.config.sound.listens}: {server.microphone.description}"))
    return lines


def spelled(host: str, port: int) -> str:
    """Return an address as in a URL."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
