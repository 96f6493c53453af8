"""An extension of griffe for mkdocs.yml: cross references of docstrings, ``:class:`Name```, as Markdown."""

import re
from typing import Any

import griffe

import fapengine

ROLE = re.compile(r":(?:class|func|meth|mod|data|attr):`([^`]+)`")


def as_markdown(text: str) -> str:
    """Replace each role by a link where the name is public, else by the name in code letters."""

    def link(match: re.Match[str]) -> str:
        target = match[1].lstrip("~.")
        parts = target.removeprefix("fapengine.").split(".")
        shown = parts[-1] if match[1][0] in "~." else target
        if parts[0] in fapengine.__all__:
            return f"[`{shown}`][fapengine.{'.'.join(parts)}]"
        return f"`{shown}`"

    return ROLE.sub(link, text)


class Roles(griffe.Extension):
    """Rewrites every docstring when it is read."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring:
            obj.docstring.value = as_markdown(obj.docstring.value)
