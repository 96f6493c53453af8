"""``fapengine agent``: a voice agent with a face, on a web page."""

from typing import TYPE_CHECKING, Annotated

import typer

from fapengine import speaking
from fapengine.cli import options as shared

if TYPE_CHECKING:
    from fapengine.agents.bot import BotOptions
    from fapengine.server.web.access import Access


def agent(
    llm: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Base URL of a language model with OpenAI's protocol (Ollama, llama.cpp, vLLM, OpenAI). Without it the"
            " agent repeats what you say.",
        ),
    ] = None,
    llm_model: Annotated[str | None, typer.Option(help="Its model. Default: the first that the server lists.")] = None,
    llm_key: Annotated[str | None, typer.Option(envvar="FAPENGINE_LLM_KEY", help="Its key.")] = None,
    system: Annotated[str | None, typer.Option(help="Instructions for the language model.")] = None,
    stt: Annotated[
        str | None,
        typer.Option(
            metavar="URL|MODULE:NAME",
            help="Speech recognizer: the base URL of one with OpenAI's protocol (whisper.cpp, Speaches), or a Python"
            " class or function that returns a recognizer of Pipecat. Default: PocketSphinx (US English, many errors).",
        ),
    ] = None,
    stt_model: Annotated[str | None, typer.Option(help="Its model. Default: the first that the server lists.")] = None,
    stt_key: Annotated[str | None, typer.Option(envvar="FAPENGINE_STT_KEY", help="Its key.")] = None,
    voice: speaking.Voice = speaking.DEFAULT_VOICE,
    wpm: speaking.Rate = speaking.DEFAULT_RATE_WPM,
    head: shared.HeadName = "woman",
    size: shared.Size = "512x512",
    host: Annotated[
        str, typer.Option(help="Address to listen on. Use 0.0.0.0 for all interfaces, and set --token.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", "-p", min=0, max=65535, help="Port of the page. 0 picks a free port.")
    ] = 7860,
    token: Annotated[
        str | None, typer.Option(envvar="FAPENGINE_TOKEN", help="Secret that browsers must present.")
    ] = None,
    origin: Annotated[
        list[str],
        typer.Option(
            metavar="URL", help="Site whose pages may talk to the agent, such as https://example.org. Repeatable."
        ),
    ] = [],  # noqa: B006  typer copies it
    verbose: Annotated[bool, typer.Option("--verbose", help="Show the log of Pipecat.")] = False,
) -> None:
    """Talk with a face in the browser: microphone, speech recognizer, language model, voice and face in one command.

        fapengine agent
        fapengine agent --llm http://127.0.0.1:11434/v1 --llm-model llama3.2
        fapengine agent --llm http://127.0.0.1:11434/v1 --voice en-gb --head man
        fapengine agent --stt http://127.0.0.1:8000/v1

    Open the printed address, allow the microphone, and speak or type. You can interrupt the agent at any time. Browsers
    give a microphone only to https and to this machine.

    Keys are read from FAPENGINE_LLM_KEY and FAPENGINE_STT_KEY. Each visitor has a conversation of its own, at most four
    at once. Pages of your own can talk to it with Pipecat's JavaScript client: SmallWebRTCTransport at /api/offer, and
    --origin for a page of another site.

    Requires the extras pipecat, voice and recognizer.
    """
    import asyncio

    from fapengine._late import require
    from fapengine.agents.endpoints import Endpoint
    from fapengine.agents.face import AgentOptions
    from fapengine.errors import UsageError
    from fapengine.render.drawing import parse_size
    from fapengine.server.config import Listen
    from fapengine.voices.choice import VoiceChoice

    for name, needs in (("llm", {"llm_model": llm_model, "system": system}), ("stt", {"stt_model": stt_model})):
        unused = next((option for option, value in needs.items() if value is not None), None)
        if unused is not None and not {"llm": llm, "stt": stt}[name]:
            raise UsageError(f"{unused}: requires --{name} URL")
    model = Endpoint("llm", llm, llm_model, llm_key) if llm is not None else None
    hears = Endpoint("stt", stt, stt_model, stt_key) if stt is not None and "://" in stt else stt
    listen = Listen(host, token=token, origins=tuple(origin))
    face = AgentOptions(head=head, size=parse_size(size), voice=voice)
    choice = VoiceChoice(voice, wpm)
    require("agent", pipecat="pipecat-ai", aiortc="aiortc", cv2="pipecat-ai", aiohttp="aiohttp")
    if stt is None:
        require("agent without --stt", pocketsphinx="PocketSphinx")
    choice.load()
    _quiet(verbose)

    from fapengine.agents.bot import SYSTEM, BotOptions, recognizer_named
    from fapengine.server.web.access import Access

    if isinstance(hears, str):
        recognizer_named(hears)

    async def checked() -> BotOptions:
        return BotOptions(
            face=face,
            voice=choice,
            llm=await model.checked() if model is not None else None,
            system=system or SYSTEM,
            stt=await hears.checked() if isinstance(hears, Endpoint) else hears,
        )

    asyncio.run(_run(asyncio.run(checked()), Access(listen.token, listen.origins), host, port))


def _quiet(verbose: bool) -> None:
    """Show errors of Pipecat only; before it is imported, because it greets."""
    import sys

    from loguru import logger  # type: ignore[import-not-found, unused-ignore]

    logger.remove()
    logger.add(sys.stderr, level="DEBUG" if verbose else "ERROR")


async def _run(options: "BotOptions", access: "Access", host: str, port: int) -> None:
    import asyncio
    from urllib.parse import quote

    from fapengine.agents import prewarm
    from fapengine.agents.bot import Bot
    from fapengine.agents.warm import close_warm
    from fapengine.agents.web import application
    from fapengine.cli.serve import spelled, stop_on_signals
    from fapengine.server.intake.doors import Door
    from fapengine.server.web.site import open_site

    bot, stopped = Bot(options), asyncio.Event()
    site = await open_site(application(bot, access), host, port, Door.shared(256))
    try:
        stop_on_signals(stopped.set)
        await bot.start()
        prewarm(1, head=options.face.head, size=options.face.size, voice=options.face.voice)
        query = f"?token={quote(access.token, safe='')}" if access.token else ""
        typer.echo(f"{'page':<8} http://{spelled(*site.address)}/{query}")
        typer.echo("Ctrl-C stops.")
        await stopped.wait()
    finally:
        await bot.close()
        await site.close()
        close_warm()
