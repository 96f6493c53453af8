"""The receivers of ``examples/receivers`` in what runs here of their engines.

Godot 3 is the engine itself (Debian's ``godot3-server``). Unity's script is compiled by Mono, Unreal's by a C++
compiler, each with a stand-in for as much of the engine as it uses: that shows what the code does, not that an engine
takes it.
"""

import asyncio
import os
import shutil
import subprocess
from pathlib import Path

from fapengine.server.config import Listen, ServerConfig
from fapengine.server.server import Server
from fapengine.trajectory.style import Style
from tests.english import english
from tests.processes import free_port

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "receivers"
DOUBLES = Path(__file__).resolve().parent / "receivers"
UNREAL_HEADERS = (
    "CoreMinimal", "Components/ActorComponent", "Components/SkeletalMeshComponent", "Dom/JsonObject", "IWebSocket",
    "FapengineFace.generated", "Animation/MorphTarget", "Engine/SkeletalMesh", "GameFramework/Actor",
    "Modules/ModuleManager", "Serialization/JsonReader", "Serialization/JsonSerializer", "WebSocketsModule",
)  # fmt: skip
FRAME = (
    '{"t": 1, "session": "face", "arkit": {"jawOpen": %s, "eyeBlinkLeft": 0.5}, "visemes": {"sil": 0.2},'
    ' "head": [1.5, -4.0, 0.0]}'
)
LIMIT_S = 90.0
MIN_OPEN = 0.1
"""Least weight of jawOpen that the text has."""


def check_receivers(root: Path) -> None:
    """Fail if one does not open and shut the mouth; what is not installed is said."""
    folder = root / "receivers"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    _unreal(folder)
    if shutil.which("godot3-server"):
        (folder / "project.godot").write_text("config_version=4\n")
        shutil.copy(EXAMPLES / "fapengine_face_godot3.gd", folder)
        shutil.copy(DOUBLES / "godot3.gd", folder)
        _told("Godot 3", ["godot3-server", "--path", str(folder), "-s", "res://godot3.gd"])
    else:
        print("godot3-server: not on this machine; Debian has it")
    if shutil.which("mcs") and shutil.which("mono"):
        sources = [str(EXAMPLES / "FapengineFace.cs"), str(DOUBLES / "UnityDouble.cs")]
        subprocess.run(["mcs", "-warn:0", f"-out:{folder}/unity.exe", *sources], check=True)
        _told("Unity's script by Mono", ["mono", f"{folder}/unity.exe", "ADDRESS"])
    else:
        print("Mono: not on this machine; Debian has it as mono-mcs and mono-runtime")


def _unreal(folder: Path) -> None:
    for name in UNREAL_HEADERS:
        header = folder / f"{name}.h"
        header.parent.mkdir(parents=True, exist_ok=True)
        header.write_text('#include "unreal_double.h"\n')
    sources = [str(EXAMPLES / "FapengineFace.cpp"), str(DOUBLES / "unreal_main.cpp")]
    paths = [f"-I{folder}", f"-I{DOUBLES}", f"-I{EXAMPLES}"]
    subprocess.run(["c++", "-std=c++17", *paths, *sources, "-o", str(folder / "unreal")], check=True)
    given = "\n".join([FRAME % 0.31, "nonsense", FRAME % 0.62]) + "\n"
    done = subprocess.run([str(folder / "unreal")], input=given, capture_output=True, text=True, check=True)
    told = [[float(word) for word in line.split()] for line in done.stdout.splitlines()]
    assert told == [[0.31, 0.5, 4], [0.31, 0.5, 4], [0.62, 0.5, 4], [0, 0, 2]], told  # at last: at rest, asked again
    print("Unreal's code with a stand-in: opens, shuts when the server has gone, and asks again")


def _told(name: str, command: list[str]) -> None:
    """Run a receiver while a server speaks, and is gone in the middle of it: its jaw opens, and shuts."""
    jaws, is_shut = asyncio.run(_run(command))
    assert max(jaws, default=0.0) > MIN_OPEN, f"{name}: the mouth never opened: {len(jaws)} frames"
    assert is_shut, f"{name}: the mouth stays open: {jaws[-1]}"
    print(f"{name}: {len(jaws)} frames, jawOpen up to {max(jaws):.2f}, shut when the server had gone")


async def _run(command: list[str]) -> tuple[list[float], bool]:
    port = free_port()
    address = f"ws://127.0.0.1:{port}/"
    listen = Listen(port=0, web_port=None)
    server = Server(
        ServerConfig(listen=listen, sinks=(f"ws-json://127.0.0.1:{port}",), style=Style.speech_only()), english()
    )
    await server.start()
    running = asyncio.create_task(server.run())
    release = server.hub.hold("face")
    process = await asyncio.create_subprocess_exec(
        *(address if word == "ADDRESS" else word for word in command),
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL, env={**os.environ, "FACE_ADDRESS": address},
    )  # fmt: skip
    assert process.stdout is not None
    jaws: list[float] = []
    speaking = asyncio.create_task(_speak(server))
    is_gone = is_shut = False
    async with asyncio.timeout(LIMIT_S):
        while not is_shut and (line := await process.stdout.readline()):
            if not line.startswith(b"jaw "):
                continue
            jaws.append(float(line.split()[1]))
            is_shut = is_gone and jaws[-1] < 0.02
            if not is_gone and jaws[-1] > MIN_OPEN:
                speaking.cancel()
                release()
                server.stop()  # in the middle of the text
                await running
                is_gone = True
    process.kill()
    await process.wait()
    if not is_gone:
        speaking.cancel()
        server.stop()
        await running
    return jaws, is_shut


async def _speak(server: Server) -> None:
    while True:
        await server.hub.speak("face", "My mama bought a big pumpkin, and Bob made plum jam.")
        await asyncio.sleep(4.0)
