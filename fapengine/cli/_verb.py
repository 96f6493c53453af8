"""What every verb gets: groups of options as values, and errors in the words of the command line.

Library code names parameters (``without: got 'ears'``, ``name one with tier=NAME``); here they become the options that
the user typed (``--without: got 'ears'``, ``name one with --tier NAME``).
"""

import functools
import inspect
import re
import textwrap
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

import typer

from fapengine.errors import DataError, FapEngineError, UsageError

ALIASES = {
    "path": "output", "rate_hz": "fps", "rate_wpm": "rate", "expressions": "expression", "sinks": "sink",
    "kbit_s": "kbps", "loudness_db": "loudness", "format": "log", "metrics_port": "metrics",
    "offset_s": "offset",
}  # fmt: skip
"""Library's names of parameters to those of the verbs, where they differ."""
at_end: ContextVar[Callable[[Callable[[], object]], object]] = ContextVar("at_end")
"""Takes what is to be called when the verb that runs has ended, well or not."""


def verb(function: Callable[..., None]) -> Callable[..., None]:
    """Make a function a verb.

    A parameter whose type is a dataclass becomes one option for each field, and the function gets the dataclass. Errors
    are raised again with the names of options in their messages.
    """
    parameters = [inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)]
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(function).parameters.values():
        if is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
            parameters += [_option(field) for field in fields(parameter.annotation)]
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    def run(context: typer.Context, **values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{field.name: values.pop(field.name) for field in fields(group)})
        at_end.set(context.call_on_close)
        try:
            function(**values)
        except FapEngineError as error:
            raise _reworded(error, _flags(context)) from error

    functools.update_wrapper(run, function)
    run.__doc__ = help_of(function.__doc__ or "")
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    vars(run).pop("__wrapped__")  # typer would read the function's own signature
    vars(run)["__signature__"] = inspect.Signature(parameters)
    return run


def help_of(docstring: str) -> str:
    r"""Make the help of a verb: paragraphs as wide as the terminal, indented ones (examples) line by line as they are.

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
    """Put options in the place of parameters.

    Parameters
    ----------
    text : str
        Message of an error.
    flags : mapping of str to str
        Parameter to option; ``name=False`` to the option that switches it off.
    names_parameter : bool
        Whether the message may begin with a parameter: ``"size: got ..."``.

    Examples
    --------
    >>> with_flags("size: got 3, expected edges=soft", {"size": "--size", "edges": "--edges"})
    '--size: got 3, expected --edges soft'
    """

    def option(match: re.Match[str]) -> str:
        name = ALIASES.get(match["name"], match["name"])
        if match[0] in flags:
            return flags[match[0]]
        return f"{flags[name]} {match['value']}" if name in flags else match[0]

    text = re.sub(r"\b(?P<name>[a-z_]+)=(?P<value>[A-Za-z]+)", option, text)
    name, colon, rest = text.partition(":")
    name = ALIASES.get(name, name)
    return f"{flags[name]}{colon}{rest}" if names_parameter and colon and name in flags else text


def _option(field: "Field[Any]") -> inspect.Parameter:
    default = field.default if field.default_factory is MISSING else field.default_factory()
    return inspect.Parameter(
        field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=field.type
    )  # fmt: skip


def _flags(context: typer.Context) -> dict[str, str]:
    """Parameter to option of the verb that runs; ``name=False`` to the option that switches it off."""
    flags: dict[str, str] = {}
    for parameter in context.command.params:
        if parameter.param_type_name == "option" and parameter.name:
            flags[parameter.name] = max(parameter.opts, key=len)
            if parameter.secondary_opts:
                flags[f"{parameter.name}=False"] = parameter.secondary_opts[0]
    return flags


def _reworded(error: FapEngineError, flags: Mapping[str, str]) -> FapEngineError:
    if isinstance(error, DataError):
        message = with_flags(error.message, flags, names_parameter=False)
        return type(error)(message, where=error.where, clause=error.clause)
    return type(error)(with_flags(str(error), flags, names_parameter=isinstance(error, UsageError)))
