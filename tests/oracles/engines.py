"""The receivers of ``examples/receivers`` in what runs here of their engines.

Godot 3 is the engine itself (Debian's ``godot3-server``). Unity's script is compiled by Mono, Unreal's by a C++
compiler, each with a stand-in for as much of the engine as it uses: that shows what the code does, not that an engine
takes it.
"""

import asyncio
import os
import shutil
import socket
import subprocess
from pathlib import Path

import numpy as np

from fapengine.live.server.config import Listen, ServeConfig
from fapengine.live.server.server import Server
from fapengine.trajectory.style import Style
from tests.english import english

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
    """Run a receiver while a server speaks, ends and is there again: its jaw opens and shuts."""
    jaws = asyncio.run(_run(command))
    opened = np.flatnonzero(np.array(jaws) > MIN_OPEN)
    assert len(opened) > 5, f"{name}: the mouth never opened: {len(jaws)} frames"
    assert jaws[-1] < 0.02, f"{name}: the mouth is open at the end: {jaws[-1]}"
    print(f"{name}: {len(jaws)} frames, jawOpen up to {max(jaws):.2f}, shut at the end")


async def _run(command: list[str]) -> list[float]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"ws://127.0.0.1:{port}/"
    listen = Listen(port=0, web_port=None)
    server = Server(ServeConfig(listen=listen, sinks=(f"ws-json://127.0.0.1:{port}",), style=Style.still()), english())
    await server.start()
    running = asyncio.create_task(server.run())
    release = server.hub.hold("face")
    process = await asyncio.create_subprocess_exec(
        *(address if word == "ADDRESS" else word for word in command),
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, env={**os.environ, "FACE_ADDRESS": address},
    )  # fmt: skip
    reading = asyncio.ensure_future(process.communicate())
    await asyncio.sleep(2.0)
    await server.hub.speak("face", "My mama bought a big pumpkin, and Bob made plum jam.")
    await asyncio.sleep(3.0)
    release()
    server.stop()  # in the middle of the text
    await running
    try:
        out, complaints = await asyncio.wait_for(asyncio.shield(reading), 60)
    except TimeoutError:
        process.kill()
        out, complaints = await reading
    lines = out.decode(errors="replace").splitlines()
    assert process.returncode == 0, complaints.decode(errors="replace")
    return [float(line.split()[1]) for line in lines if line.startswith("jaw ")]
