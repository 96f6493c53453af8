"""What a user sees while he waits: on a terminal only, and nothing of it stays."""

import io

import pytest
from rich.console import Console

from fapengine.app.report import Report
from fapengine.cli import _printing
from fapengine.cli._printing import progress, working


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> io.StringIO:
    written = io.StringIO()
    terminal = getattr(request, "param", True)
    monkeypatch.setattr(_printing, "_is_terminal", lambda **_: terminal)
    monkeypatch.setattr(_printing, "_screen", lambda: Console(file=written, force_terminal=terminal, width=80))
    return written


def test_stages_that_take_long_are_named(screen: io.StringIO) -> None:
    report = Report(shows=working)
    with report.stage("plan"):
        pass
    assert "planning" in screen.getvalue()
    assert report.stages["plan"] > 0


def test_a_stage_with_a_bar_of_its_own_gets_no_second_one(screen: io.StringIO) -> None:
    with Report(shows=working).stage("draw"):
        pass
    assert not screen.getvalue()


@pytest.mark.parametrize("screen", [False], indirect=True)
def test_nothing_is_shown_where_nobody_looks(screen: io.StringIO) -> None:
    with working("encoding 5 frames"), progress("drawing", 5) as advance:
        advance()
    assert not screen.getvalue().strip()
