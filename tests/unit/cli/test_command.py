"""What every command gets: groups of options, and errors that name options."""

import re
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from importlib import import_module
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from fapengine.cli import head
from fapengine.cli._command import command, with_flags
from fapengine.cli._ending import EXIT_CODES, FAULT
from fapengine.cli.main import COMMANDS, app
from fapengine.errors import DataError, ResourceError, UsageError


@dataclass(frozen=True)
class Pair:
    size: Annotated[str, typer.Option("--size", "-s")] = "512"
    sink: Annotated[list[str], typer.Option("--sink")] = field(default_factory=list)


def invoke(function, *arguments: str) -> BaseException | None:
    runner = typer.Typer(pretty_exceptions_enable=False)
    runner.command()(command(function))
    result = CliRunner().invoke(runner, list(arguments))
    return None if isinstance(result.exception, SystemExit) else result.exception


def test_a_group_arrives_as_one_value() -> None:
    taken: list[object] = []

    def shout(text: str, pair: Pair, loud: Annotated[bool, typer.Option("--loud")] = False) -> None:
        """Shout."""
        taken.extend([text, pair, loud])

    assert invoke(shout, "hi", "-s", "64", "--sink", "a", "--sink", "b", "--loud") is None
    assert invoke(shout, "hi") is None
    assert taken == ["hi", Pair("64", ["a", "b"]), True, "hi", Pair(), False]


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (UsageError("size: got 3, expected 4"), "--size: got 3, expected 4"),
        (UsageError("sinks: got 3, expected 4"), "--sink: got 3, expected 4"),
        (UsageError("text: got '', expected words"), "text: got '', expected words"),
        (
            DataError("size: got 3; name it with size=PIXELS", where="x"),
            "size: got 3; name it with --size PIXELS (at x)",
        ),
        (ResourceError("size: too much, or loud=False"), "size: too much, or --quiet"),
        (UsageError("level=fine is no option here"), "level=fine is no option here"),
    ],
)
def test_errors_name_options(error: Exception, message: str) -> None:
    def fail(text: str, pair: Pair, loud: Annotated[bool, typer.Option("--loud/--quiet")] = True) -> None:
        raise error

    raised = invoke(fail, "hi")
    assert type(raised) is type(error)
    assert str(raised) == message
    assert raised.__cause__ is error


def test_only_whole_names_are_replaced() -> None:
    assert with_flags("up: got a size of 3, resize=BIG", {"size": "--size"}) == "up: got a size of 3, resize=BIG"


def test_every_command_rewords_its_errors() -> None:
    """Even those that have no group of options."""
    group: Any = typer.main.get_command(app)
    alone = {name: group.get_command(None, name) for name in COMMANDS}
    every = [*(each for name, each in alone.items() if name != "head"), *alone["head"].commands.values()]
    assert len(every) == len(COMMANDS) + 2
    for each in every:
        assert each.callback.__wrapped__.__code__.co_filename.endswith("_command.py"), each.name


def test_a_command_imports_no_other() -> None:
    program = (
        "import sys; from fapengine.cli.main import app; app(['say', '--help'], standalone_mode=False);"
        "print(*(name for name in sys.modules if name.startswith('fapengine.cli.')), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    found = done.stderr.split()
    assert "fapengine.cli.say" in found
    assert not {f"fapengine.cli.{name}" for name in COMMANDS if name != "say"} & set(found)


FUNCTIONS = {
    name: getattr(import_module(f"fapengine.cli.{name}"), name) for name in COMMANDS if name not in ("doctor", "head")
} | {"head import": head.import_head, "head export": head.export, "head check": head.check}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_help_shows_examples_that_can_be_copied(name: str) -> None:
    """One a line, whole on a terminal of 80 columns, brackets and all."""
    lines = [line.strip() for line in FUNCTIONS[name].__doc__.splitlines()]
    examples = [line for line in lines if line.startswith("fapengine ")]
    shown = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "80"}).output.splitlines()
    assert examples[0].startswith(f"fapengine {name}")
    assert set(examples) <= {line.strip() for line in shown}


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS) - {"serve", "agent"}))  # which run until they are stopped
def test_what_a_command_does_can_be_had_as_json(name: str) -> None:
    assert "--json" in CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "80"}).output


def test_help_says_what_exit_codes_mean() -> None:
    shown = " ".join(CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200"}).output.split())
    for code in [code for _, code in EXIT_CODES] + [FAULT, 128 + signal.SIGINT]:
        assert re.search(rf"[ :]{code}\b", shown[shown.index("Exit codes:") :])
