"""Random command lines: every command ends by itself, explains a failure in one line, and leaves its inputs unchanged.

    python -m tests.fuzz.command_lines [--seconds 600] [--count 1000] [--seed 1] [--only encode]

Commands run one after the other in a child of a process that has everything imported: :data:`TOGETHER` in each of
:data:`FOLDERS` folders with good and spoiled files of every kind. Arguments are mostly files of that folder, options
those of the command, values mostly what people write. Asked of each: exit code 0 to 3, no traceback, a message where it
is not 0, at most :data:`MOST_S` of CPU time and :data:`MOST_MB`, no input changed that was not named as the output, no
hidden file left, nothing written beside the folder that was not named, nothing left in the folder for temporary files.
A failure is printed as a command line; a command that ends its process costs itself alone.
"""

import argparse
import json
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
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import typer

from fapengine.cli.main import COMMANDS, Commands, app, main
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
    "batch": ("rows.csv",),
    "render": (".fap", ".csv"),
    "encode": (".fap",),
    "decode": (".fba",),
    "convert": (".fap", ".fba", ".csv", ".osc"),
    "capture": ("landmarks.json",),
    "reduce": (".c3d", ".trc", "markertable.csv", ".npz"),
    "drive": (".c3d", ".trc", "markertable.csv", ".npz"),
    "fit": (".toml",),
    "score": (".fap", ".csv"),
    "head import": (".glb", ".obj"),
}
"""How the name of a command's argument mostly ends."""
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
MISSING = "missing.fap"
ENDLESS = {"serve": ("--config", "missing.toml"), "view": (MISSING,)}
"""Commands that wait for somebody, and what they always refuse."""
WAITS = {"--live", "--mic", "--help", "--scheduler", "--window"}
"""Options that wait for somebody, and ``--help``."""
SELDOM = {
    "doctor": 0.01, "batch": 0.03, "head check": 0.05, "head export": 0.1, "say": 0.2, "align": 0.2, "animate": 0.4,
    "convert": 0.4,
}  # fmt: skip
"""Shares of commands that take long: fewer of them let all the others be tried more often in the same time."""
SMALL = 0.97
"""Share of the commands that draw which say how large."""
MOST_S, MOST_MB = 60, 4000
TOGETHER = 40
"""Commands in one folder."""
FOLDERS = 10
"""Folders of one child, which builds heads and voices once."""


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
    rows = [f"row{number},{chance.choice(names)}" for number in range(2)]
    (folder / "rows.csv").write_text("\n".join([chance.choice(("id,timings", "id,recording")), *rows]))
    return [*names, "rows.csv", "folder", MISSING]


def commands() -> dict[str, Any]:
    """Every command by its name, those of ``head`` with both words. What is built here, every run of a command uses."""
    typer.main.get_command = cache(typer.main.get_command)
    named = cache(partial(Commands.get_command, None, None))
    Commands.get_command = lambda _, __, name: named(name)  # type: ignore[method-assign]
    group: Any = typer.main.get_command(app)
    known = {name: group.get_command(None, name) for name in COMMANDS}
    known |= {f"head {name}": command for name, command in known.pop("head").commands.items()}
    return known


def command_line(chance: random.Random, known: dict[str, Any], names: Sequence[str]) -> list[str]:
    """Make up a command."""
    name = chance.choices([*known], [SELDOM.get(name, 1.0) for name in known])[0]
    words = name.split()
    for parameter in known[name].params:
        if parameter.param_type_name == "argument":
            there = [each for each in names if each.endswith(FITS.get(name, ("",))) and each != MISSING]
            fitting = SAID.get(name) or there
            if name not in ENDLESS:
                words.append(chance.choice(fitting) if fitting and chance.random() < 0.85 else _value(chance, names))
            continue
        if WAITS & set(parameter.opts):
            continue
        if chance.random() < (0.9 if "--output" in parameter.opts else SMALL if "--size" in parameter.opts else 0.015):
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


class Inputs:
    """Files of a folder as they were before a command.

    Stateful.
    """

    def __init__(self, folder: Path, names: Sequence[str]) -> None:
        self._folder = folder
        self._data = {name: (folder / name).read_bytes() for name in names if (folder / name).is_file()}
        self._seen = {name: self._stamp(name) for name in self._data}

    def _stamp(self, name: str) -> tuple[int, ...]:
        try:
            status = (self._folder / name).stat()
        except OSError:
            return ()
        return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns

    def changed(self) -> list[str]:
        """Names of files that are not what they were at the last call."""
        found = []
        for name, stamp in self._seen.items():
            if (now := self._stamp(name)) == stamp:
                continue
            self._seen[name] = now
            data = (self._folder / name).read_bytes() if now else b""
            if data != self._data[name] or not now:
                found.append(name)
            self._data[name] = data
        return found


def broken(words: Sequence[str], folder: Path, inputs: Inputs, printed: BinaryIO) -> tuple[int, str | None]:
    """Run a command, and tell how it ended and what law it broke."""
    code, told = run(words, folder, printed)
    changed = inputs.changed()
    if "Traceback" in told or "this is a bug" in told:
        return code, told[-300:]
    if code not in (0, 1, 2, 3):
        return code, f"exit code {code}: {told[-200:]}"
    if code and not told.strip():
        return code, f"exit code {code} without a word"
    outputs = {output for option, output in pairwise(words) if option in ("-o", "--output")}
    for name in changed:
        if name not in outputs and (name not in words[1:] or code):
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
FOREIGN = "pulse-"
"""Beginning of names that libpulse leaves in the folder for temporary files."""


