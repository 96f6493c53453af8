"""Licence notice of ICT-FaceKit, required in copies of its shapes; the built-in heads are derived from them."""

from importlib.resources import files

ICT_COPYRIGHT = "shapes derived from ICT-FaceKit, Copyright (c) 2020 USC Institute for Creative Technologies, MIT"
"""Short form, for fields of one line."""
ICT_NOTICE = (files("fapengine.retarget") / "ict_notice.txt").read_text("utf-8").rstrip()
"""What its licence asks copies to contain; the same as in the file NOTICE."""


def copyright_line(source: str, licence: str) -> str:
    """Source, licence and the notice in one line; the parts of a licence that is one already are not repeated.

    Examples
    --------
    >>> copyright_line("a.glb", "CC_BY; Ada") == f"a.glb; CC_BY; Ada; {ICT_COPYRIGHT}"
    True
    """
    return "; ".join(dict.fromkeys((source, *licence.split("; "), ICT_COPYRIGHT)))
