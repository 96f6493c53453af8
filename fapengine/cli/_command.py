"""What every command gets: groups of options as values, and errors that name options.

Library code names parameters (``without: got 'ears'``, ``name one with tier=NAME``); here they become options
(``--without: got 'ears'``, ``name one with --tier NAME``).
"""

import functools
import inspect
import re
import textwrap
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from contextvars import ContextVar
from dataclasses import MISSING, fields, is_dataclass
from math import isfinite
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import typer

from fapengine._strict_toml import Between, check_value
from fapengine.errors import DataError, FapEngineError, UsageError
from fapengine.files.provenance import provenance, signing
from fapengine.speaking import PROVENANCE, Described

MANNER = "Speech and motion"
"""Title of the options of :mod:`fapengine.speaking` in the help."""

ALIASES = {
    "path": ("output",), "rate_hz": ("fps",), "rate_wpm": ("wpm",), "expressions": ("expression",),
    "sinks": ("sink",), "kbit_s": ("kbps",), "loudness_db": ("loudness",), "format": ("log",),
    "edges": ("antialias",), "offset_s": ("offset",), "bus": ("nats",), "sound": ("audio", "play"),
}  # fmt: skip
"""Parameter names of the library to those of the commands, where they differ."""
_SIGN = inspect.Parameter(
    "sign",
    inspect.Parameter.KEYWORD_ONLY,
    default=None,
    annotation=Annotated[
        str | None,
        typer.Option(
            metavar="CERT,KEY",
            help="Sign images and films by C2PA (PNG, WebP, GIF, MP4, MOV): PEM files of the certificates and of the"
            " private key. The claim says that they are synthetic.",
        ),
    ],
)
"""Option of every command that writes marked files."""
running: ContextVar[typer.Context] = ContextVar("running")
"""The running command; its ``call_on_close`` registers what is done when it has ended, in success or failure."""


def command(function: Callable[..., None]) -> Callable[..., None]:
    """Make a command of a function.

    A parameter whose type is a dataclass becomes one option per field, and the function gets the dataclass. Errors are
    raised again with the names of options in their messages.
    """
    parameters = [inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)]
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(function).parameters.values():
        if is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
            for field in fields(parameter.annotation):
                default = field.default if field.default_factory is MISSING else field.default_factory()
                option = inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default)
                parameters.append(option.replace(annotation=field.type))
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    if {"output", "without"} <= {parameter.name for parameter in parameters}:
        parameters.append(_SIGN)
    kinds = {parameter.name: parameter.annotation for parameter in parameters}
    parameters = [_spelled(parameter) for parameter in parameters]

    def run(context: typer.Context, **values: Any) -> None:
        running.set(context)
        is_marked = PROVENANCE not in values.get("without", ())
        sign = values.pop(_SIGN.name, None)
        try:
            for name, value in values.items():
                values[name] = _checked(name, value, kinds[name])
            for name, group in groups.items():
                values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
            with provenance(is_marked), _signing(sign):
                function(**values)
        except FapEngineError as error:
            raise _reworded(error, flags_of(context)) from error

    functools.update_wrapper(run, function)
    run.__doc__ = help_of(function.__doc__ or "")
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    vars(run).pop("__wrapped__")  # typer would read the function's own signature
    vars(run)["__signature__"] = inspect.Signature(parameters)
    return run


def _signing(files: str | None) -> AbstractContextManager[None]:
    if files is None:
        return nullcontext()
    certificates, _, key = files.partition(",")
    if not (certificates and key):
        raise UsageError(f"sign: got {files!r}, expected two files, CERT,KEY")
    return signing(Path(certificates), Path(key))


def help_of(docstring: str) -> str:
    r"""Format a docstring as help: paragraphs are wrapped by the terminal, indented lines (examples) are kept.

    Examples
    --------
    >>> print(help_of("Say it.\n\n    say 1\n    say [2]\n\nLong\nprose."))
    Say it.
    <BLANKLINE>
    say 1
    say \[2]
    <BLANKLINE>
    Long prose.
    """
    paragraphs = inspect.cleandoc(docstring).replace("[", "\\[").split("\n\n")
    return "\n\n".join(
        textwrap.dedent(paragraph) if paragraph.startswith((" ", "fapengine ")) else paragraph.replace("\n", " ")
        for paragraph in paragraphs
    )


