"""Random command lines: every verb ends by itself, in a line of words, and leaves what it was given as it was.

    python -m tests.fuzz.verbs [--seconds 600] [--count 1000] [--seed 1] [--only encode]

Each command is a child of a process that has everything imported, in a folder of its own with good and spoiled files of
every kind. Arguments are mostly files of that folder, options those of the verb, values mostly what people write. The
law: exit code 0 to 3, no traceback, no more than :data:`MOST_S` of processor and :data:`MOST_MB`, no input changed that
was not named as the output, no hidden file left. What breaks it is printed as a command line.
"""

import argparse
import math
import os
import random
import resource
import shlex
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import typer

from fapengine.cli.main import COMMANDS, app, main
from tests.fuzz.mutated import mutated
from tests.fuzz.readers import readers

ENDINGS = {
    "POS": ".pos", "MVIEW": ".mat", "BVH": ".bvh",
    "FBA": ".fba", "fap": ".fap", "epf": ".epf", "shapes": ".csv", "C3D": ".c3d", "TRC": ".trc", "marker table": ".csv",
    "NPZ": ".npz", "landmarks": ".json", "glTF, a face": ".glb", "mesh, obj": ".obj", "session.toml": ".toml",
    "sound, WAV": ".wav", "sound, mp3": ".mp3", "picture": ".png", "text": ".txt", "VMC recording": ".osc",
}  # fmt: skip
"""Readers whose examples lie in the folder, and under what ending; timings lie there under several."""
TIMINGS = (".TextGrid", ".pho", ".json", ".csv", ".srt", ".txt")
WORDS = (
    "0", "1", "2", "-1", "0.5", "1e9", "nan", "", "64", "64x48", "all", "en-us", "de", "joy", "joy:0.5", "joy:0.5@0-1",
    "surprise:9", "none", "arkit", "visemes", "rhubarb", "default", "woman", "random:3", "grid_s1_en", "ipa", "arpabet",
    "start=a,end=b,label=c", "#ff0000", "soft", "fine", "front", "left:2", "blinks", "ö", "a b", "../x", "-", "fba",
)  # fmt: skip
OUTPUTS = (
    ".fap",
    ".fba",
    ".csv",
    ".json",
    ".png",
    ".mp4",
    ".gif",
    ".wav",
    ".glb",
    ".TextGrid",
    ".tsv",
    ".xyz",
    "",
    "/",
)
FITS = {
    "animate": (".wav", ".mp3", *TIMINGS),
    "align": (".wav", ".mp3"),
    "batch": (".csv", ".json"),
    "render": (".fap", ".csv"),
    "encode": (".fap",),
    "decode": (".fba",),
    "convert": (".fap", ".fba", ".csv", ".osc"),
    "fit": (".toml",),
    "score": (".fap", ".csv"),
    "head import": (".glb", ".obj"),
}
"""Endings that a verb's argument mostly has."""
OUTPUT_FITS = {
    "encode": ".fba", "decode": ".fap", "align": ".TextGrid", "score": ".html", "animate": ".fap", "say": ".fap",
    "render": ".gif", "convert": ".csv", "batch": "",
}  # fmt: skip
ENDLESS = ("serve", "view")
"""Verbs that wait for somebody; ``--live`` and ``--mic`` do, too."""
MOST_S, MOST_MB = 60, 3000


def fill(folder: Path, chance: random.Random) -> list[str]:
    """Write good and spoiled files of every kind; return their names."""
    names = []
    for reader in readers():
        ending = ENDINGS.get(reader.name) or (chance.choice(TIMINGS) if reader.name.startswith("timings") else None)
        if ending is None or (ending in TIMINGS and chance.random() < 0.7):
            continue
        good = chance.choice(reader.good)
        data = good if chance.random() < 0.6 else mutated(chance, reader.good)
        name = f"{''.join(letter for letter in reader.name if letter.isalnum())}{ending}"
        (folder / name).write_bytes(data)
        names.append(name)
    (folder / "folder").mkdir()
    return [*names, "folder", "missing.fap"]


