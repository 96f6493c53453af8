"""Kinds that are rows of a table: what their rows cannot write themselves, such as pages and types of other languages,
names every one of them.

After a new expression, its name is put into all lists of expressions by::

    python -m tests.architecture.test_registries
"""

import inspect
import re
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

import fapengine
from fapengine._strict_toml import Between
from fapengine.app.inspection.kinds import FILE_KINDS
from fapengine.app.manner import manner_of, voice_of
from fapengine.batch.rows import Options
from fapengine.cli._ending import EXIT_CODES
from fapengine.cli.main import app
from fapengine.engine.commands import Express, Look, expression_named
from fapengine.engine.engine import Engine
from fapengine.expressions import EXPRESSION_NAMES, EXPRESSIONS, STANDARD_EXPRESSIONS, Expression
from fapengine.files.profiles import load_profile
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FAP_2_EXPRESSIONS
from fapengine.mpeg4.track import to_codable
from fapengine.server.config import ServerConfig
from fapengine.server.sinks.kinds import SINK_KINDS, SinkKind
from fapengine.speaking import GENERATORS, Described, SpeakingOptions
from fapengine.speech.formats.registry import FORMATS
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.gestures import CHANNELS, Channel
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice

ROOT = Path(__file__).resolve().parents[2]
FIRST_NAMES = re.compile(r"\bjoy\W{1,6}sadness\W{1,6}anger\b")
"""The beginning of a list of all expressions, whatever stands between the names."""
PICTURED = re.compile(r"^!\[.*$", re.MULTILINE)
"""Texts of pictures, which say what is in them."""
LIST = re.compile(r"\bjoy(\W{1,6})sadness\1anger\b(?:\1\w+)*")
"""A list of all expressions, with the same between each two names."""
FEWER = {
    "docs/retargeting.md": "what a rig's moods are read from: the standard's six",
    "docs/face.md": "what a detector was measured on",
    "docs/measurements.md": "what a detector was measured on",
}
"""Pages that list some of the expressions, and why not all."""


def test_expressions_of_the_standard_have_its_numbers_and_names() -> None:
    assert [expression.label for expression in (Expression.NEUTRAL, *STANDARD_EXPRESSIONS)] == list(FAP_2_EXPRESSIONS)
    assert [int(expression) for expression in EXPRESSIONS] == list(range(1, len(EXPRESSIONS) + 1))


def test_an_expression_has_a_mix_exactly_if_it_is_our_own() -> None:
    assert [expression for expression in EXPRESSIONS if expression.mix is None] == list(STANDARD_EXPRESSIONS)


def test_no_two_expressions_share_a_name() -> None:
    names = [name for each in EXPRESSIONS for name in (each.label, *each.synonyms)] + ["neutral", "none"]
    assert len(names) == len(set(names))
    assert all(expression_named(name) is Expression[name.upper()] for name in EXPRESSION_NAMES)


def test_ramps_of_gestures_begin_after_those_of_expressions() -> None:
    assert sorted([*range(len(EXPRESSIONS)), *Channel]) == list(range(CHANNELS))


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_a_live_face_shows_every_expression(expression: Expression) -> None:
    shown = _live(Express(expression, 1.0))
    expected = to_codable(expression_faps(load_profile("grid_s1_en")).T)[EXPRESSIONS.index(expression)]
    free = [column for column in range(2, fap.FAP_COUNT) if column + 1 not in CLOSING]
    np.testing.assert_allclose(shown[free], expected[free], atol=1.0)
    assert np.abs(expected[free]).max() > 50


def test_a_glance_shows_no_expression() -> None:
    shown = _live(Look(0.3, 0.0))
    assert set(np.flatnonzero(shown) + 1) == {23, 24}


CLOSING = (3, 4, 5, 8, 9, 10, 11, 51, 52, 55, 56, 57, 58)
"""FAPs of the jaw and the lips, which rules of contact may change."""


def _live(command: Express | Look) -> np.ndarray:
    """(68,) FAPU that a still face shows 2 s after a command."""
    engine = Engine(load_profile("grid_s1_en"), rng=np.random.default_rng(1), style=Style.speech_only())
    engine.open("a", 0.0)
    engine.apply("a", command, 0.0)
    return [np.asarray(engine.frame(time_s).faps)[0] for time_s in np.arange(0, 2, 1 / 30)][-1]


def _texts() -> dict[str, str]:
    paths = [ROOT / "README.md", ROOT / "fapengine-face" / "README.md", ROOT / "fapengine-face" / "index.d.ts"]
    paths += sorted((ROOT / "docs").rglob("*.md"))
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def test_a_text_that_lists_expressions_lists_all() -> None:
    lists = 0
    for name, text in _texts().items():
        for found in FIRST_NAMES.finditer(PICTURED.sub("", text)):
            rest = PICTURED.sub("", text)[found.start() : found.start() + 300]
            missing = [each for each in EXPRESSION_NAMES if not re.search(rf"\b{each}\b", rest)]
            assert not missing or name in FEWER, f"{name}: {rest[:60]!r} lacks {missing}"
            lists += not missing
    assert lists >= 4  # the types and README of the web component, the page's and the OSC messages


