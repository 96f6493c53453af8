"""Reports as somebody meets them: the verdict first, on a telephone and by ear, too."""

import re
from types import SimpleNamespace as Some
from typing import Any

import pytest

from fapengine.files.report import page as fit_page
from fapengine.files.report import score_page
from fapengine.files.report.parts import page, picture, table
from fapengine.scoring.verdict import Fault, Verdict


def test_a_page_lists_its_headings_and_fits_any_screen() -> None:
    html = page("a & b", ["<h1>a</h1>", "<h2>One</h2>", table(("x",), [("1",)]), "<h2>Two</h2>"]).decode()
    assert re.findall(r'<a href="#(\w+)">(\w+)</a>', html) == [("part0", "One"), ("part1", "Two")]
    assert html.index("<nav") < html.index('<h2 id="part0">One') < html.index('<h2 id="part1">Two')
    assert 'name="viewport"' in html
    assert '<html lang="en">' in html
    assert "<title>a &amp; b</title>" in html


def test_figures_are_named_and_tables_scroll() -> None:
    drawn = picture(b"<?xml?><svg/>", "Take <b>a &amp; b</b>.")
    assert 'role="img" aria-label="Take a &amp; b."' in drawn
    made = table(("what", "mm"), [("ours", "1.0"), ("others", "2.0")], marked="ours")
    assert made.startswith('<div class="scroll" role="region" tabindex="0" aria-label="what">')
    assert re.findall("<tr[^>]*>", made) == ["<tr>", '<tr class="ours">', "<tr>"]


def fitted(r: float, lips_mm: float, warnings: int = 0) -> Any:
    whole = {"opening_r": r, "lips_mm": lips_mm, "mean_pose_mm": 2.5}
    study = Some(whole=Some(**{name: Some(value=value) for name, value in whole.items()}), context=True)
    return Some(prediction=study, warnings=["x"] * warnings)


@pytest.mark.parametrize(
    ("r", "lips_mm", "grade"), [(0.8, 1.6, "Good"), (0.8, 2.4, "Fair"), (0.5, 1.6, "Fair"), (0.3, 1.6, "Poor")]
)
def test_a_fit_says_first_how_good_it_is(r: float, lips_mm: float, grade: str) -> None:
    told = fit_page._verdict(fitted(r, lips_mm, warnings=2))
    assert f"<b>{grade}.</b>" in told
    assert f"{lips_mm:.2f} mm" in told
    assert "1.55 mm and r = 0.88" in told
    assert "2 warnings" in told
    assert "Not judged" in fit_page._verdict(Some(prediction=None, warnings=[]))


@pytest.mark.parametrize(
    ("verdict", "told"),
    [
        (Verdict((), ("lag",), "lag 20 ms"), '<p class="verdict good"><b>passes: lag 20 ms</b></p>'),
        (Verdict((Fault("lag", "lag 99 ms"),), ("lag",), ""), '<p class="verdict poor"><b>fails: lag 99 ms</b></p>'),
        (
            Verdict((), (), "", ("lag",)),
            '<p class="verdict "><b>passes: nothing could be checked; not checked: lag</b></p>',
        ),
    ],
)
def test_a_score_says_first_how_good_it_is(verdict: Verdict, told: str) -> None:
    assert score_page.spell_verdict(verdict) == told
