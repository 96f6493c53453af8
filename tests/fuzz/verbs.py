"""Random command lines: every verb ends by itself, in a line of words, and leaves what it was given as it was.

    python -m tests.fuzz.verbs [--seconds 600] [--count 1000] [--seed 1] [--only encode]

Commands run one after the other in a child of a process that has everything imported, in a folder with good and spoiled
files of every kind. Arguments are mostly files of that folder, options those of the verb, values mostly what people
write. The law: exit code 0 to 3, no traceback, a line of words where it is not 0, no more than :data:`MOST_S` of
processor and :data:`MOST_MB`, no input changed that was not named as the output, no hidden file left, nothing written
beside the folder that was not named, nothing left in the folder for temporary files. What breaks it is printed as a
command line; a command that ends its process costs itself alone.
"""

import argparse
import json
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
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

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
    "capture": (".json", ".csv"),
    "reduce": (".c3d", ".trc", ".csv", ".npz"),
    "drive": (".c3d", ".trc", ".csv", ".npz"),
    "fit": (".toml",),
    "score": (".fap", ".csv"),
    "head import": (".glb", ".obj"),
}
"""Endings that a verb's argument mostly has."""
SAID = {
    "say": ("Hello.", "Ja, gut!"),
    "head check": ("default:level=coarse",),
    "head export": ("default:level=coarse", "woman:level=coarse"),
}
"""Arguments that are no files."""
OUTPUT_FITS = {
    "encode": ".fba", "decode": ".fap", "align": ".TextGrid", "score": ".html", "animate": ".fap", "say": ".fap",
    "render": ".gif", "convert": ".csv", "batch": "", "capture": ".fap", "reduce": ".npz", "drive": ".npz",
}  # fmt: skip
ENDLESS = {"serve": ("--config", "missing.toml"), "view": ("missing.fap",)}
"""Verbs that wait for somebody, and what they always refuse."""
WAITS = {"--live", "--mic", "--help", "--scheduler", "--window"}
"""Options that wait for somebody, and ``--help``."""
SELDOM = {"doctor": 0.1}
"""Share of a verb that has little to be told and takes long."""
MOST_S, MOST_MB = 60, 4000
TOGETHER = 40
"""Commands in one folder."""


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


def verbs() -> dict[str, Any]:
    """Every command by its name, those of ``head`` with both words."""
    group: Any = typer.main.get_command(app)
    known = {name: group.get_command(None, name) for name in COMMANDS}
    known |= {f"head {name}": verb for name, verb in known.pop("head").commands.items()}
    return known


def command_line(chance: random.Random, known: dict[str, Any], names: Sequence[str]) -> list[str]:
    """Make up a command."""
    name = chance.choices([*known], [SELDOM.get(name, 1.0) for name in known])[0]
    words = name.split()
    for parameter in known[name].params:
        if parameter.param_type_name == "argument":
            fitting = SAID.get(name) or [each for each in names if each.endswith(FITS.get(name, ("",)))]
            if name not in ENDLESS:
                words.append(chance.choice(fitting) if fitting and chance.random() < 0.85 else _value(chance, names))
            continue
        if WAITS & set(parameter.opts):
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
    return [*words, *ENDLESS.get(name, ())]


def _value(chance: random.Random, names: Sequence[str]) -> str:
    return chance.choice(names) if chance.random() < 0.7 else chance.choice(WORDS)


def run(words: Sequence[str], folder: Path, printed: BinaryIO) -> tuple[int, str]:
    """Run a command in this process, with a file as its output; its exit code, and all that it printed."""
    printed.seek(0)
    printed.truncate()
    code = 70
    try:
        os.chdir(folder)
        for stream in (1, 2):
            os.dup2(printed.fileno(), stream)
        signal.setitimer(signal.ITIMER_PROF, MOST_S)
        sys.argv = ["fapengine", *words]
        main()
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 0 if error.code is None else 1
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):
                stream.flush()
    printed.seek(0)
    return code, printed.read().decode(errors="replace")


def broken(words: Sequence[str], folder: Path, names: Sequence[str], printed: BinaryIO) -> tuple[int, str | None]:
    """Run a command, and tell how it ended and what law it broke."""
    before = {name: (folder / name).read_bytes() for name in names if (folder / name).is_file()}
    code, told = run(words, folder, printed)
    if "Traceback" in told or "this is a bug" in told:
        return code, told[-300:]
    if code not in (0, 1, 2, 3):
        return code, f"exit code {code}: {told[-200:]}"
    if code and not told.strip():
        return code, f"exit code {code} without a word"
    for name, data in before.items():
        if name not in words[1:] or code:
            now = (folder / name).read_bytes() if (folder / name).exists() else None
            if now != data and f"-o {name}" not in " ".join(words) and f"--output {name}" not in " ".join(words):
                return code, f"{name} was changed"
    hidden = [path.name for path in folder.rglob(".*")]
    if hidden:
        return code, f"left {hidden}"
    temporary = folder.parent / TEMPORARY
    beside = [path for path in folder.parent.iterdir() if path not in (folder, temporary)]
    names_left = [path.name for path in (*beside, *temporary.iterdir())]
    if "../x" in words:  # it may be named as an output
        names_left = [name for name in names_left if not name.startswith("x")]
    names_left = [name for name in names_left if not name.startswith(FOREIGN)]
    clear(beside)
    clear(temporary.iterdir())
    return code, f"wrote {names_left} beside its folder" if names_left else None


