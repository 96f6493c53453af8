"""``fapengine encode``: a track of FAPs to an FBA stream."""

from pathlib import Path

import typer

from fapengine.cli import options as shared


def encode(
    track: Path = typer.Argument(..., help="FAPs as text (.fap)."),
    output: Path = typer.Option(..., "--output", "-o", help="Stream to write: .fba, or .mp4 with the voice beside it."),
    audio: Path | None = typer.Option(None, "--audio", "-a", help="With .mp4: the voice, from the first frame on."),
    epf: Path | None = typer.Option(None, "--epf", help="Parameter file that says everything plane by plane."),
    quant: int | None = typer.Option(None, "--quant", "-q", help="fap_quant, 0 (off) to 31; 1 by default."),
    kbps: float | None = typer.Option(None, "--kbps", help="Target in kbit/s: chooses the quantiser."),
    intra_every: int | None = typer.Option(None, "--intra-every", help="Frames from I plane to I plane; 0: one only."),
    max_error_mm: float | None = typer.Option(
        None, "--max-error-mm", help="Coarsest quantiser that keeps every feature point of an adult face so near."
    ),
    fitted: bool = typer.Option(False, "--fitted", help="Send ranges fitted to the data where that is shorter."),
    moving_only: bool = typer.Option(False, "--moving-only", help="Leave out FAPs that do not move."),
    clamp: bool = typer.Option(False, "--clamp", help="With --epf: code the nearest symbol out of range, no error."),
    start_codes: bool = typer.Option(False, "--start-codes", help="A start code before each I plane."),
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Encode FAPs into an MPEG-4 FBA stream.

        fapengine encode talk.fap --quant 4 --intra-every 125 -o talk.fba
        fapengine encode talk.fap --audio talk.wav -o talk.mp4

    An MP4 holds a voice and a face track in one file; decode, inspect and render read it.
    """
    from fapengine.cli._progress import working
    from fapengine.cli._result import print_result
    from fapengine.codec.encoder import EncoderOptions
    from fapengine.codec.encoder import encode as encode_track
    from fapengine.codec.epf import encode_orders
    from fapengine.errors import UsageError
    from fapengine.files.fap import load_fap
    from fapengine.files.fba import load_epf
    from fapengine.files.paths import is_standard, standard_output, write_bytes
    from fapengine.mpeg4.fapu import Fapu

    output = standard_output(output, ".fba")
    film = output.suffix.lower() == ".mp4"
    if audio is not None and not film:
        raise UsageError(f"--audio: got {audio} with {output.name}, expected -o NAME.mp4")
    if epf is not None and film:
        raise UsageError("--epf: got it with .mp4, which wants a start code before every plane; expected .fba")
    writing.check([output], [track, epf, audio])
    with working(f"reading {track.name}"):
        faps = load_fap(track)
    if epf is not None:
        if any(choice is not None for choice in (quant, kbps, intra_every, max_error_mm)) or fitted or moving_only:
            raise UsageError("--epf: got other choices beside it, expected it alone (or with --clamp, --start-codes)")
        data = encode_orders(load_epf(epf), faps, clamp=clamp, plane_start_codes=start_codes)
    else:
        face = Fapu(irisd0_mm=11.0, es0_mm=62.0, ens0_mm=47.0, mns0_mm=22.0, mw0_mm=50.0)  # an adult's
        options = EncoderOptions(
            quant=1 if quant is None else quant,
            intra_every=intra_every or 0,
            kbit_s=kbps,
            ranges="fitted" if fitted else "table",
            moving_only=moving_only,
            max_error_mm=max_error_mm,
            fapu=None if max_error_mm is None else face,
            plane_start_codes="all" if film else "intra" if start_codes else "none",
        )
        with working(f"encoding {len(faps)} frames"):
            data = encode_track(faps, options)
    if film:
        _write_film(output, data, faps.rate_hz, audio)
    else:
        write_bytes(output, data)
    seconds = float(faps.frame_numbers[-1] - faps.frame_numbers[0] + 1) / faps.rate_hz
    result = {
        "output": str(output), "frames": len(faps), "seconds": round(seconds, 3), "bytes": len(data),
        "kbit_s": round(8 * len(data) / seconds / 1000, 3),
    }  # fmt: skip
    told = "{output}: {frames} frames, {seconds} s, {bytes} bytes, {kbit_s} kbit/s".format(**result)
    print_result(result, told, as_json=as_json, err=is_standard(output))


def _write_film(output: Path, stream: bytes, rate_hz: float, audio: Path | None) -> None:
    from fapengine.codec.decoder import decode
    from fapengine.codec.elementary import LEVELS, access_units, level_of
    from fapengine.files.fba_film import write_fba_film
    from fapengine.files.sound import load_sound

    decoded = decode(stream)
    level = level_of(decoded) or LEVELS[-1]
    sound = None if audio is None else load_sound(audio)
    write_fba_film(output, access_units(stream, decoded), rate_hz=rate_hz, profile=level.profile, sound=sound)
