"""The page of a listening test, in a real browser: it plays, asks, checks attention, and saves what is analysed."""

import re
from pathlib import Path

import numpy as np
import pytest

from fapengine.app.listening import analyse_answers, write_listening_test
from fapengine.files.moving import write_moving
from fapengine.scoring.statistics import parse_answers
from tests.browser.conftest import Page

ITEMS = ("hello", "bye", "five, six")
SECONDS = 0.2


@pytest.fixture(scope="module")
def test_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("listening")
    for shade, system in ((60, "ours"), (180, "theirs")):
        (folder / system).mkdir()
        for item in ITEMS:
            frames = [np.full((32, 32, 3), shade + n, np.uint8) for n in range(round(25 * SECONDS))]
            write_moving(
                folder / system / f"{item}.webm", frames, rate_hz=25.0,
                sound=(np.full(round(8000 * SECONDS), 100, np.int16), 8000),
            )  # fmt: skip
    test = write_listening_test(folder / "ours", folder / "theirs", folder / "page", seed=3)
    assert (test.systems, test.pairs, test.checks, test.left_out) == (("ours", "theirs"), 3, 2, ())
    return folder


def open_page(page: Page, folder: Path, listener: str) -> None:
    page.go(f"{(folder / 'page' / 'index.html').as_uri()}?listener={listener}")
    page.until("typeof trials === 'object' && document.readyState === 'complete'")
    page.run("document.getElementById('begin').click()")


def answer(page: Page, side: str | None = None) -> None:
    """Play both films by the keys, then choose; without a side, the moving film or ours."""
    assert page.run("document.getElementById('choose-left').disabled")
    for key in ("1", "2"):
        page.key(key)
        assert page.run("trials[rows.length].still") != int(key) - 1 or page.run(
            f"sound !== null && document.getElementById('{('left', 'right')[int(key) - 1]}').paused"
        )
        page.until(f"seen.has({int(key) - 1})")
    if side is None:
        shown = page.run("trials[rows.length].shown")
        side = ("left", "right")[shown.index("moving" if "moving" in shown else "ours")]
    count = page.run("rows.length")
    page.key("ArrowLeft" if side == "left" else "ArrowRight")
    page.until(f"rows.length === {count + 1}")


def test_a_listener_answers_and_the_answers_are_analysed(page: Page, test_folder: Path, tmp_path: Path) -> None:
    names = [path.name for path in (test_folder / "page" / "clips").iterdir()]
    assert len(names) == 6
    assert all(re.fullmatch(r"[0-9a-f]{16}\.webm", name) for name in names)  # no name tells the system
    open_page(page, test_folder, "anna")
    page.key("ArrowLeft")  # nothing was played yet
    assert page.run("rows.length") == 0
    for _ in range(2):
        answer(page)
    open_page(page, test_folder, "anna")  # a reload loses nothing
    assert page.run("document.getElementById('state').textContent") == "Pair 3 of 5"
    for _ in range(3):
        answer(page)
    page.until("!document.getElementById('end').hidden")
    assert page.run("document.getElementById('save').download") == "answers-anna.csv"
    saved = page.run("fetch(document.getElementById('save').href).then((answer) => answer.text())")
    (tmp_path / "anna.csv").write_text(saved, encoding="utf-8")
    answers = parse_answers(saved.encode())
    assert sorted(each.item for each in answers if not each.is_check) == sorted(ITEMS)
    assert [each.chosen for each in answers if each.is_check] == ["moving"] * 2
    open_page(page, test_folder, "berta")
    for _ in range(5):
        answer(page, "left" if page.run("trials[rows.length].still") == 0 else "right")  # the one that stands still
    (tmp_path / "berta.csv").write_text(page.run("answers()"), encoding="utf-8")
    found = analyse_answers([tmp_path])
    assert (found.system, found.chosen, found.answers) == ("ours", 3, 3)
    assert found.excluded == {"berta": 0.0}


def test_orders_are_the_listener_s_own_and_balanced(page: Page, test_folder: Path) -> None:
    open_page(page, test_folder, "carl")
    assert page.run("JSON.stringify(plan(config, 'a')) === JSON.stringify(plan(config, 'a'))")
    many = "{ ...config, items: [...Array(40).keys()].map((n) => ({ id: `u${n}`, clips: ['a', 'b'] })), checks: 5 }"
    orders = page.run(f"['a', 'b', 'c'].map((name) => plan({many}, name))")
    assert len({tuple(trial["item"] for trial in order) for order in orders}) == 3
    for order in orders:
        pairs = [trial for trial in order if trial["still"] < 0]
        assert sorted(trial["item"] for trial in pairs) == sorted(f"u{n}" for n in range(40))
        assert sum(trial["shown"][0] == "ours" for trial in pairs) == 20
        checks = [n for n, trial in enumerate(order) if trial["still"] >= 0]
        assert checks == [4, 13, 22, 31, 40]  # one in each fifth
        assert all(len(set(order[n]["clips"])) == 1 for n in checks)
    one = "{ ...config, items: config.items.slice(0, 1), checks: 0 }"
    lefts = page.run(f"[...Array(64).keys()].map((name) => plan({one}, name)[0].shown[0])")
    assert 20 <= lefts.count("ours") <= 44  # of an odd number, too, no system has a side


def test_a_film_that_is_missing_is_told(page: Page, test_folder: Path, tmp_path: Path) -> None:
    text = (test_folder / "page" / "index.html").read_text(encoding="utf-8")
    (tmp_path / "page").mkdir()
    (tmp_path / "page" / "index.html").write_text(text, encoding="utf-8")
    open_page(page, tmp_path, "dora")
    page.until("document.getElementById('trouble').textContent === 'A film cannot be loaded.'")
    page.complaints.clear()  # of the films
