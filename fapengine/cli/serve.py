"""``fapengine serve``: faces in real time, for senders of phones and for whoever shows them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli import options as shared

if TYPE_CHECKING:
    from fapengine.live.server.config import ServeConfig
    from fapengine.live.server.server import Server
    from fapengine.live.server.watchdog import Watchdog
    from fapengine.live.server.workers import Workers
    from fapengine.mesh.face_mesh import FaceMesh
    from fapengine.profiles import Profile


def serve(
    config: Annotated[
        Path | None, typer.Option("--config", "-c", help="A TOML file with all of this and more; options go before it.")
    ] = None,
    host: Annotated[
        str | None, typer.Option("--host", help="Where to listen; 0.0.0.0 lets the network in. [default: 127.0.0.1]")
    ] = None,
    port: Annotated[
        int | None, typer.Option("--port", "-p", min=0, max=65535, help="OSC in, UDP and TCP. [default: 9110]")
    ] = None,
    web_port: Annotated[
        int | None,
        typer.Option("--web-port", "-w", min=0, max=65535, help="The page; 0: any free port. [default: 8110]"),
    ] = None,
    no_page: Annotated[bool, typer.Option("--no-page", help="Serve no page.")] = False,
    sink: Annotated[
        list[str],
        typer.Option(
            "--sink",
            "-s",
            help="Send frames on, as KIND://HOST:PORT: osc, named, vmc, vrchat, livelink, fba (UDP), fba+tcp or rtp;"
            " or as video: camera://, rtmp://HOST/PATH, srt://HOST:PORT. May be given again.",
        ),
    ] = [],  # noqa: B006  typer copies it
    sound: Annotated[
        str | None,
        typer.Option(
            "--sound",
            help="Play what this session's voice says through this machine's loudspeaker, and let its face follow;"
            " 'face' is the session of one-line senders and of the page.",
        ),
    ] = None,
    device: shared.Device = None,
    listen_audio: Annotated[
        str | None,
        typer.Option(
            "--listen-audio",
            metavar="DEVICE",
            help="Let a microphone of this machine move the session 'face': default, a number or a part of its name.",
        ),
    ] = None,
    ear: Annotated[
        str | None,
        typer.Option("--ear", metavar="EAR", help="What hears all sound that comes in, as of animate."),
    ] = None,
    webrtc: Annotated[
        bool,
        typer.Option(
            "--webrtc",
            help="Take calls at the page's port: WHEP shows a face as video and sound, WHIP lets sound move it, and"
            " /call.html does both.",
        ),
    ] = False,
    token: Annotated[
        str | None,
        typer.Option("--token", envvar="FAPENGINE_TOKEN", help="What senders and pages must know to be let in."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            min=1,
            max=256,
            help="Processes that show faces: one for each core. One more gives them their sessions. [default: 1]",
        ),
    ] = None,
    bus: Annotated[
        str | None,
        typer.Option(
            "--bus",
            metavar="nats://HOST:PORT",
            help="Share the sessions with all machines that are given the same NATS server.",
        ),
    ] = None,
    metrics: Annotated[
        int | None,
        typer.Option("--metrics", min=0, max=65535, help="Prometheus text at this port, /metrics; 0: any free one."),
    ] = None,
    log: Annotated[str | None, typer.Option("--log", help="text, or json: an object a line. [default: text]")] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log every utterance.")] = False,
    profile: Annotated[
        str | None, typer.Option("--profile", help="Whose way of speaking: a shipped name or a folder.")
    ] = None,
    head: Annotated[
        str | None, typer.Option("--head", help="Whose face the page shows: default, or an imported head's folder.")
    ] = None,
    fps: Annotated[float | None, typer.Option("--fps", help="Frames a second. [default: 60]")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Chance of blinks, glances and head motion.")] = None,
    without: shared.Without = [],  # noqa: B006
) -> None:
    """Run the live engine: phones in over OSC, faces out, and a page that shows one.

        fapengine serve
        fapengine serve --sink vmc://127.0.0.1:39539 --sink osc://127.0.0.1:9100
        fapengine serve --workers 8

    A sender of one line is enough (python-osc, Pure Data, anything that speaks OSC to port 9110):

        /phoneme s "m"      /phoneme s "a" f 0.2      /viseme s "O"
        /tts/text s "Hello there."      /tts/stop

    The robust way, with repeats, acknowledgements and clocks: fapengine.live.clients.sender; docs/osc.md tells of both.
    A face goes on to other programs through sinks.

    One process shows faces on one core; --workers 8 has eight behind the same ports. If one dies, others speak on.
    With --bus nats://HOST:4222 so do machines.

    Ctrl-C or SIGTERM: the faces come to rest, then the server ends.
    """
    from dataclasses import replace

    from fapengine.errors import UsageError
    from fapengine.live.server.config import ServeConfig, load_config, overridden
    from fapengine.live.server.sink_address import parse_sink

    for url in sink:
        parse_sink(url)
    own = load_config(config) if config else ServeConfig()
    listen = overridden(
        own.listen, host=host, port=port, web_port=web_port, metrics_port=metrics, token=token, workers=workers
    )
    speaker = overridden(own.sound, session=sound, device=device, microphone=listen_audio, ear=ear)
    if speaker.device and not speaker.session:
        raise UsageError(f"--device: got {speaker.device!r}, expected --sound SESSION with it")
    calls = overridden(own.calls, on=True if webrtc else None)
    if calls.on and (no_page or listen.web_port is None):
        raise UsageError("--webrtc: got no page's port to call at, expected a --web-port with it")
    chosen = ServeConfig(
        listen=replace(listen, web_port=None) if no_page else listen,
        face=overridden(own.face, profile=profile, head=head, rate_hz=fps, seed=seed),
        style=own.style.without(without),
        voice=own.voice,
        sound=speaker,
        calls=calls,
        limits=own.limits,
        bus=overridden(own.bus, url=bus),
        log=overridden(own.log, format=log, level="debug" if verbose else None),
        sinks=(*own.sinks, *sink),
    )
    _start(chosen)


def _start(config: "ServeConfig") -> None:
    import asyncio

    from fapengine.files.heads.load import load_head
    from fapengine.files.profiles import load_profile
    from fapengine.live.server.logs import begin_log
    from fapengine.live.server.watchdog import start_watchdog

    _need_extra()
    if config.calls.on:
        from fapengine.live.calls.calls import need_aiortc

        need_aiortc()
    begin_log(config.log.level, config.log.format)
    face = load_head(config.face.head) if config.listen.web_port is not None else None
    profile = load_profile(config.face.profile)
    if config.has_parent:  # workers load head and profile themselves: here it is seen that they can
        asyncio.run(_run_workers(config))
        return
    with start_watchdog(config.sinks, config.face.rate_hz) as watchdog:
        asyncio.run(_run(config, profile, face, watchdog))


def _need_extra() -> None:
    """Refuse at once what would fail in the middle: the server's libraries are an extra."""
    from importlib import import_module

    from fapengine.errors import ResourceError

    for name in ("aiohttp", "prometheus_client"):
        try:
            import_module(name)
        except ImportError as error:
            raise ResourceError(
                f'serve: {name} is not installed; mend it with: pip install "fapengine[live]"'
            ) from error


