"""``fapengine encode``: encode FAPs into an FBA stream."""

from pathlib import Path

import typer

from fapengine.cli import options as shared


def encode(
    track: Path = typer.Argument(..., help="FAPs as text (.fap)."),
    output: Path = typer.Option(..., "--output", "-o", help="Output stream: .fba, or .mp4 with sound."),
    audio: Path | None = typer.Option(None, "--audio", "-a", help="With .mp4: the sound, from the first frame."),
    epf: Path | None = typer.Option(None, help="Encoder parameter file, with settings for each plane."),
    quant: int | None = typer.Option(
        None, "--quant", "-q", min=0, max=31, help="Quantizer fap_quant, 0 (off) to 31. Default: 1."
    ),
    kbps: float | None = typer.Option(
        None, min=0.001, max=1e6, help="Target bit rate in kbit/s; chooses the quantizer."
    ),
    intra_every: int | None = typer.Option(None, min=0, max=1_000_000, help="Frames between I planes. 0: only one."),
    max_error_mm: float | None = typer.Option(
        None,
        min=0.001,
        max=100.0,
        help="Use the coarsest quantizer that keeps every feature point of an adult face within this error, in mm.",
    ),
    fitted: bool = typer.Option(False, "--fit-ranges", help="Send ranges fitted to the data if that is shorter."),
    moving_only: bool = typer.Option(False, "--moving-only", help="Omit FAPs that do not move."),
    visemes: bool = typer.Option(
        False,
        "--visemes",
        help="Send only the two visemes and the blend (FAP 1) that come closest to the mouth: speech at about"
        " 0.7 kbit/s, without expressions and gestures.",
    ),
    clamp: bool = typer.Option(
        False, "--clamp", help="With --epf: clamp values that are out of range instead of failing."
    ),
    start_codes: bool = typer.Option(False, "--start-codes", help="Write a start code before each I plane."),
    strict: shared.Strict = False,
    as_json: shared.AsJson = False,
    writing: shared.WriteOptions = shared.WriteOptions(),
) -> None:
    """Encode FAPs into an MPEG-4 FBA stream.

        fapengine encode talk.fap --quant 4 --intra-every 125 -o talk.fba
        fapengine encode talk.fap --audio talk.wav -o talk.mp4

    An MP4 file holds sound and face track together. `decode`, `inspect` and `render` read it.
    """
    from fapengine.app.outputs import missed_rate
    from fapengine.cli._printing import print_remarks, print_result, working
    from fapengine.codec.encoder import EncoderOptions
    from fapengine.codec.encoder import encode as encode_track
    from fapengine.codec.epf import encode_orders
    from fapengine.errors import UsageError
    from fapengine.files.fba import load_epf
    from fapengine.files.motion import as_visemes, load_fap, load_motion
    from fapengine.files.paths import is_standard, standard_output, write_bytes
    from fapengine.mpeg4.fapu import Fapu
    from fapengine.mpeg4.track import motion_remarks
    from fapengine.speech.plausible import refuse

    output = standard_output(output, ".fba")
    film = output.suffix.lower() == ".mp4"
    if audio is not None and not film:
        raise UsageError(f"--audio: requires an .mp4 output, got {output.name}")
    if epf is not None and film:
        raise UsageError("--epf: cannot be used with .mp4, which needs a start code before every plane; write .fba")
    writing.check([output], [track, epf, audio])
    with working(f"reading {track.name}"):
        faps = as_visemes(load_motion(track)) if visemes else load_fap(track)
    remarks = faps.remarks or motion_remarks(faps)
    if strict:
        refuse(remarks, str(track))
    print_remarks(remarks)
    if epf is not None:
        if any(choice is not None for choice in (quant, kbps, intra_every, max_error_mm)) or fitted or moving_only:
            raise UsageError("--epf: can only be combined with --clamp and --start-codes")
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
    if kbps is not None:
        remark = missed_rate(len(data), faps, kbps)
        result["missed"] = bool(remark)
        if remark:
            hint = "" if visemes else "; --moving-only and --visemes need fewer"
            typer.echo(f"{output}: {remark}{hint}", err=True)
    told = "{output}: {frames} frames, {seconds} s, {bytes} bytes, {kbit_s} kbit/s".format(**result)
    print_result(result, told, as_json=as_json, err=is_standard(output))


def _write_film(output: Path, stream: bytes, rate_hz: float, audio: Path | None) -> None:
    from fapengine.codec.decoder import decode
    from fapengine.codec.elementary import LEVELS, access_units, level_of
    from fapengine.files.fba import write_fba_film
    from fapengine.files.sound import load_sound

    decoded = decode(stream)
    level = level_of(decoded) or LEVELS[-1]
    sound = None if audio is None else load_sound(audio, spoken_s=decoded.track.times_s[-1])
    write_fba_film(output, access_units(stream, decoded), rate_hz=rate_hz, profile=level.profile, sound=sound)
