"""Fixtures, hypothesis profiles, and the guard against a suite that passes by not running."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"
# Programs: importing one of the first switches the compiler off, the second runs in an environment of its own.
collect_ignore = ["fuzz", "detector/landmarks.py"]
NO_SHARED, NO_BROWSER = "measurement data absent", "no Chromium on this machine"
NO_DETECTOR, NO_LLVMPIPE = "face detector absent", "pictures are drawn by something else than llvmpipe"
LEAVE = (NO_SHARED, NO_BROWSER, NO_DETECTOR, NO_LLVMPIPE)
"""The only reasons for which a test may be skipped."""

settings.register_profile(
    "ci", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("thorough", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measurement data beside the checkout; tests that use it carry the marker ``shared``."""
    if not SHARED.is_dir():
        pytest.skip(f"{NO_SHARED}: {SHARED}")
    return SHARED


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--at-least", type=int, default=0, help="fail unless so many tests ran (skips count for shared)")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "shared" in getattr(item, "fixturenames", ()) and item.get_closest_marker("shared") is None:
            raise pytest.UsageError(f"{item.nodeid}: uses the fixture `shared`, so it must carry the marker `shared`")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where fewer tests ran than promised, or where one was skipped for any reason but those of LEAVE."""
    wanted = session.config.getoption("--at-least")
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not wanted or reporter is None or hasattr(session.config, "workerinput"):
        return
    skipped = reporter.stats.get("skipped", [])
    strange = [report for report in skipped if not any(reason in str(report.longrepr) for reason in LEAVE)]
    ran = len(reporter.stats.get("passed", [])) + len(skipped) - len(strange)
    reporter.write_line("")
    if skipped:
        for reason in LEAVE:
            count = sum(reason in str(report.longrepr) for report in skipped)
            reporter.write_line(f"{count} tests skipped: {reason}")
    for report in strange:
        reporter.write_line(f"skipped without leave: {report.nodeid}: {report.longrepr}", red=True)
    if ran < wanted:
        reporter.write_line(f"only {ran} tests ran, expected at least {wanted}", red=True)
    if (strange or ran < wanted) and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
