"""The command line where typer and rich are not installed: the verbs that need numpy alone, or with scipy.

They have their main options, write what the whole verbs write, to the byte, and print JSON.
"""

import json
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fapengine.cli._ending import run_to_the_end
from fapengine.speaking import DEFAULT_PROFILE

MEND = "mend it with: pip install typer rich"
STANDARD = {"animate": ".fap", "encode": ".fba", "decode": ".fap", "convert": ".csv"}
"""Ending of what ``-o -`` writes to standard output."""


def main() -> None:
    """Run the command line."""
    run_to_the_end(_run)


def _run() -> None:
    from fapengine.errors import ResourceError
    from fapengine.files.paths import is_standard

    verb = sys.argv[1] if len(sys.argv) > 1 else ""
    if verb and not verb.startswith("-") and verb not in VERBS:
        raise ResourceError(f"{verb}: typer and rich are not installed, and {', '.join(VERBS)} alone are here; {MEND}")
    chosen, others = _parser().parse_known_args()
    if others:
        raise ResourceError(f"{others[0]}: typer and rich are not installed, which know more options; {MEND}")
    try:
        told = json.dumps(VERBS[chosen.verb][0](chosen), ensure_ascii=False)
        stream = sys.stderr if chosen.verb != "inspect" and is_standard(chosen.output) else sys.stdout
        stream.write(f"{told}\n")
    except KeyboardInterrupt:
        sys.exit(130)


def _parser() -> ArgumentParser:
    from fapengine import __version__

    parser = ArgumentParser(
        prog="fapengine",
        description="Phone timings in, FAP streams out. typer and rich are not installed: these are the verbs that do"
        f" without, with their main options. For all of them, {MEND}",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"fapengine {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for name, (_, told, options) in VERBS.items():
        verb = verbs.add_parser(name, help=told, description=told, allow_abbrev=False)
        verb.add_argument("source", type=Path, help="file to read")
        if name != "inspect":
            verb.add_argument("--output", "-o", type=Path, required=True, help="file to write")
        for flags, declared in options:
            verb.add_argument(*flags, **declared)
    return parser


def _animate(chosen: Namespace) -> dict[str, Any]:
    import fapengine

    _check(chosen)
    performance = fapengine.animate(
        chosen.source,
        expressions=tuple(chosen.expression),
        profile=chosen.profile,
        seed=chosen.seed,
        rate_hz=chosen.fps,
    )
    performance.save(chosen.output, shapes=chosen.shapes, into=chosen.into)
    return _written(chosen, performance.track)


def _convert(chosen: Namespace) -> dict[str, Any]:
    import fapengine

    _check(chosen)
    track = fapengine.load(chosen.source)
    fapengine.save(track, chosen.output, shapes=chosen.shapes, into=chosen.into)
    return _written(chosen, track)


def _encode(chosen: Namespace) -> dict[str, Any]:
    from fapengine.codec.encoder import EncoderOptions, encode
    from fapengine.files.motion import load_fap
    from fapengine.files.paths import write_bytes

    _check(chosen)
    track = load_fap(chosen.source)
    options = EncoderOptions(quant=chosen.quant, intra_every=chosen.intra_every, kbit_s=chosen.kbps)
    write_bytes(chosen.output, encode(track, options))
    return _written(chosen, track)


def _decode(chosen: Namespace) -> dict[str, Any]:
    from dataclasses import replace

    from fapengine.files.fba import load_fba
    from fapengine.files.motion import save_fap

    _check(chosen)
    decoded = load_fba(chosen.source)
    rate = next((part.header.rate for part in decoded.planes if part.header.rate is not None), None)
    track = replace(decoded.track, rate_hz=float(rate.whole)) if rate is not None and rate.whole else decoded.track
    save_fap(chosen.output, track)
    return _written(chosen, track)


def _inspect(chosen: Namespace) -> dict[str, Any]:
    from fapengine.app.inspection.kinds import find_kind
    from fapengine.app.inspection.report import Source

    source = Source(chosen.source)
    return find_kind(source).describe(source).facts


def _check(chosen: Namespace) -> None:
    """Refuse to write over what is read; give ``-`` an ending."""
    from fapengine.files.outputs import check_outputs
    from fapengine.files.paths import standard_output

    chosen.output = standard_output(chosen.output, STANDARD[chosen.verb])
    named = (getattr(chosen, name, None) for name in ("into", "profile"))
    check_outputs([chosen.output], [chosen.source, *(Path(name) for name in named if name is not None)])


def _written(chosen: Namespace, track: Any) -> dict[str, Any]:
    return {"output": str(chosen.output), "frames": len(track), "rate_hz": track.rate_hz}


_SHAPES = ("--shapes",), {"help": "of a table: arkit, oculus, vrm0 or vrm1; of mouth shapes: rhubarb"}
_INTO = ("--into",), {"help": "avatar (.glb, .vrm, .gltf) that is written with the motion inside"}
VERBS: dict[str, tuple[Callable[[Namespace], dict[str, Any]], str, list[tuple[tuple[str, ...], dict[str, Any]]]]] = {
    "animate": (
        _animate,
        "phone timings to FAPs (.fap, .fba), a table of shapes (.csv) or an avatar's motion (.glb, .vrma)",
        [
            (("--expression", "-e"), {"action": "append", "default": [], "help": "joy:0.4, joy:0.4@1.5-3, ..."}),
            (("--profile",), {"default": DEFAULT_PROFILE, "help": "whose way of speaking: a shipped name or a folder"}),
            (("--fps",), {"type": float, "default": 30.0, "help": "frames a second"}),
            (("--seed",), {"type": int, "default": 1, "help": "chance of blinks, glances and head motion"}),
            _SHAPES,
            _INTO,
        ],
    ),
    "encode": (
        _encode,
        "FAPs (.fap) to an MPEG-4 stream (.fba)",
        [
            (("--quant", "-q"), {"type": int, "default": 1, "help": "fap_quant, 0 (off) to 31"}),
            (("--kbps",), {"type": float, "help": "target in kbit/s: chooses the quantiser"}),
            (("--intra-every",), {"type": int, "default": 0, "help": "frames from I plane to I plane; 0: one only"}),
        ],
    ),
    "decode": (_decode, "an MPEG-4 stream (.fba) to FAPs (.fap)", []),
    "convert": (_convert, "face motion from one format to another", [_SHAPES, _INTO]),
    "inspect": (_inspect, "what is in FAPs, a stream, phone timings or a profile", []),
}
"""Function of each verb, its help, and its options."""