def with_flags(text: str, flags: Mapping[str, str], *, names_parameter: bool = True) -> str:
    """Replace parameter names by options.

    Parameters
    ----------
    text : str
        Error message.
    flags : mapping of str to str
        Option of each parameter; ``name=False`` has the option that switches it off.
    names_parameter : bool
        True if the message may begin with a parameter: ``"size: got ..."``.

    Examples
    --------
    >>> with_flags("size: got 3, expected edges=soft", {"size": "--size", "antialias": "--antialias"})
    '--size: got 3, expected --antialias soft'
    >>> with_flags("columns: got 'fps=nan'", {"columns": "--columns", "fps": "--fps"})
    "--columns: got 'fps=nan'"
    """

    def option(match: re.Match[str]) -> str:
        name = _own(match["name"], flags)
        if match[0] in flags:
            return flags[match[0]]
        return f"{flags[name]} {match['value']}" if name in flags else match[0]

    text = re.sub(r"(?<!')\b(?P<name>[a-z_]+)=(?P<value>'[^']*'|[A-Za-z]+)", option, text)
    name, colon, rest = text.partition(":")
    name = _own(name, flags)
    return f"{flags[name]}{colon}{rest}" if names_parameter and colon and name in flags else text


def _own(name: str, flags: Mapping[str, str]) -> str:
    """Name of the command's parameter for one of the library."""
    return next((each for each in (name, *ALIASES.get(name, ())) if each in flags), name)


def _checked(name: str, value: Any, kind: Any) -> Any:
    """Reject NaN, infinite numbers, and speaking options out of range."""
    if isinstance(value, float) and not isfinite(value):
        raise UsageError(f"{name}: got {value}, expected a finite number")
    if _described(kind) is None or value is None:
        return value
    value = tuple(value) if isinstance(value, list) else value
    check_value(name, value, kind)
    return value


def _described(kind: Any) -> Described | None:
    """Return the description of a speaking option; None for other annotations."""
    parts = [meta for each in (kind, *get_args(kind)) if get_origin(each) is Annotated for meta in get_args(each)[1:]]
    return next((meta for meta in parts if isinstance(meta, Described)), None)


def _spelled(parameter: inspect.Parameter) -> inspect.Parameter:
    """Convert a speaking option to an option of the command line; other parameters are unchanged."""
    kind = parameter.annotation
    described = _described(kind)
    if described is None:
        return parameter
    is_optional = NoneType in get_args(kind)
    if is_optional:
        kind = next(each for each in get_args(kind) if each is not NoneType)
    plain, *metas = get_args(kind)
    bounds = next((str(meta) for meta in metas if isinstance(meta, Between)), "")
    option = typer.Option(
        f"--{parameter.name}",
        *([described.short] if described.short else []),
        help=described.help.format(range=bounds, choices=", ".join(described.choices)),
        rich_help_panel=MANNER,
        autocompletion=_complete_voice if parameter.name == "voice" else _completion(described.choices),
    )
    plain, default = (list[str], list(parameter.default)) if plain == tuple[str, ...] else (plain, parameter.default)
    return parameter.replace(annotation=Annotated[plain | None if is_optional else plain, option], default=default)


def _completion(choices: tuple[str, ...]) -> Callable[[str], list[str]] | None:
    def complete(incomplete: str) -> list[str]:
        return [choice for choice in choices if choice.startswith(incomplete.lower())]

    return complete if choices else None


def _complete_voice(incomplete: str) -> list[tuple[str, str]]:
    """Voices whose codes begin so, each with its name, for shell completion."""
    from fapengine.errors import ResourceError
    from fapengine.voices.espeak import voices

    try:
        return [(code, name) for code, name in voices().items() if code.startswith(incomplete.lower())]
    except ResourceError:
        return []


def flags_of(context: typer.Context) -> dict[str, str]:
    """Return the option of each parameter of the running command, for :func:`with_flags`."""
    flags: dict[str, str] = {}
    for parameter in context.command.params:
        if parameter.param_type_name == "option" and parameter.name:
            flags[parameter.name] = max(parameter.opts, key=len)
            if parameter.secondary_opts:
                flags[f"{parameter.name}=False"] = parameter.secondary_opts[0]
            if getattr(parameter, "is_flag", False):
                flags[f"{parameter.name}=True"] = flags[parameter.name]
    return flags


def _reworded(error: FapEngineError, flags: Mapping[str, str]) -> FapEngineError:
    if isinstance(error, DataError):
        message = with_flags(error.message, flags, names_parameter=False)
        return type(error)(message, where=error.where, clause=error.clause)
    return type(error)(with_flags(str(error), flags, names_parameter=isinstance(error, UsageError)))
