"""``python -m fapengine.conformance``: run a suite against a program, and print the results."""

import argparse
import asyncio
import socket
import sys
from collections.abc import Sequence

from fapengine.conformance.cases import Verdict, as_json, run, table
from fapengine.errors import FapEngineError, UsageError

SUITES = ("fba-decoder", "fba-encoder", "osc-sender", "osc-server", "page-client", "page-server")
EPILOG = """examples:
  python -m fapengine.conformance osc-server 127.0.0.1:9110
  python -m fapengine.conformance osc-sender 9110            then let your sender say something to this port
  python -m fapengine.conformance page-server http://127.0.0.1:8110/
  python -m fapengine.conformance page-client 8110           then connect your client to it
  python -m fapengine.conformance fba-decoder 'mydecoder {in} {out}'     .fba in, .fap out
  python -m fapengine.conformance fba-encoder 'myencoder {in} {out}'     .fap in, .fba out

exit code: 0 every case passed or was not tried, 1 one failed, 2 wrong use, 3 no answer or no such port"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a suite; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m fapengine.conformance",
        description="Suites for your own OSC senders and servers, WebSocket clients and servers, and face coders.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("suite", choices=SUITES)
    parser.add_argument("subject", help="HOST:PORT, a port to listen at, the page's address, or a command")
    parser.add_argument("--token", default="", help="of an OSC server")
    parser.add_argument("--seconds", type=float, default=10.0, help="to listen to a sender or a client")
    parser.add_argument("--json", action="store_true", help="verdicts as JSON")
    options = parser.parse_args(arguments)
    try:
        verdicts = _verdicts(options.suite, options)
    except FapEngineError as error:
        sys.stderr.write(f"fapengine.conformance: {error}\n")
        return 2 if isinstance(error, UsageError) else 3
    sys.stdout.write((as_json(options.suite, verdicts) if options.json else table(verdicts)) + "\n")
    return any(verdict.outcome == "fail" for verdict in verdicts)


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()


def _port(spelled: str) -> int:
    if not (spelled.isdigit() and int(spelled) < 1 << 16):
        raise UsageError(f"subject: got {spelled!r}, expected a port to listen at")
    return int(spelled)


def _verdicts(suite: str, options: argparse.Namespace) -> list[Verdict]:
    """Run a suite. Its module is imported here, so that each suite needs its own dependencies only."""
    subject, seconds = options.subject, options.seconds
    if suite == "osc-server":
        from fapengine.conformance import osc

        host, _, port = subject.rpartition(":")
        if not host:
            raise UsageError(f"subject: got {subject!r}, expected HOST:PORT")
        with osc.OscServer(host.strip("[]"), _port(port), options.token) as server:
            return run(osc.SERVER_CASES, server)
    if suite == "osc-sender":
        from fapengine.conformance import osc
        from fapengine.server.intake.listeners import bound

        with bound("127.0.0.1", _port(subject), socket.SOCK_DGRAM) as own:
            _say(f"listens at 127.0.0.1:{own.getsockname()[1]}; let your sender speak, for {seconds:g} s")
            return run(osc.SENDER_CASES, osc.listen(own, seconds, _say))
    if suite.startswith("page"):
        from fapengine.conformance import page

        if suite == "page-server":
            return run(page.SERVER_CASES, page.PageServer(subject))
        return run(page.CLIENT_CASES, asyncio.run(page.watch(_port(subject), seconds, _say)))
    from fapengine.conformance import fba

    return run(fba.DECODER_CASES if suite == "fba-decoder" else fba.ENCODER_CASES, fba.Program(subject))


if __name__ == "__main__":
    sys.exit(main())
