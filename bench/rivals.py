"""Other programs on the same sounds; ``bench.recognizers`` lists those that ``make oracles`` installed.

Rhubarb Lip Sync (MIT; its WebAssembly build 0.1.8 from npm, in Node) gives nine mouth shapes; HeadAudio (MIT; 0.1.0
from npm, its worklet's code in Node) gives one of 15 Oculus visemes every 16 ms. They become phones by our tables, and
lips by our planner, as for every recognizer. HeadAudio's visemes stand at the times that it states, so that what it
is late by in a page (a majority vote over the last ones, 100 ms of easing) does not count against it.
"""

import json
import subprocess
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from shutil import which

from fapengine.speech.formats.entries import Entry, track_of
from fapengine.speech.formats.registry import parse_timings
from fapengine.speech.phone_track import PhoneTrack
from tests.unit.recognition.speech import Spoken

HERE = Path(__file__).resolve().parent
ORACLES = HERE.parent / "out" / "oracles"
TIMEOUT_S = 120.0
HOP_S = 0.016
"""Time from one viseme of HeadAudio to the next."""


def rhubarb(speech: Spoken, *, with_text: bool) -> PhoneTrack:
    """Let Rhubarb hear a sentence, with its text or without."""
    said = _told("rival_rhubarb.cjs", speech, *([speech.text] if with_text else []))
    return parse_timings(said[said.index(b'{"mouthCues"') :], file_format="rhubarb-json")


def head_audio(speech: Spoken) -> PhoneTrack:
    """Let HeadAudio hear a sentence."""
    told = [(time_s - HOP_S / 2, label) for time_s, label in json.loads(_told("rival_headaudio.mjs", speech))]
    entries = []
    for label, run in groupby(told, key=lambda one: one[1]):
        starts_s = [start_s for start_s, _ in run]
        entries.append(Entry(max(starts_s[0], 0.0), starts_s[-1] + HOP_S, label, ""))
    spoken = [entry for entry in entries if entry.label != "sil"]
    return track_of(spoken, "HeadAudio", alphabet="oculus-visemes", level="viseme")


def _told(program: str, speech: Spoken, *arguments: str) -> bytes:
    return subprocess.run(
        ["node", str(HERE / program), str(ORACLES), *arguments],
        input=speech.samples.tobytes(), capture_output=True, timeout=TIMEOUT_S, check=True,
    ).stdout  # fmt: skip


def rivals() -> dict[str, Callable[[Spoken], PhoneTrack]]:
    """Names and recognizers of the rivals that are installed."""
    if which("node") is None:
        return {}
    recognizers: dict[str, Callable[[Spoken], PhoneTrack]] = {}
    if (ORACLES / "node_modules" / "rhubarb-lip-sync-wasm").is_dir():
        recognizers["Rhubarb, with the text"] = lambda speech: rhubarb(speech, with_text=True)
        recognizers["Rhubarb, sound alone"] = lambda speech: rhubarb(speech, with_text=False)
    if (ORACLES / "node_modules" / "@met4citizen" / "headaudio").is_dir():
        recognizers["HeadAudio, sound alone"] = head_audio
    return recognizers
