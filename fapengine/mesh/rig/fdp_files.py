"""Feature points of other programs' faces: Xface's ``.fdp`` (XML) and Visage's (text).

Supported layouts::

    <xfdp><fdp affects="SUBMESH" index="VERTEX" name="2.1">...</fdp></xfdp>

    1.0 MODEL r r r t t t
    2.1 x y z SURFACE.VERTEX
    NUL 0

Xface counts the vertices of each submesh from 0. Its units, regions and weights are ignored: units are measured, and
how skin follows a point is determined from the mesh (:func:`fapengine.mesh.rig.parts.fit_point_fields`).
"""

from xml.etree import ElementTree

from fapengine.errors import DataError, UnsupportedError
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES

Points = dict[str, dict[str, int]]
"""Vertex by feature point, by submesh: the chin's point may also move the teeth."""


def is_fdp(data: bytes) -> bool:
    """Detect an ``.fdp`` file of either kind by its first bytes."""
    head = data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    return (head.startswith(b"<") and b"<xfdp" in head) or head.startswith(b"1.0 ")


def parse_fdp(data: bytes) -> tuple[str, dict[str, int]]:
    """Read an ``.fdp`` file of either kind: the submesh with the most points, and the vertex of each of its points.

    Raises
    ------
    DataError
        If it is neither, or contains no point.
    UnsupportedError
        For XML with entities.
    """
    points = _xface(data) if data.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") else _visage(data)
    if not points:
        raise DataError("fdp: contains no feature point")
    skin = max(points, key=lambda submesh: len(points[submesh]))
    return skin, points[skin]


def _xface(data: bytes) -> Points:
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise UnsupportedError("fdp: got a document type or entities, expected none")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DataError(f"fdp: is not XML ({error})") from error
    if root.tag != "xfdp":
        raise DataError(f"fdp: got <{root.tag[:40]}>, expected <xfdp>")
    points: Points = {}
    for number, entry in enumerate(root.iter("fdp"), start=1):
        where = f"fdp {number}"
        vertex = _whole(entry.get("index", ""), where)
        _add(points, entry.get("name", ""), entry.get("affects", ""), vertex, where)
    return points


def _visage(data: bytes) -> Points:
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise DataError(f"fdp: is not text ({error})") from error
    points: Points = {}
    for number, line in enumerate(lines[1:], start=2):
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] == "NUL":
            break
        where = f"line {number}"
        surface, dot, vertex = words[4].partition(".") if len(words) == 5 else ("", "", "")
        if not dot:
            raise DataError(f"got {line[:60]!r}, expected POINT x y z SURFACE.VERTEX", where=where)
        _add(points, words[0], surface, _whole(vertex, where), where)
    return points


def _add(points: Points, name: str, submesh: str, vertex: int, where: str) -> None:
    if name not in FEATURE_POINT_NAMES or name in points.get(submesh, ()):
        raise DataError(f"point: got {name[:40]!r}, expected a point such as 8.2, once per submesh", where=where)
    points.setdefault(submesh, {})[name] = vertex


def _whole(text: str, where: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise DataError(f"vertex: got {text[:40]!r}, expected a number from 0", where=where)
    return int(text)
