"""A voice in a process of its own: reads requests from standard input, writes what it spoke to standard output.

A message is its length (8 bytes, big-endian) and a pickle; both ends are one program. The process ends with its input,
so it does not outlive the one that asks, whatever ends that. :class:`fapengine.live.server.voice_process.VoiceProcess`
is the other end.
"""

import contextlib
import os
import pickle
import signal
import struct
import sys
from typing import BinaryIO

from fapengine.errors import FapEngineError
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import catalogue

LENGTH = struct.Struct(">Q")
NICENESS = 5
"""Faces go before voices."""


def packed(message: object) -> bytes:
    """Write a message."""
    data = pickle.dumps(message)
    return LENGTH.pack(len(data)) + data


def answer(stdin: BinaryIO, stdout: BinaryIO, *, afresh: bool = False) -> None:
    """Speak what is asked for until the input ends: (text, choice, seconds at most) in, speech or error out.

    ``afresh``: each text by a process that has not spoken yet, a copy of this one, or this one, which then ends.
    """
    while len(head := stdin.read(LENGTH.size)) == LENGTH.size:
        data = stdin.read(LENGTH.unpack(head)[0])
        text, choice, most_s = pickle.loads(data)
        child = os.fork() if afresh and hasattr(os, "fork") else 0
        if child:
            if os.waitpid(child, 0)[1]:
                return  # the library ended it: who asked finds the end of our output
            continue
        stdout.write(packed(_spoken(text, choice, most_s)))
        stdout.flush()
        if afresh:
            os._exit(0)


def _spoken(text: str, choice: VoiceChoice, most_s: float) -> object:
    try:
        return choice.load(most_s).speak(text)
    except FapEngineError as error:
        return error


def main(*, afresh: bool = False) -> None:
    """Work until the input ends."""
    for number in (signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)):
        signal.signal(number, signal.SIG_IGN)  # of the terminal: the one that asks is told, and tells
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    output = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints must not fall between
    with contextlib.suppress(FapEngineError):
        catalogue()  # loads the library, so that copies of this process need not
    with contextlib.suppress(BrokenPipeError):
        answer(sys.stdin.buffer, output, afresh=afresh)
