"""``fapengine mcp``: the commands as tools of a coding agent (Model Context Protocol)."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fapengine import speaking
from fapengine._late import Late

if TYPE_CHECKING:
    from mcp.server import mcpserver
    from mcp.server.mcpserver import exceptions as mcp_exceptions
else:
    mcpserver = Late("mcp.server.mcpserver", "mcp", "fapengine mcp")
    mcp_exceptions = Late("mcp.server.mcpserver.exceptions", "mcp", "fapengine mcp")

INSTRUCTIONS = """Talking faces (MPEG-4 facial animation) from text, recordings or phone timings.

Results are files in one folder; the endings say what is written: .mp4 .webm .gif video, .png one image, .fap face
motion, .csv weights of 52 ARKit blendshapes, .glb .vrm an animated avatar, .wav sound. Existing files are kept unless
overwrite is true. Typical: say(text, "hello.mp4"); or say(text, "hello.fap"), then convert("hello.fap", "hello.csv")
for a game engine; score("hello.csv", phones="talk.TextGrid") judges the lip sync of any tool."""


def mcp(
    folder: Annotated[
        Path, typer.Option(exists=True, file_okay=False, help="Folder of all files that the agent may read and write.")
    ] = Path(),
    voice: speaking.Voice = speaking.DEFAULT_VOICE,
) -> None:
    """Serve the commands to a coding agent by the Model Context Protocol, on standard input and output.

        fapengine mcp --folder out
        claude mcp add fapengine -- fapengine mcp --folder "$PWD"

    In a configuration: {"mcpServers": {"fapengine": {"command": "fapengine", "args": ["mcp", "--folder", "out"]}}}

    Tools: say, animate, convert, score, inspect. Each runs the command of that name and returns what it prints with
    --json; an error is its message. Files outside the folder are refused.

    Requires the extra mcp.
    """
    make_server(folder.resolve(), voice).run("stdio")


class _Tools:
    """The tools; their names, parameters and docstrings are what an agent reads."""

    def __init__(self, folder: Path, voice: str) -> None:
        self._folder = folder
        self._voice = voice

    async def say(
        self,
        text: str,
        output: str,
        voice: str = "",
        expression: str = "",
        head: str = "default",
        size: str = "",
        overwrite: bool = False,
    ) -> dict[str, Any]:
        """Say a text with a synthetic voice and a talking face, and write the file that the output's ending names.

        Marks in the text move the face: [smile], [laughs], emoji. Next to a video: its sound (.wav), FAPs (.fap) and a
        contact sheet (.png).

        voice: language code such as en-gb, de, fr; empty: the server's. expression: NAME:STRENGTH, such as joy:0.4
        (joy, sadness, anger, fear, disgust, surprise). head: default, woman, man, or a head's file. size: such as
        512x512.
        """
        if ":" in voice or "/" in voice:
            raise mcp_exceptions.ToolError(f"voice: got {voice!r}, expected a language code such as en-gb")
        return await self._run(
            "say", ["-"], output, overwrite, said=text, voice=voice or self._voice, expression=expression,
            head=self._head(head), size=size,
        )  # fmt: skip

    async def animate(
        self,
        source: str,
        output: str,
        audio: str = "",
        transcript: str = "",
        language: str = "",
        head: str = "default",
        size: str = "",
        overwrite: bool = False,
    ) -> dict[str, Any]:
        """Animate a recording (its phones are recognized), or phone timings of any of 58 formats.

        audio: sound of timings, for a video. transcript: what a recording says, for better lips; language: its language
        if it is not English, such as de.
        """
        return await self._run(
            "animate", [self._inside(source)], output, overwrite, audio=self._inside(audio), transcript=transcript,
            language=language, head=self._head(head), size=size,
        )  # fmt: skip

    async def convert(
        self, motion: str, output: str, shapes: str = "", into: str = "", overwrite: bool = False
    ) -> dict[str, Any]:
        """Convert face motion (.fap, .fba, .csv of weights, .json): to weights, visemes, a video, or an avatar.

        shapes: arkit (default), oculus, vrm0, vrm1; with times mpeg4, azure, rhubarb. into: avatar (.glb, .vrm) that
        gets the motion as an animation, for output .glb or .vrm.
        """
        return await self._run(
            "convert", [self._inside(motion)], output, overwrite, shapes=shapes, into=self._head(into)
        )

    async def score(
        self,
        made: str,
        phones: str = "",
        audio: str = "",
        transcript: str = "",
        language: str = "",
        reference: str = "",
    ) -> dict[str, Any]:
        """Judge any lip sync (.fap, .csv, .json, .glb, .vrma, a video): closures of p b m, teeth of f v, delay.

        One of phones (timings), audio, or reference (captured motion of the same speech) is needed. language: that of
        the transcript, if it is not English.
        """
        return await self._run(
            "score", [self._inside(made)], None, True, phones=self._inside(phones), audio=self._inside(audio),
            transcript=transcript, language=language, reference=self._inside(reference),
        )  # fmt: skip

    async def inspect(self, path: str) -> dict[str, Any]:
        """Describe a file: FAPs, streams, weights, phone timings, sound, video, captured markers, avatars, heads."""
        return await self._run("inspect", [self._inside(path)], None, True)

    def _head(self, name: str) -> str:
        """Name of a head; files are inside the folder."""
        is_file = "/" in name or "\\" in name or "." in name
        return self._inside(name) if is_file else name

    def _inside(self, name: str) -> str:
        """Path of a file, absolute; empty for none. Raises ToolError if it is not inside the folder."""
        if not name:
            return ""
        try:
            path = (self._folder / name).resolve()
        except (OSError, ValueError) as error:  # too long; a NUL
            raise mcp_exceptions.ToolError(f"got {name[:60]!r}, expected the name of a file ({error})") from error
        if not path.is_relative_to(self._folder) or path == self._folder:
            raise mcp_exceptions.ToolError(f"got {name!r}, expected a file inside {self._folder}")
        return str(path)

    def _written(self, name: str) -> str:
        """Path of an output; its other files are inside the folder, too. Raises ToolError if they are not."""
        from fapengine.files.moving import is_sequence  # imports numpy, and --help imports this module

        path = self._inside(name)
        if not path:
            raise mcp_exceptions.ToolError("output: got '', expected the name of a file")
        if is_sequence(Path(path)) and Path(path).parent == self._folder:  # the others are named after its folder
            raise mcp_exceptions.ToolError(
                f"output: got {name!r}, expected numbered files in a folder: pictures/{name}"
            )
        return path

    async def _run(
        self, command: str, arguments: list[str], output: str | None, overwrite: bool, *, said: str = "", **options: str
    ) -> dict[str, Any]:
        """Run a command, and return its result. Raises ToolError with its message if it fails.

        ``said`` is its standard input; ``output`` is None for a command that writes nothing.
        """
        import asyncio  # --help imports this module

        words = [sys.executable, "-m", "fapengine", command, "--json"]
        if not all(arguments):
            raise mcp_exceptions.ToolError(f"{command}: got '', expected the name of a file")
        if output is not None:
            options["output"] = self._written(output)
        words += [f"--{name}={value}" for name, value in options.items() if value]
        words += [] if overwrite else ["--no-overwrite"]
        try:
            child = await asyncio.create_subprocess_exec(
                *words, "--", *arguments, cwd=self._folder, stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
            )  # fmt: skip
        except (OSError, ValueError) as error:  # too long a transcript; a NUL in one
            raise mcp_exceptions.ToolError(f"{command}: cannot be started ({error})") from error
        try:
            out, errors = await child.communicate(said.encode())
        finally:
            if child.returncode is None:  # the agent gave up
                child.terminate()
        if child.returncode:
            raise mcp_exceptions.ToolError(errors.decode().strip() or f"{command}: ended with code {child.returncode}")
        result: dict[str, Any] = json.loads(out)
        result["remarks"] = list(dict.fromkeys([*result.get("remarks", []), *errors.decode().splitlines()]))
        return result


def make_server(folder: Path, voice: str = speaking.DEFAULT_VOICE) -> "mcpserver.MCPServer[Any]":
    """Return a server whose files are in a folder. Raises ResourceError if the package mcp is not installed."""
    server: mcpserver.MCPServer[Any] = mcpserver.MCPServer("fapengine", instructions=INSTRUCTIONS)
    tools = _Tools(folder, voice)
    for tool in (tools.say, tools.animate, tools.convert, tools.score, tools.inspect):
        server.add_tool(tool)
    return server
