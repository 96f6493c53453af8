"""Hook of mkdocs.yml: the page of the command line, from each command's options."""

from typing import Any

import typer
from mkdocs.structure.files import File, Files

from fapengine.cli.main import COMMANDS, app


def on_files(files: Files, config: Any) -> Files:
    """Add the page of the command line."""
    files.append(File.generated(config, "reference/cli.md", content=cli_page()))
    return files


def cli_page() -> str:
    """Write what ``--help`` says as Markdown."""
    root = typer.main.get_command(app)
    text = ["# Command line\n", "The help of each command, made when this site was built.\n"]
    text.append(
        "Exit codes: 0 success, 1 the data are wrong, 2 the call is wrong, 3 something is missing on this machine.\n"
    )
    for name in COMMANDS:
        command = root.get_command(None, name)  # type: ignore[attr-defined]
        text += _command(f"fapengine {name}", command)
    return "\n".join(text)


def _command(name: str, command: Any) -> list[str]:
    text = [f"## {name}\n", _paragraphs(command.help or ""), ""]
    rows = [_row(option) for option in command.params if not getattr(option, "hidden", False)]
    if rows:
        text += ["| option | default | meaning |", "|---|---|---|", *rows, ""]
    for inner_name, inner in getattr(command, "commands", {}).items():
        text += ["#" + line if line.startswith("## ") else line for line in _command(f"{name} {inner_name}", inner)]
    return text


def _paragraphs(text: str) -> str:
    """Click's marks of paragraphs that keep their lines become blocks of code."""
    parts = []
    for part in text.replace("\r", "").split("\n\n"):
        kept = part.lstrip("\n")
        parts.append(f"```text\n{kept[1:].strip(chr(10))}\n```" if kept.startswith("\b") else kept)
    return "\n\n".join(parts)


def _row(option: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
    if option.param_type_name == "argument":
        names = f"`{option.metavar or option.name.upper()}`"
    default = option.default
    shown = "" if not default or default is True or callable(default) else f"`{default}`"
    help_text = (getattr(option, "help", None) or "").replace("|", "\\|").replace("\n", " ")
    return f"| {names} | {shown} | {help_text} |"
