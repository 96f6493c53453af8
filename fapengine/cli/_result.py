"""Result of a command, printed as text or as JSON."""

import json
from collections.abc import Mapping

import typer


def print_result(facts: Mapping[str, object], words: str, *, as_json: bool, err: bool = False) -> None:
    """Print the result as text, or its facts as one line of JSON.

    ``err`` prints to standard error, for when the file itself goes to standard output.
    """
    typer.echo(json.dumps(facts, ensure_ascii=False) if as_json else words, err=err)
