"""Feature points out of Xface's and Visage's files, in files of our own making in their shapes."""

from pathlib import Path

import numpy as np
import pytest

from fapengine.errors import DataError, UnsupportedError
from fapengine.files.heads.tables import is_fdp, load_feature_points, parse_fdp

XFACE = b"""<?xml version="1.0" encoding="UTF-8" standalone="no" ?>
<xfdp>
  <!--a face of ours-->
  <head><file version="0.2"/><fapu ENS0="51" ES0="69" IRISD0="16" MNS0="30" MW0="50"/></head>
  <source><entity alias="Rest" category="Expression"><mesh file="face.wrl" format="wrl"/></entity></source>
  <fdp affects="face.wrl_3" index="2" name="2.1">
    <indices>0 1 2</indices><influence fap="2" type="RaisedCosInfluenceSph" weight="0.3"/>
  </fdp>
  <fdp affects="face.wrl_3" index="0" name="8.1"><indices>0</indices></fdp>
  <fdp affects="face.wrl_1" index="19" name="3.5"><indices>0 1</indices></fdp>
  <fdp affects="face.wrl_1" index="7" name="2.1"><indices>0 1</indices></fdp>
</xfdp>
"""
SECOND = b'<fdp affects="face.wrl_1" index="20" name="3.6"/>'
VISAGE = (
    b"1.0 face 0 0 0 0 0 0\n# chin\n2.1 0.0 -60.5 40 0.2\n\n8.1 0 -30 45 0.0 # lip\n3.5 1 2 3 1.19\n2.1 0 -60 39 1.7\n"
    b"NUL 0\nrest"
)


@pytest.mark.parametrize("data", [XFACE, b"\xef\xbb\xbf" + XFACE.partition(b"\n")[2], VISAGE])
def test_points_of_the_submesh_with_most_are_read(data: bytes) -> None:
    assert is_fdp(data)
    assert parse_fdp(data) == ("0" if data is VISAGE else "face.wrl_3", {"2.1": 2, "8.1": 0})
    more = data.replace(b"3.5 1 2 3 1.19", b"3.5 1 2 3 1.19\n3.6 1 2 3 1.20").replace(b"</xfdp>", SECOND + b"</xfdp>")
    assert parse_fdp(more)[1].keys() == {"2.1", "3.5", "3.6"}


def test_an_import_takes_the_points_of_the_skin(tmp_path: Path) -> None:
    path = tmp_path / "face.fdp"
    path.write_bytes(XFACE)
    assert load_feature_points(path, np.zeros((3, 3)), np.array([[0, 1, 2]])) == {"2.1": 2, "8.1": 0}
    with pytest.raises(DataError, match=r"vertex 2 of 'face.wrl_3': got a mesh of 2 vertices"):
        load_feature_points(path, np.zeros((2, 3)), np.array([[0, 1, 1]]))


@pytest.mark.parametrize(
    ("data", "kind", "message"),
    [
        (XFACE.replace(b'"2.1"', b'"8.1"'), DataError, "point: got '8.1'"),
        (XFACE.replace(b'"2.1"', b'"2.99"'), DataError, "point: got '2.99'"),
        (XFACE.replace(b'index="2"', b'index="-2"'), DataError, "vertex: got '-2'"),
        (XFACE[:300], DataError, "no XML here"),
        (b"<xfdp></xfdp>", DataError, "contains no feature point"),
        (b"<html><xfdp/></html>", DataError, "got <html>"),
        (b'<!DOCTYPE a [<!ENTITY b "c">]><xfdp/>', UnsupportedError, "entities"),
        (VISAGE.replace(b"0.2\n", b"\n"), DataError, "expected POINT x y z SURFACE.VERTEX"),
        (b"1.0 \xff\n", DataError, "is not text"),
    ],
)
def test_what_is_wrong_is_named(data: bytes, kind: type[DataError], message: str) -> None:
    with pytest.raises(kind, match=message):
        parse_fdp(data)
