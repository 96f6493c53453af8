"""Child processes: messages come whole or not at all, errors come back, and no child outlives its parent."""

import io
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine._child import Child, Message, Parent, command, end_soon_with_parent, packed, read_message, unpacked
from fapengine.errors import DataError, ResourceError
from tests.processes import start

HEADS = st.dictionaries(st.text(max_size=8), st.none() | st.integers() | st.text(max_size=20), max_size=4)
MESSAGES = st.lists(st.tuples(HEADS, st.binary(max_size=300)), max_size=5)
ME = "tests.unit.ground.test_child"
GONE_S = 300.0
"""Time after which the last test gives up."""


def main(parent: Parent) -> None:
    """Answer as the message says: the child of these tests."""
    for head, data in parent.messages():
        match head["do"]:
            case "echo":
                parent.tell({"niceness": os.nice(0), "pid": os.getpid()}, data)
            case "print":
                os.write(1, b"a library prints")
                print("and Python does", flush=True)
                parent.tell({})
            case "fail":
                raise DataError("bytes: got none", where="byte 7")
            case "end":
                os._exit(3)
            case "work":
                end_soon_with_parent()
                parent.tell({"pid": os.getpid()})
                time.sleep(3 * GONE_S)


@given(MESSAGES, st.integers(1, 400))
def test_messages_come_whole_in_pieces_of_any_length(sent: list[tuple[dict[str, object], bytes]], step: int) -> None:
    stream, received = b"".join(packed(*message) for message in sent), bytearray()
    found: list[object] = []
    for at in range(0, len(stream), step):
        received += stream[at : at + step]
        found += unpacked(received)
    assert found == sent
    assert not received


@given(HEADS, st.binary(max_size=30), st.data())
def test_a_message_that_is_cut_is_none(head: dict[str, object], data: bytes, draw: st.DataObject) -> None:
    whole = packed(head, data)
    cut = draw.draw(st.integers(0, len(whole) - 1))
    assert read_message(io.BytesIO(whole[:cut])) is None
    assert read_message(io.BytesIO(whole)) == (head, data)


def test_a_child_answers_whatever_is_printed_and_is_nicer() -> None:
    child = Child("child", command(ME, niceness=3))
    try:
        big = bytes(range(256)) * 20_000  # more than a pipe holds
        head, data = child.ask({"do": "echo"}, big)
        assert data == big
        assert head["niceness"] == min(os.nice(0) + 3, 19)
        assert os.getpgid(head["pid"]) == head["pid"]
        assert child.ask({"do": "print"}) == ({}, b"")
        os.kill(head["pid"], signal.SIGINT)
        assert child.ask({"do": "echo"}, b"still")[1] == b"still"
    finally:
        child.close()
    child.close()
    assert not child.is_alive
    with pytest.raises(EOFError):
        child.ask({"do": "echo"})


def test_its_errors_are_raised_as_they_are() -> None:
    child = Child("child", command(ME))
    try:
        with pytest.raises(DataError, match="bytes: got none") as caught:
            child.ask({"do": "fail"})
        assert caught.value.where == "byte 7"
        with pytest.raises(EOFError):
            child.ask({"do": "echo"})
    finally:
        child.close()


def test_without_waiting_it_is_heard_when_it_has_something_to_say() -> None:
    child = Child("child", command(ME), waits=False)
    try:
        big = bytes(3_000_000)
        found: list[Message] = []
        child.put({"do": "echo"}, big)
        child.put({"do": "end"})
        while not found:
            child.flush()
            found += child.poll()
            time.sleep(0.001)
        assert [data for _, data in found] == [big]
        child.process.wait()
        with pytest.raises(ResourceError, match=r"^child: its process has ended \(code 3\)"):
            child.poll()
    finally:
        child.close()


def test_a_program_that_is_not_there_is_a_resource_error() -> None:
    with pytest.raises(ResourceError, match="child: its process cannot be started: No such file"):
        Child("child", ["/nonexistent/python"])


@pytest.mark.parametrize("do", ["echo", "work"])
def test_it_ends_with_its_parent_however_that_ends(do: str) -> None:
    program = f"""
from fapengine._child import Child, command
child = Child("child", command({ME!r}))
print(child.ask({{"do": {do!r}}})[0]["pid"], flush=True)
input()
"""
    with start([sys.executable, "-c", program], stdin=-1, stdout=-1, text=True) as parent:
        assert parent.stdout is not None
        number = int(parent.stdout.readline())
        parent.kill()
        parent.wait()
        stop_s = time.monotonic() + GONE_S
        while _lives(number):
            assert time.monotonic() < stop_s
            time.sleep(0.005)


def _lives(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
