"""Other programs on the same sounds, as ears: ``bench.ears`` lists them where ``make oracles`` installed them.

Rhubarb Lip Sync (MIT; its WebAssembly build 0.1.8 from npm, in Node) gives nine mouth shapes; they become phones by our
reader of its files, and lips by our planner, as for every ear.
"""

import subprocess
from collections.abc import Callable
from pathlib import Path
from shutil import which

from fapengine.speech.formats.registry import parse_timings
from fapengine.speech.phone_track import PhoneTrack
from tests.unit.ears.speech import Spoken

HERE = Path(__file__).resolve().parent
ORACLES = HERE.parent / "out" / "oracles"
TIMEOUT_S = 120.0


def rhubarb(speech: Spoken, *, with_text: bool) -> PhoneTrack:
    """Let Rhubarb hear a sentence, with its text or without."""
    text = [speech.text] if with_text else []
    done = subprocess.run(
        ["node", str(HERE / "rival_rhubarb.cjs"), str(ORACLES), *text],
        input=speech.samples.tobytes(), capture_output=True, timeout=TIMEOUT_S, check=True,
    )  # fmt: skip
    start = done.stdout.index(b'{"mouthCues"')
    return parse_timings(done.stdout[start:], file_format="rhubarb-json")


def rivals() -> dict[str, Callable[[Spoken], PhoneTrack]]:
    """Names and ears of the rivals that are installed."""
    if which("node") is None or not (ORACLES / "node_modules" / "rhubarb-lip-sync-wasm").is_dir():
        return {}
    return {
        "Rhubarb, with the text": lambda speech: rhubarb(speech, with_text=True),
        "Rhubarb, sound alone": lambda speech: rhubarb(speech, with_text=False),
    }