def write_expressions() -> None:
    """Put every expression into the lists of all."""
    for name, text in _texts().items():
        if name not in FEWER:
            written = LIST.sub(lambda found: found[1].join(EXPRESSION_NAMES), text)
            if written != text:
                (ROOT / name).write_text(written, encoding="utf-8")


def test_the_types_of_the_web_component_are_the_expressions() -> None:
    (union,) = re.findall(r"export type Expression =([^;]*);", _texts()["fapengine-face/index.d.ts"])
    assert re.findall(r'"(\w+)"', union) == list(EXPRESSION_NAMES)


@pytest.mark.parametrize("module", ["index", "arkit", "live/index", "words-en/index"])
def test_the_types_of_the_web_component_are_what_there_is(module: str) -> None:
    text, types = (
        (ROOT / "fapengine-face" / f"{module}{ending}").read_text(encoding="utf-8") for ending in (".js", ".d.ts")
    )
    listed = [name.strip() for names in re.findall(r"^export \{(.*?)\}", text, re.M) for name in names.split(",")]
    own = re.findall(r"^export (?:class|function|const) (\w+)", text, re.M)
    assert sorted(listed + own) == sorted(re.findall(r"^export (?:class|function|const) (\w+)", types, re.M))


@pytest.mark.parametrize("kind", SINK_KINDS, ids=lambda kind: kind.name)
def test_a_page_has_a_row_for_every_sink_and_names_its_options(kind: SinkKind) -> None:
    pages = [text for name, text in _texts().items() if f"| `{kind.spelled}` |" in text]
    assert pages, f"no table of docs/ has a row that begins | `{kind.spelled}` |"
    for option in kind.options:
        assert any(re.search(rf"\b{option}=", page) for page in pages), f"{option} of {kind.name}"


@pytest.mark.parametrize(("command", "all_kinds"), [("serve", True), ("say", False), ("capture", False)])
def test_the_help_of_a_command_lists_every_sink_that_it_takes(command: str, *, all_kinds: bool) -> None:
    printed = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output
    words = "".join(printed.replace("│", "").split())
    expected = [kind.spelled for kind in SINK_KINDS if all_kinds or kind.medium == "datagrams"]
    assert [each for each in expected if each not in words] == []
    assert len(expected) >= (13 if all_kinds else 7)


SPEAKING = {field.name: field for field in fields(SpeakingOptions)}
LEFT_OUT = {
    ("animate", "voice"): "it has its own: only timings of words are pronounced",
    ("animate", "wpm"): "nothing is spoken by a voice",
    ("animate", "ssml"): "there is no text of SSML",
    ("serve", "expression"): "expressions come with messages",
    ("config", "expression"): "expressions come with messages",
}
"""Options of speaking that a place does not have, and why."""
OTHERWISE = {("serve", "fps"), ("config", "fps")}
"""Defaults that differ: a live face moves at 60 Hz, a video at 30."""


def _command(name: str) -> Any:
    return get_command(app).get_command(None, name)


def _options(command: str) -> dict[str, Any]:
    return {option.name: option for option in _command(command).params}


def _metas(kind: Any) -> tuple[Any, ...]:
    return tuple(
        meta for each in (kind, *get_args(kind)) if get_origin(each) is Annotated for meta in get_args(each)[1:]
    )


def test_reasons_are_given_for_options_that_there_are() -> None:
    assert {name for _, name in (*LEFT_OUT, *OTHERWISE)} <= set(SPEAKING)
    assert all(isinstance(_described(field.type), Described) for field in SPEAKING.values())
    assert len(SPEAKING) >= 13


@pytest.mark.parametrize("name", SPEAKING)
@pytest.mark.parametrize("command", ["say", "animate", "serve"])
def test_commands_that_speak_have_every_option_of_speaking(command: str, name: str) -> None:
    option, described = _options(command).get(name), _described(SPEAKING[name].type)
    if (command, name) in LEFT_OUT:
        assert option is None or described.help.split(",")[0] not in option.help
        return
    assert option is not None
    assert option.help.startswith(described.help.partition("{")[0])
    assert described.short is None or described.short in option.opts
    if command != "serve":  # there None leaves the configuration as it is
        default = SPEAKING[name].default
        assert option.default == (list(default) if isinstance(default, tuple) else default)


@pytest.mark.parametrize("name", SPEAKING)
def test_a_table_of_batch_has_a_column_for_every_option_of_speaking(name: str) -> None:
    columns = {field.name: field for field in fields(Options)}
    assert columns[name].type == SPEAKING[name].type
    assert columns[name].default == SPEAKING[name].default


@pytest.mark.parametrize("name", SPEAKING)
def test_a_configuration_has_a_key_for_every_option_of_speaking(name: str) -> None:
    described = _described(SPEAKING[name].type)
    assert (described.config is None) is (("config", name) in LEFT_OUT)
    if described.config is None:
        return
    table, _, key = described.config.partition(".")
    section = getattr(ServerConfig(), table)
    if name == "without":
        assert all(getattr(section, generator) is True for generator in GENERATORS)
        return
    assert (getattr(section, key) == SPEAKING[name].default) is (("config", name) not in OTHERWISE)
    low, high = _range(SPEAKING[name].type)
    if low is not None:
        for value in (low - 1, high + 1, float("nan")):
            with pytest.raises(fapengine.UsageError, match=f"^{key}: (got|must)"):
                type(section)(**{key: value})
        assert getattr(type(section)(**{key: type(section.__getattribute__(key))(low)}), key) == low