async def _run(config: "ServeConfig", profile: "Profile", head: "FaceMesh | None", guard: "Watchdog") -> None:
    import asyncio
    import signal

    from fapengine.live.server.collecting import collect_now_and_then
    from fapengine.live.server.server import Server
    from fapengine.live.server.server import serve as serve_until_stopped

    server = Server(config, profile, head)
    server.hub.listeners.on_frames(lambda frames: guard.tell(frames.sessions))
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        try:
            loop.add_signal_handler(number, server.stop)
        except NotImplementedError:  # Windows
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(server.stop))
    collecting = asyncio.create_task(collect_now_and_then())
    try:
        await serve_until_stopped(server, lambda: _announce(server))
    finally:
        collecting.cancel()


async def _run_workers(config: "ServeConfig") -> None:
    import asyncio
    import signal

    from fapengine.live.server.workers import Workers, serve_with_workers

    workers = Workers(config)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, workers.stop)
    await serve_with_workers(workers, lambda: _announce(workers))


def _announce(server: "Server | Workers") -> None:
    """Say where everything is: for people on standard output, for programs in the log."""
    import logging
    from urllib.parse import quote

    from fapengine.live.server.server import Server

    config = server.config
    host, port = server.osc_address
    sites = list(server.sites)
    lines = [("OSC in", f"{_spelled(host, port)} (UDP and TCP)")]
    if config.listen.web_port is not None:
        query = f"?token={quote(config.listen.token, safe='')}" if config.listen.token else ""
        site = _spelled(*sites.pop(0))
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
        lines.append(("metrics", f"http://{_spelled(*sites.pop(0))}/metrics"))
    log = logging.getLogger("fapengine.server")
    if config.log.format == "json":
        log.info("ready", extra={"listens": [{"what": what, "where": where} for what, where in lines]})
    else:
        for what, where in lines:
            typer.echo(f"{what:<8} {where}")
        typer.echo("Ctrl-C stops.")
    if isinstance(server, Server) and server.speaker is not None and server.speaker.is_silent:
        log.warning("no sound; the face keeps time by the clock: %s", server.speaker.description)
    if config.listen.host not in ("127.0.0.1", "::1", "localhost") and not config.listen.token:
        log.warning("everybody in the network may speak here: set a token")


def _sound_lines(server: "Server") -> list[tuple[str, str]]:
    lines = []
    if server.speaker is not None:
        lines.append(("sound", f"{server.speaker.session}: {server.speaker.description}"))
    if server.microphone is not None:
        lines.append(("listens", f"{server.config.sound.listens}: {server.microphone.description}"))
    return lines


def _spelled(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
