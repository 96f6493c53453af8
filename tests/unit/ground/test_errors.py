import pickle

import pytest

from fapengine import errors
from fapengine._resources import profile_files, profile_ids, shader_source


def test_message_says_what_where_and_clause() -> None:
    error = errors.ConformanceError("marker bit: got 0, expected 1", where="byte 7, bit 3", clause="6.2.10")
    assert str(error) == "marker bit: got 0, expected 1 (at byte 7, bit 3; 6.2.10)"
    assert str(errors.DataError("empty file")) == "empty file"


def test_errors_cross_a_process_border_whole() -> None:
    error = pickle.loads(pickle.dumps(errors.TruncatedError("short", where="byte 3")))
    assert type(error) is errors.TruncatedError
    assert (error.message, error.where) == ("short", "byte 3")


def test_the_tree() -> None:
    for kind in (errors.TruncatedError, errors.ConformanceError, errors.UnsupportedError, errors.ProfileError):
        assert issubclass(kind, errors.DataError)
    assert issubclass(errors.DataError, ValueError)
    assert issubclass(errors.ResourceError, RuntimeError)


def test_resources_name_what_they_have() -> None:
    assert profile_ids()
    with pytest.raises(errors.UsageError, match="unknown"):
        profile_files("no-such-profile")
    with pytest.raises(errors.UsageError, match="unknown"):
        shader_source("no-such.vert")
