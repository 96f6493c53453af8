"""Fixtures, hypothesis profiles, and the guard against a suite that passes by not running."""

import gc
import os
import sys
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from tests import queues, slow_tests, sound_card

SHARED = Path(os.environ.get("FAPENGINE_SHARED", Path(__file__).resolve().parent.parent.parent / "shared"))
"""Folder of measurement data; a name that does not exist shows what a clone without them runs."""
# Programs: importing one of the first switches the compiler off, the second runs in an environment of its own.
collect_ignore = ["fuzz", "detector/landmarks.py", "oracles/pages"]
NO_SHARED, NO_BROWSER = "measurement data absent", "no Chromium on this machine"
NO_DETECTOR, NO_LLVMPIPE = "face detector absent", "pictures are drawn by something else than llvmpipe"
NO_COMPILER = "no C compiler on this machine"
LEAVE = (NO_SHARED, NO_BROWSER, NO_DETECTOR, NO_LLVMPIPE, NO_COMPILER)
"""The only reasons for which a test may be skipped."""

NIGHTLY = {"nightly": 0}
"""Number of tests with the marker ``nightly`` among those that were collected."""

os.environ["FAPENGINE_CACHE"] = str(Path(__file__).resolve().parent.parent / "out" / "cache")  # not the user's own
os.environ["FAPENGINE_RENDERER"] = "gl"  # also where fapengine-native is installed; tests/native use both

settings.register_profile(
    "ci", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("thorough", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(scope="module", autouse=True)
def _same_sound() -> None:
    """Let no file's tests decide how espeak-ng sounds in the next file: it is loaded again, and its pitch set back."""
    if espeak := sys.modules.get("fapengine.voices.espeak"):
        espeak._second_dictionaries.clear()


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measurement data beside the checkout; tests that use it carry the marker ``shared``."""
    if not SHARED.is_dir():
        pytest.skip(f"{NO_SHARED}: {SHARED}")
    return SHARED


@pytest.fixture(scope="session")
def null_sink(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mapping[str, str]]:
    """Environment of a process that plays to nobody."""
    with sound_card.null_sink(tmp_path_factory.mktemp("pulse")) as environment:
        yield environment


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Give ``--dist loadfile`` its two queues."""
    return queues.TwoQueues(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--at-least", type=int, default=0, help="fail unless so many tests ran (skips count for shared)")
    parser.addoption(
        "--write-slow",
        action="store_true",
        help=f"measure the tests that run, and list in {slow_tests.LIST.name} which are slow",
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--write-slow"):
        config.pluginmanager.register(slow_tests.Meter())


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Find the tests, each worker more than 10,000, without the garbage collector, which looks at them only once."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    slow = slow_tests.listed()
    nightly = [item.nodeid for item in items if item.get_closest_marker("nightly")]
    getattr(config, "workeroutput", NIGHTLY)["nightly"] = len(nightly)
    for item in items:
        if queues.waits(item.nodeid):
            item.add_marker("waits")
        if not slow.isdisjoint(slow_tests.names(item.nodeid)):
            item.add_marker("slow")
        if "shared" in getattr(item, "fixturenames", ()) and item.get_closest_marker("shared") is None:
            raise pytest.UsageError(f"{item.nodeid}: uses the fixture `shared`, so it must carry the marker `shared`")
        if item.get_closest_marker("shared") and item.get_closest_marker("conformance"):
            raise pytest.UsageError(f"{item.nodeid}: a test of conformance must run in every clone, without `shared`")


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """Learn from a worker how many tests are left to make nightly."""
    NIGHTLY.update({"nightly": getattr(node, "workeroutput", {}).get("nightly", 0)})


def _has_leave(report: pytest.TestReport) -> bool:
    return "conformance" not in report.keywords and any(reason in str(report.longrepr) for reason in LEAVE)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail where a test of conformance was skipped, another without leave, or where fewer ran than promised."""
    wanted = session.config.getoption("--at-least")
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or hasattr(session.config, "workerinput"):
        return
    skipped = reporter.stats.get("skipped", [])
    strange = [report for report in skipped if not _has_leave(report) and (wanted or "conformance" in report.keywords)]
    ran = len(reporter.stats.get("passed", [])) + len(skipped) - len(strange)
    reporter.write_line("")
    if skipped and wanted:
        for reason in LEAVE:
            count = sum(reason in str(report.longrepr) for report in skipped)
            reporter.write_line(f"{count} tests skipped: {reason}")
    if NIGHTLY["nightly"] and "not nightly" in session.config.getoption("markexpr"):
        reporter.write_line(f"{NIGHTLY['nightly']} tests left to make nightly")
    for report in strange:
        reporter.write_line(f"skipped without leave: {report.nodeid}: {report.longrepr}", red=True)
    if ran < wanted:
        reporter.write_line(f"only {ran} tests ran, expected at least {wanted}", red=True)
    if (strange or ran < wanted) and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
