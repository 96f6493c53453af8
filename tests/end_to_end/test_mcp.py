"""``fapengine mcp`` as a coding agent uses it: the official library's client starts it, and talks over its pipes."""

import asyncio
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mcp.client import Client

Call = Callable[..., Awaitable[tuple[bool, Any]]]


def talk(folder: Path, conversation: Callable[["Client", Call], Awaitable[None]]) -> None:
    from mcp.client import Client  # slow, and every process of tests reads this file
    from mcp.client.stdio import StdioServerParameters

    command = StdioServerParameters(command=sys.executable, args=["-m", "fapengine", "mcp", "--folder", str(folder)])

    async def run() -> None:
        async with Client(command) as client:

            async def call(name: str, **arguments: Any) -> tuple[bool, Any]:
                answer = await client.call_tool(name, arguments)
                text = "".join(getattr(each, "text", "") for each in answer.content)
                return bool(answer.is_error), text if answer.is_error else answer.structured_content

            await conversation(client, call)

    asyncio.run(run())


def test_tools_write_files_and_errors_say_what_to_change(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "mam.pho").write_text("m 80\na 120\nm 80\n_ 100\n")

    async def conversation(client: "Client", call: Call) -> None:
        tools = {tool.name: tool for tool in (await client.list_tools()).tools}
        assert set(tools) == {"say", "animate", "convert", "score", "inspect"}
        assert all(len(tool.description or "") > 60 for tool in tools.values())
        assert set(tools["say"].input_schema["required"]) == {"text", "output"}
        failed, said = await call("say", text="--help me, [smile] mama.", output="a.fap", expression="joy:0.4")
        assert not failed, said
        assert (folder / "a.fap").stat().st_size > 500
        failed, answer = await call("animate", source="mam.pho", output="mam.fap")
        assert not failed, answer
        failed, answer = await call("convert", motion="mam.fap", output="mam.csv")
        assert not failed, answer
        assert (folder / "mam.csv").read_text().startswith("Time,EyeBlinkLeft")
        failed, answer = await call("say", text="Hallo 你.", output="hallo.fap", voice="de")
        assert "does not read Han" in answer["remarks"][0], answer
        failed, answer = await call("animate", source="hallo.wav", output="b.fap", transcript="Hallo", language="xx")
        assert failed
        assert "got 'xx', expected a language code" in answer
        failed, judged = await call("score", made="mam.csv", phones="mam.pho")
        assert not failed, judged
        assert "closures" in str(judged)
        failed, described = await call("inspect", path="mam.fap")
        assert not failed
        assert described["frames"] > 5, described
        for name, arguments, message in (
            ("animate", {"source": "mam.pho", "output": "mam.fap"}, "mam.fap"),
            ("convert", {"motion": "mam.fap", "output": "b.doc"}, "expected a name that ends with .fap"),
            ("convert", {"motion": "../secret.fap", "output": "b.csv"}, "expected a file inside"),
            ("convert", {"motion": "mam.fap", "output": "/b.csv"}, "expected a file inside"),
            ("say", {"text": "a", "output": "b.fap", "head": "../head.glb"}, "expected a file inside"),
            ("say", {"text": "a", "output": "b.fap", "voice": "my_module:Voice"}, "expected a language code"),
            ("say", {"text": "a"}, "output"),
            ("say", {"text": "a", "output": "frame_%04d.png"}, "expected numbered files in a folder"),
            ("say", {"text": "a", "output": "."}, "expected a file inside"),
            ("say", {"text": "a", "output": ""}, "expected the name of a file"),
            ("say", {"text": "a", "output": "a\0.fap"}, "expected the name of a file"),
            ("inspect", {"path": ""}, "expected the name of a file"),
            ("animate", {"source": "mam.pho", "output": "b.fap", "transcript": "a\0b"}, "cannot be started"),
            ("say", {"text": "\n" * 200_000, "output": "b.fap"}, "nothing to speak"),
        ):
            failed, answer = await call(name, **arguments)
            assert failed, (name, arguments)
            assert message in answer, answer

    talk(folder, conversation)
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_a_missing_library_is_told_with_its_extra(tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['mcp'] = None; sys.argv = ['fapengine', 'mcp']; from fapengine.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 3
    assert 'pip install "fapengine[mcp]"' in done.stderr