TEMPORARY = "temporary"
FOREIGN = (".ses", "pulse-")
"""Names that libraries of others leave in the folder for temporary files: onnxruntime, libpulse."""


def clear(paths: Iterable[Path]) -> None:
    """Remove files and folders."""
    for path in paths:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def run_all(
    commands: Sequence[Sequence[str]], folder: Path, names: Sequence[str]
) -> tuple[list[tuple[int, str | None]], list[str]]:
    """Run commands in a child until one ends it: how they ended, what law they broke; and the modules they imported.

    The last of fewer answers than commands is that of the one that ended the child.
    """
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            resource.setrlimit(resource.RLIMIT_AS, (MOST_MB << 20, MOST_MB << 20))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            known = set(sys.modules)
            with tempfile.TemporaryFile() as printed:
                for words in commands:
                    os.write(writes, json.dumps(broken(words, folder, names, printed)).encode() + b"\n")
            os.write(writes, json.dumps([name for name in sys.modules if name not in known]).encode() + b"\n")
        finally:
            os._exit(0)
    os.close(writes)
    with os.fdopen(reads, "rb") as pipe:
        answers = [json.loads(line) for line in pipe if line.endswith(b"\n")]
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if len(answers) > len(commands):
        return [(code, wrong) for code, wrong in answers[:-1]], answers[-1]
    clear((folder.parent / TEMPORARY).iterdir())
    return [*((code, wrong) for code, wrong in answers), (code, f"the process ended with {code}")], []


def search(
    seconds: float, seed: int, only: str = "", most: int = 1 << 30
) -> tuple[Counter[str], list[str], tuple[int, int]]:
    """Try so long, or so many: endings by verb and code, what broke the law, and how many options of how many.

    The same seed and number of a folder make the same files and commands.
    """
    endings, found, tried, imported = Counter[str](), list[str](), set[tuple[str, str]](), set[str]()
    known = {name: verb for name, verb in verbs().items() if only in name}
    every = {
        (name, option)
        for name, verb in known.items()
        for parameter in verb.params
        if parameter.param_type_name == "option" and not WAITS & set(parameter.opts)
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    until_s = math.inf
    with tempfile.TemporaryDirectory() as root:
        folder, temporary = Path(root) / "here", Path(root) / TEMPORARY
        temporary.mkdir()
        for number in count():
            chance = random.Random(f"{seed} {number}")
            folder.mkdir()
            names = fill(folder, chance)
            if not number:
                os.environ["TMPDIR"] = tempfile.tempdir = str(temporary)
                until_s = time.monotonic() + seconds  # what is imported and built first is no part of it
            left = [command_line(chance, known, names) for _ in range(min(TOGETHER, most - sum(endings.values())))]
            while left:
                answers, modules = run_all(left, folder, names)
                for words, (code, wrong) in zip(left, answers, strict=False):
                    name = " ".join(words[: 1 + (words[0] == "head")])
                    endings[f"{name} {code}"] += 1
                    tried |= {(name, word) for word in words} & every
                    if wrong:
                        found.append(f"fapengine {shlex.join(words)}\n    {wrong}")
                        print(f"folder {number}: {found[-1]}", file=sys.stderr, flush=True)
                left = left[len(answers) :]
                for module in set(modules) - imported - APART:
                    imported.add(module)
                    with suppress(Exception):
                        import_module(module)
            shutil.rmtree(folder)
            if number % 25 == 0:
                print(f"{sum(endings.values())} commands, {len(found)} not as promised", file=sys.stderr, flush=True)
            if time.monotonic() > until_s or sum(endings.values()) >= most:
                return endings, found, (len(tried), len(every))
    raise AssertionError("unreachable")


APART = {"sounddevice", "_sounddevice"}
"""Modules that open devices when they are imported."""


def start() -> int:
    """Search, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--count", type=int, default=1 << 30, help="stop after so many commands")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="verbs with this in their names")
    chosen = parser.parse_args()
    endings, found, (tried, every) = search(chosen.seconds, chosen.seed, chosen.only, chosen.count)
    print(f"{sum(endings.values())} commands, {tried} of {every} options: {dict(sorted(endings.items()))}")
    print("\n".join(found) or "all as promised")
    return bool(found)


if __name__ == "__main__":
    sys.exit(start())
