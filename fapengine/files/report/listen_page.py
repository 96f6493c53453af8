"""The page of a listening test: one HTML file with its script, beside a folder of films."""

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files

from fapengine._resources import page_files
from fapengine.scoring.listening import COLUMNS

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
    here = files(__package__)
    page = (here / "listen.html").read_text(encoding="utf-8")
    for place, text in (
        ("/*STYLE*/", page_files()[STYLE].decode()),
        ("/*CONFIG*/", json.dumps(config, ensure_ascii=False).replace("<", "\\u003c")),
        ("/*SCRIPT*/", (here / "listen.js").read_text(encoding="utf-8")),
    ):
        page = page.replace(place, text, 1)
    return page.encode()
