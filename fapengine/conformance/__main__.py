"""``python -m fapengine.conformance``: run a suite against a program, and print the verdicts."""

import argparse
import asyncio
import sys
from collections.abc import Sequence

from fapengine.conformance.cases import Verdict, as_json, run, table
from fapengine.errors import FapEngineError, UsageError

EPILOG = """examples:
  python -m fapengine.conformance osc-server 127.0.0.1:9110
  python -m fapengine.conformance osc-sender 9110            then let your sender say something to this port
  python -m fapengine.conformance page-server http://127.0.0.1:8110/
  python -m fapengine.conformance page-client 8110           then connect your client to it
  python -m fapengine.conformance fba-decoder 'mydecoder {in} {out}'     .fba in, .fap out
  python -m fapengine.conformance fba-encoder 'myencoder {in} {out}'     .fap in, .fba out

exit code: 0 every case passed or was not tried, 1 one failed, 2 wrong use, 3 nobody there or no such port"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a suite; the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m fapengine.conformance",
        description="Suites for your own OSC senders and servers, WebSocket clients and servers, and face coders.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("subject", help="HOST:PORT, a port to listen at, the page's address, or a command")
    parser.add_argument("--token", default="", help="of an OSC server")
    parser.add_argument("--seconds", type=float, default=10.0, help="to listen to a sender or a client")
    parser.add_argument("--json", action="store_true", help="verdicts as JSON")
    options = parser.parse_args(arguments)
    try:
        verdicts = SUITES[options.suite](options)
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


def _osc_server(options: argparse.Namespace) -> list[Verdict]:
    from fapengine.conformance.osc_server import CASES, OscServer

    host, _, port = options.subject.rpartition(":")
    if not host:
        raise UsageError(f"subject: got {options.subject!r}, expected HOST:PORT")
    with OscServer(host.strip("[]"), _port(port), options.token) as server:
        return run(CASES, server)


def _osc_sender(options: argparse.Namespace) -> list[Verdict]:
    from fapengine.conformance.osc_sender import CASES, listen, open_port

    with open_port("127.0.0.1", _port(options.subject)) as own:
        _say(f"listens at 127.0.0.1:{own.getsockname()[1]}; let your sender speak, for {options.seconds:g} s")
        return run(CASES, listen(own, options.seconds, _say))


def _page_server(options: argparse.Namespace) -> list[Verdict]:
    from fapengine.conformance.page import SERVER_CASES, PageServer

    return run(SERVER_CASES, PageServer(options.subject))


def _page_client(options: argparse.Namespace) -> list[Verdict]:
    from fapengine.conformance.page import CLIENT_CASES, watch

    return run(CLIENT_CASES, asyncio.run(watch(_port(options.subject), options.seconds, _say)))


def _fba_decoder(options: argparse.Namespace) -> list[Verdict]:
    from fapengine.conformance.fba import DECODER_CASES, Program

    return run(DECODER_CASES, Program(options.subject))


def _fba_encoder(options: argparse.Namespace) -> list[Verdict]:
    from fapengine.conformance.fba import ENCODER_CASES, Program

    return run(ENCODER_CASES, Program(options.subject))


SUITES = {
    "osc-server": _osc_server,
    "osc-sender": _osc_sender,
    "page-server": _page_server,
    "page-client": _page_client,
    "fba-decoder": _fba_decoder,
    "fba-encoder": _fba_encoder,
}

if __name__ == "__main__":
    sys.exit(main())