def command_line(chance: random.Random, names: Sequence[str], only: str) -> list[str]:
    """Make up a command."""
    group: Any = typer.main.get_command(app)
    verbs = {name: group.get_command(None, name) for name in COMMANDS}
    verbs = verbs | {f"head {name}": verb for name, verb in verbs["head"].commands.items()}
    name = chance.choice([name for name in verbs if name not in (*ENDLESS, "head") and only in name])
    words = name.split()
    for parameter in verbs[name].params:
        if parameter.param_type_name == "argument":
            fitting = [each for each in names if each.endswith(FITS.get(name, ("",)))]
            words.append(chance.choice(fitting) if fitting and chance.random() < 0.85 else _value(chance, names))
            continue
        if {"--live", "--mic", "--help", "--scheduler"} & set(parameter.opts):
            continue
        if chance.random() < (0.9 if "--output" in parameter.opts else 0.4 if "--size" in parameter.opts else 0.015):
            words.append(chance.choice([*parameter.opts, *parameter.secondary_opts]))
            if "--output" in parameter.opts:
                ending = OUTPUT_FITS.get(name) if chance.random() < 0.6 else None
                made = f"out{ending or chance.choice(OUTPUTS)}"
                words.append(made if chance.random() < 0.8 else _value(chance, names))
            elif "--size" in parameter.opts:
                words.append(chance.choice(("64", "32", "32x48", "64x32", _value(chance, names))))
            elif not parameter.is_flag:
                words.append(_value(chance, names))
    return words


def _value(chance: random.Random, names: Sequence[str]) -> str:
    return chance.choice(names) if chance.random() < 0.7 else chance.choice(WORDS)


def run(words: Sequence[str], folder: Path) -> tuple[int, str]:
    """Run a command in a child; its exit code (minus the signal that ended it), and all that it printed."""
    with tempfile.TemporaryFile() as printed:
        child = os.fork()
        if not child:
            code = 70
            try:
                os.chdir(folder)
                for stream in (1, 2):
                    os.dup2(printed.fileno(), stream)
                os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
                resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S + 5))
                resource.setrlimit(resource.RLIMIT_AS, (MOST_MB << 20, MOST_MB << 20))
                sys.argv = ["fapengine", *words]
                main()
                code = 0
            except SystemExit as error:
                code = error.code if isinstance(error.code, int) else 0 if error.code is None else 1
            finally:
                with suppress(Exception):
                    sys.stdout.flush()
                os._exit(code)
        until_s = time.monotonic() + 4 * MOST_S
        while True:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                break
            if time.monotonic() > until_s:
                os.kill(child, signal.SIGKILL)
                until_s += MOST_S
            time.sleep(0.005)
        printed.seek(0)
        return os.waitstatus_to_exitcode(status), printed.read().decode(errors="replace")


def broken(words: Sequence[str], folder: Path, names: Sequence[str]) -> tuple[int, str | None]:
    """Run a command, and tell how it ended and what law it broke."""
    before = {name: (folder / name).read_bytes() for name in names if (folder / name).is_file()}
    code, printed = run(words, folder)
    if "Traceback" in printed or "this is a bug" in printed:
        return code, printed[-300:]
    if code not in (0, 1, 2, 3):
        return code, f"exit code {code}: {printed[-200:]}"
    for name, data in before.items():
        if name not in words[1:] or code:
            now = (folder / name).read_bytes() if (folder / name).exists() else None
            if now != data and f"-o {name}" not in " ".join(words) and f"--output {name}" not in " ".join(words):
                return code, f"{name} was changed"
    hidden = [path.name for path in folder.rglob(".*")]
    return code, f"left {hidden}" if hidden else None


def search(seconds: float, seed: int, only: str = "", most: int = 1 << 30) -> tuple[Counter[str], list[str]]:
    """Try so long, or so many; count endings by verb and code, and list what broke the law."""
    chance, endings, found = random.Random(seed), Counter[str](), []
    until_s = math.inf
    with tempfile.TemporaryDirectory() as root:
        while time.monotonic() < until_s and sum(endings.values()) < most:
            folder = Path(root) / "here"
            folder.mkdir()
            names = fill(folder, chance)
            until_s = min(until_s, time.monotonic() + seconds)  # what is imported and built first is no part of it
            for _ in range(20):
                words = command_line(chance, names, only)
                code, wrong = broken(words, folder, names)
                endings[f"{words[0]} {code}"] += 1
                if wrong:
                    found.append(f"fapengine {shlex.join(words)}\n    {wrong}")
                if time.monotonic() > until_s or sum(endings.values()) >= most:
                    break
            shutil.rmtree(folder)
    return endings, found


def start() -> int:
    """Search, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--count", type=int, default=1 << 30, help="stop after so many commands")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="verbs with this in their names")
    chosen = parser.parse_args()
    endings, found = search(chosen.seconds, chosen.seed, chosen.only, chosen.count)
    print(f"{sum(endings.values())} commands: {dict(sorted(endings.items()))}")
    print("\n".join(found) or "all as promised")
    return bool(found)


if __name__ == "__main__":
    sys.exit(start())