def clear(paths: Iterable[Path]) -> None:
    """Remove files and folders."""
    for path in paths:
        shutil.rmtree(path) if path.is_dir() else path.unlink()


@dataclass
class Child:
    """What a child did: commands with their ends, the modules it imported, and the command that ended it."""

    ends: list[tuple[int, list[str], int, str | None]]
    """Number of the folder, the words, the exit code, what law it broke."""
    modules: list[str]
    alive: bool


def run_child(work: Callable[[Callable[[object], None]], None]) -> Child:
    """Do work in a child: commands, of which each is told before and after it runs."""
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            resource.setrlimit(resource.RLIMIT_AS, (MOST_MB << 20, MOST_MB << 20))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            known = set(sys.modules)

            def tell(what: object) -> None:
                os.write(writes, json.dumps(what).encode() + b"\n")

            work(tell)
            tell([name for name in sys.modules if name not in known])
        finally:
            os._exit(0)
    os.close(writes)
    with os.fdopen(reads, "rb") as pipe:
        told = [json.loads(line) for line in pipe if line.endswith(b"\n")]
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    alive = bool(told) and isinstance(told[-1], list)
    modules = told.pop() if alive else []
    ends = [(*begun.values(), *end.values()) for begun, end in zip(told[::2], told[1::2], strict=False)]
    if len(told) % 2:
        ends.append((*told[-1].values(), code, f"the process ended with {code}"))
    return Child(ends, modules, alive)


@dataclass(frozen=True)
class Search:
    """The same seed and number of a folder make the same files and commands."""

    root: Path
    seed: int
    known: dict[str, Any]
    until_s: float

    def run(self, first: int, skipped: int, most: int, tell: Callable[[object], None]) -> None:
        """Run so many commands of a child's folders, from a command of the first one on."""
        folder = self.root / "here"
        with tempfile.TemporaryFile() as printed:
            for number in range(first, first + FOLDERS):
                if most <= 0 or time.monotonic() > self.until_s:
                    return
                chance = random.Random(f"{self.seed} {number}")
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                names = fill(folder, chance)
                commands = [command_line(chance, self.known, names) for _ in range(TOGETHER)][skipped:][:most]
                inputs, skipped, most = Inputs(folder, names), 0, most - len(commands)
                for words in commands:
                    tell({"folder": number, "words": words})
                    code, wrong = broken(words, folder, inputs, printed)
                    tell({"code": code, "wrong": wrong})


def search(
    seconds: float, seed: int, only: str = "", most: int = 1 << 30
) -> tuple[Counter[str], list[str], tuple[int, int]]:
    """Try so long, or so many: endings by command and code, what broke the law, and how many options of how many."""
    endings, found, tried, imported = Counter[str](), list[str](), set[tuple[str, str]](), set[str]()
    known = {name: command for name, command in commands().items() if only in name}
    every = {
        (name, option)
        for name, command in known.items()
        for parameter in command.params
        if parameter.param_type_name == "option" and not WAITS & set(parameter.opts)
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    readers()  # what is imported and built first is no part of the time
    number = skipped = 0
    with tempfile.TemporaryDirectory() as root:
        os.environ["TMPDIR"] = tempfile.tempdir = f"{root}/{TEMPORARY}"
        Path(tempfile.tempdir).mkdir()
        place = Search(Path(root), seed, known, time.monotonic() + seconds)
        while sum(endings.values()) < most and time.monotonic() < place.until_s:
            child = run_child(partial(place.run, number, skipped, most - sum(endings.values())))
            for folder, words, code, wrong in child.ends:
                skipped = skipped + 1 if folder == number else 1
                number = folder
                name = " ".join(words[: 1 + (words[0] == "head")])
                endings[f"{name} {code}"] += 1
                tried |= {(name, word) for word in words} & every
                if wrong:
                    found.append(f"fapengine {shlex.join(words)}\n    {wrong}")
                    print(f"folder {folder}: {found[-1]}", file=sys.stderr, flush=True)
            if child.alive:
                number, skipped = number + 1, 0
            for module in set(child.modules) - imported - APART:
                imported.add(module)
                with suppress(Exception):
                    import_module(module)
            clear(Path(tempfile.tempdir).iterdir())
            print(f"{sum(endings.values())} commands, {len(found)} not as promised", file=sys.stderr, flush=True)
    return endings, found, (len(tried), len(every))


APART = {"sounddevice", "_sounddevice"}
"""Modules that open devices when they are imported."""


def start() -> int:
    """Search, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--count", type=int, default=1 << 30, help="stop after so many commands")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="commands with this in their names")
    chosen = parser.parse_args()
    endings, found, (tried, every) = search(chosen.seconds, chosen.seed, chosen.only, chosen.count)
    print(f"{sum(endings.values())} commands, {tried} of {every} options: {dict(sorted(endings.items()))}")
    print("\n".join(found) or "all as promised")
    return bool(found)


if __name__ == "__main__":
    sys.exit(start())