@pytest.mark.parametrize("name", SPEAKING)
def test_python_has_every_option_of_speaking(name: str) -> None:
    where, _, key = _described(SPEAKING[name].type).python.partition(".")
    place = {"Style": Style, "VoiceChoice": VoiceChoice, "speak": fapengine.speak}[where]
    default = SPEAKING[name].default
    if where == "speak":
        assert inspect.signature(place).parameters[key].default == default
    elif name != "without":
        assert getattr(place(), key) == default
    else:
        assert Style().without(["all"]) == Style.speech_only()


@pytest.mark.parametrize("name", SPEAKING)
def test_an_option_of_speaking_changes_how_a_text_is_spoken(name: str) -> None:
    field = SPEAKING[name]
    low, _ = _range(field.type)
    choices = _described(field.type).choices
    numbers = [low] if low is not None else []
    texts = [tuple(choices[:1]) if isinstance(field.default, tuple) else each for each in choices or ("another",)]
    others = [not field.default] if isinstance(field.default, bool) else numbers or texts
    (other, *_) = [each for each in others if each != field.default]
    changed = SpeakingOptions(**{name: other})
    assert (manner_of(changed), voice_of(changed)) != (manner_of(SpeakingOptions()), voice_of(SpeakingOptions()))


def _described(kind: Any) -> Any:
    return next(meta for meta in _metas(kind) if isinstance(meta, Described))


def _range(kind: Any) -> tuple[Any, Any]:
    return next(((meta.low, meta.high) for meta in _metas(kind) if isinstance(meta, Between)), (None, None))


NOT_FINITE = ("nan", "inf", "-inf")
HUGE = {int: ("-1000000000", "1000000000"), float: ("-1e9", "1e9")}
ENOUGH = {"head": [], "say": ["Hi.", "-o", "a.fap"], "serve": ["--config", "absent.toml"], "view": ["absent.fap"]}
"""What a command needs besides, so that it ends at once where a number is allowed."""


def _leaves(annotation: Any) -> list[Any]:
    """The types of which an annotation consists."""
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    parts = get_args(annotation)
    return [leaf for part in parts for leaf in _leaves(part)] if parts else [annotation]


def _numbers() -> list[Any]:
    """Every option of every command that takes a number, with the command and the kind of number."""
    found = []

    def walk(command: Any, path: tuple[str, ...]) -> None:
        for name in command.list_commands(None) if hasattr(command, "list_commands") else ():
            walk(command.get_command(None, name), (*path, name))
        parameters = inspect.signature(command.callback).parameters if command.callback else {}
        for option in command.params:
            kinds = _leaves(parameters[option.name].annotation) if option.name in parameters else ()
            name = f"{' '.join(path)} {option.opts[0]}"
            found.extend(pytest.param(path, option, kind, id=name) for kind in (int, float) if kind in kinds)

    walk(get_command(app), ())
    assert len(found) >= 40
    return found


@pytest.mark.parametrize(("path", "option", "kind"), _numbers())
def test_a_number_of_the_command_line_is_bounded(
    path: tuple[str, ...], option: Any, kind: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    needed = [word for each in _command(path[0]).params if each.required for word in _given(each)]
    for spelled in (*NOT_FINITE, *HUGE[kind]):
        words = [*path, f"{option.opts[0]}={spelled}", *(ENOUGH.get(path[0]) or needed)]
        result = CliRunner().invoke(app, words)
        if isinstance(result.exception, SystemExit) or result.exception is None:
            code, said = result.exit_code, result.output
        else:
            code = next((code for error, code in EXIT_CODES if isinstance(result.exception, error)), 70)
            said = str(result.exception)
        assert code in (0, 1, 2, 3), f"{words}: {result.exception!r}"
        if spelled in NOT_FINITE or (kind is float and spelled.startswith("-")):
            assert code == 2, words
            assert option.opts[0].lstrip("-") in said.replace("\n", ""), said


def _given(parameter: Any) -> list[str]:
    return ["-o", "out"] if parameter.param_type_name == "option" else ["absent"]


def test_the_help_of_inspect_names_every_kind_of_file() -> None:
    (path,) = (each for each in _command("inspect").params if each.name == "path")
    assert [kind.name for kind in FILE_KINDS if kind.name not in path.help.replace(" or a head", ", a head")] == []
    assert len({kind.name for kind in FILE_KINDS}) == len(FILE_KINDS) >= 11


def test_the_page_of_timing_formats_has_every_format() -> None:
    page = _texts()["docs/timing-formats.md"]
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    assert [name for name in FORMATS if not any(f"`{name}`" in row.split("|")[1] for row in rows)] == []
    assert f" of {len(FORMATS)} of them" in page


if __name__ == "__main__":
    write_expressions()
