"""Pipecat's own JavaScript client, in a page of another site, talks to ``fapengine agent``.

``make oracles`` installs the client; Vite builds the page.
"""

import asyncio
import json
import subprocess
from pathlib import Path

import pytest

from tests.browser.bundlers import opened
from tests.browser.chromium import Browser, find_chromium
from tests.frameworks.check_agent import LIMIT_S, MEASURE, agent, microphone

MODULES = Path(__file__).resolve().parents[2] / "out" / "oracles" / "node_modules"
CLIENT = MODULES / "@pipecat-ai" / "client-js"
PAGE = """<!doctype html><html lang="en"><title>A page</title><link rel="icon" href="data:," />
<video id="face" autoplay playsinline muted></video><audio id="voice" autoplay></audio>
<script type="module" src="./main.js"></script></html>"""
MAIN = """import { PipecatClient } from "@pipecat-ai/client-js";
import { SmallWebRTCTransport, WavMediaManager } from "@pipecat-ai/small-webrtc-transport";

const told = (window.told = []);
const names = ["Connected", "BotReady", "UserStartedSpeaking", "UserStoppedSpeaking", "BotStartedSpeaking",
  "BotStoppedSpeaking", "BotLlmStarted", "BotTtsStarted", "BotOutput", "UserTranscript", "Error", "MessageError"];
const tell = (name) => (data) => told.push([name, data?.text ?? data?.data ?? null]);
const callbacks = Object.fromEntries(names.map((name) => [`on${name}`, tell(name)]));
callbacks.onTrackStarted = (track, participant) => {
  if (participant?.local) return;
  told.push(["Track", track.kind]);
  if (track.kind === "video") document.getElementById("face").srcObject = new MediaStream([track]);
  else document.getElementById("voice").srcObject = new MediaStream([track]);
};
const transport = new SmallWebRTCTransport({ mediaManager: new WavMediaManager() }); // the usual one loads a program
const endpoint = new URLSearchParams(location.search).get("agent");
window.client = new PipecatClient({ transport, enableMic: true, enableCam: false, callbacks });
window.client
  .connect({ webrtcRequestParams: { endpoint } })
  .then(() => told.push(["called", null]), (error) => told.push(["failed", String(error)]));
"""

pytestmark = pytest.mark.skipif(find_chromium() is None or not CLIENT.is_dir(), reason="no Chromium, or no client")
__all__ = ["microphone"]


def built() -> Path:
    """The page, beside the installed packages; returns its folder."""
    folder = MODULES.parent / "projects" / "rtvi"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "index.html").write_text(PAGE)
    (folder / "main.js").write_text(MAIN)
    (folder / "package.json").write_text(json.dumps({"name": "rtvi", "private": True, "type": "module"}))
    vite = MODULES / "vite" / "bin" / "vite.js"
    subprocess.run(
        ["node", str(vite), "build", "--base", "./", "--logLevel", "warn"], cwd=folder, check=True, timeout=300
    )
    return folder / "dist"


@pytest.mark.timeout(1200)
def test_pipecats_own_client_talks_to_the_agent(microphone: Path) -> None:
    async def talked() -> list[list[str | None]]:
        flags = "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"
        with opened(built()) as site:
            async with (
                agent("--origin", site.rstrip("/")) as url,
                Browser((500, 500), *flags, f"--use-file-for-fake-audio-capture={microphone}") as browser,
            ):
                await browser.open(f"{site}?agent={url}api/offer")
                await browser.until("window.told?.some(([name]) => name === 'BotReady')", LIMIT_S)
                await browser.until("document.getElementById('face').videoWidth === 256", LIMIT_S)
                await browser.run(MEASURE.replace("face.srcObject", "document.getElementById('voice').srcObject"))
                await browser.until("told.some(([name]) => name === 'called')", LIMIT_S)
                await browser.run("client.sendText('[smiles] plum jam')")
                await browser.until("window.loudest > 0.05", LIMIT_S)
                await browser.until("told.some(([name]) => name === 'BotStoppedSpeaking')", LIMIT_S)
                await browser.until(
                    "told.some(([name, text]) => name === 'BotOutput' && /weather/.test(text))", LIMIT_S
                )
                found: list[list[str | None]] = await browser.run("window.told")
                return found

    told = asyncio.run(talked())
    names = {name for name, _ in told}
    wanted = (
        "BotReady",
        "UserStartedSpeaking",
        "UserStoppedSpeaking",
        "UserTranscript",
        "BotStartedSpeaking",
        "BotTtsStarted",
    )
    assert names >= {"Connected", "called", *wanted}
    assert not names & {"failed", "Error", "MessageError"}, told
    said = [text or "" for name, text in told if name == "BotOutput"]
    assert "plum jam" in said
    assert not any("[" in text for text in said)  # marks are for the face
    print(f"Pipecat's JavaScript client: {len(told)} events of {len(names)} kinds")
