"""Listening tests: a page with the films of two systems, and what its answers say."""

import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from fapengine._resources import page_files
from fapengine.app.motion import LOADED, save
from fapengine.errors import UsageError
from fapengine.files.motion import load_motion
from fapengine.files.paths import naming, read_bytes, replacing_folder
from fapengine.files.report.parts import asset
from fapengine.files.sound import load_sound
from fapengine.scoring.statistics import COLUMNS, Preference, parse_answers, preference_of

PLAYED = (".mp4", ".m4v", ".webm")
"""Films that browsers play."""
PAIRS_PER_CHECK, MIN_CHECKS = 8, 2
"""Number of pairs for each attention check, and least number of these."""


@dataclass(frozen=True, slots=True)
class ListeningTest:
    """A page that was written."""

    systems: tuple[str, str]
    pairs: int
    checks: int
    left_out: tuple[str, ...]
    """Utterances that only one of the systems has."""


def write_listening_test(
    one: Path,
    other: Path,
    output: Path,
    *,
    audio: Path | None = None,
    seed: int = 1,
    on_film: Callable[[], None] = lambda: None,
) -> ListeningTest:
    """Write the page of a listening test into a folder, which any web server can show, or a browser from the disk.

    Raises UsageError if the folders have no utterance in common, or the same name.

    Parameters
    ----------
    one, other : Path
        Folders of two systems: films of the same names (:data:`PLAYED`), or motion, which is drawn.
    output : Path
        Folder for ``index.html`` and ``clips``.
    audio : Path, optional
        Folder with the sound of motion that is drawn.
    seed : int
        Seed of the orders.
    on_film : callable
        Called after each film.
    """
    systems = one.name, other.name
    if systems[0] == systems[1]:
        raise UsageError(f"made: got two folders called {one.name}, expected different names: they name the systems")
    found = [_utterances(folder) for folder in (one, other)]
    common = [name for name in found[0] if name in found[1]]
    if not common:
        raise UsageError(f"made: got no file of one name in both {one} and {other}, expected films or motion")
    items: dict[str, list[str]] = {}
    with replacing_folder(output, owned=["index.html", "clips/*"]) as folder:
        (folder / "clips").mkdir()
        for name in common:
            items[name] = []
            for system, paths in zip(systems, found, strict=True):
                code = sha256(f"{seed} {system} {name}".encode()).hexdigest()[:16]  # a name tells nobody the system
                suffix = paths[name].suffix.lower() if paths[name].suffix.lower() in PLAYED else ".mp4"
                items[name].append(f"clips/{code}{suffix}")
                _put(paths[name], folder / items[name][-1], audio)
                on_film()
        checks = max(MIN_CHECKS, round(len(common) / PAIRS_PER_CHECK))
        test_id = sha256(f"{seed} {systems} {common}".encode()).hexdigest()[:8]
        page = format_listen_page(items, systems, checks=checks, seed=seed, name=test_id)
        (folder / "index.html").write_bytes(page)
    left_out = tuple(sorted(set(found[0]) ^ set(found[1])))
    return ListeningTest(systems, len(common), checks, left_out)


def _utterances(folder: Path) -> dict[str, Path]:
    """Find the film of each utterance, else its motion; what ``say`` writes beside a film is left out."""
    if not folder.is_dir():
        raise UsageError(f"made: got {folder}, expected a folder of films")
    files = [path for path in sorted(folder.iterdir()) if path.name[0] != "."]
    return {path.stem: path for endings in (LOADED, PLAYED) for path in files if path.suffix.lower() in endings}


def _put(source: Path, target: Path, audio: Path | None) -> None:
    """Copy a film, or draw motion with its sound."""
    if source.suffix.lower() in PLAYED:
        shutil.copyfile(source, target)
        return
    sounds = [path for path in (audio.iterdir() if audio is not None else ()) if path.stem == source.stem]
    if not sounds:
        raise UsageError(f"audio: got no sound for {source.name}, expected a folder with {source.stem}.wav")
    save(load_motion(source), target, sound=load_sound(sounds[0]))


def analyse_answers(paths: Iterable[Path], *, seed: int = 1) -> Preference:
    """Analyse the answers of a listening test.

    Raises UsageError if a file cannot be read; DataError if one is no such table, or the answers are not about two
    systems.

    Parameters
    ----------
    paths : iterable of Path
        CSV files of the page, of one listener each or of several; folders of them.
    """
    answers = []
    for path in paths:
        for file in sorted(path.glob("*.csv")) if path.is_dir() else [path]:
            with naming(file):
                answers += parse_answers(read_bytes(file))
    return preference_of(answers, seed=seed)


STYLE = "call.css"
"""Style of the web page's small pages, which this one shares."""


def format_listen_page(
    items: Mapping[str, Sequence[str]], systems: Sequence[str], *, checks: int, seed: int, name: str
) -> bytes:
    """Format the page.

    Parameters
    ----------
    items : mapping of str to sequence of str
        Films of each utterance, one for each system, relative to the page.
    systems : sequence of str
        Names of the two systems, which the page writes into the answers and does not show.
    checks : int
        Number of attention checks.
    seed : int
        Seed of the order, which the name of the listener changes too.
    name : str
        Name of the test, for what the browser keeps.
    """
    config = {
        "id": name, "systems": list(systems), "checks": checks, "seed": seed, "columns": COLUMNS,
        "items": [{"id": item, "clips": list(clips)} for item, clips in items.items()],
    }  # fmt: skip
    page = asset("listen.html")
    for place, text in (
        ("/*STYLE*/", page_files()[STYLE].decode()),
        ("/*CONFIG*/", json.dumps(config, ensure_ascii=False).replace("<", "\\u003c")),
        ("/*SCRIPT*/", asset("listen.js")),
    ):
        page = page.replace(place, text, 1)
    return page.encode()
