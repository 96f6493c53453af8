"""Everything that reads bytes of strangers, each with good examples: the table that searches for bad bytes share."""

import hashlib
import io
import json
import re
import shutil
import tempfile
import wave
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import av
import msgspec
import numpy as np
from PIL import Image

from fapengine._resources import profile_files
from fapengine.app.manner import parse_expression
from fapengine.capture.arrays import format_npz, parse_npz
from fapengine.capture.articulography import parse_mview, parse_pos
from fapengine.capture.bvh import parse_bvh
from fapengine.capture.c3d import format_c3d, parse_c3d
from fapengine.capture.conventions import understand
from fapengine.capture.landmarks import Picture, parse_landmarks
from fapengine.capture.marker_track import MarkerTrack
from fapengine.capture.table import format_table, format_trc, parse_table, parse_trc
from fapengine.codec.decoder import decode
from fapengine.codec.encoder import Encoder, EncoderOptions
from fapengine.codec.epf import parse_epf
from fapengine.codec.fapfile import parse_fap
from fapengine.codec.fit import PARTNERS, parse_fit
from fapengine.errors import DataError, UsageError
from fapengine.files.gltf.compression import decode_draco
from fapengine.files.gltf.document import parse_gltf
from fapengine.files.gltf.scene import read_scene
from fapengine.files.heads.folder import HeadInfo, load_folder, save_head
from fapengine.files.heads.tables import load_feature_points, load_mapping, parse_fdp
from fapengine.files.motion import shown
from fapengine.files.moving import write_moving
from fapengine.files.pictures import load_picture
from fapengine.files.recordings import load_mesh
from fapengine.files.sessions import load_session
from fapengine.files.sound import load_sound
from fapengine.files.video import stream_pictures
from fapengine.mesh.default_head.style import parse_look
from fapengine.mpeg4.track import FapTrack
from fapengine.profiles import parse_profile
from fapengine.render.drawing import parse_background, parse_size
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.blend_tracks import format_blend_csv, parse_blend_track, parse_vmc_recording
from fapengine.server.config import parse_config
from fapengine.server.web.messages import SOUND_HEAD, SOUND_KIND, parse_request, parse_sound
from fapengine.speech.formats.registry import ParseOptions, parse_timings
from fapengine.speech.formats.table import parse_columns
from fapengine.speech.text.normal_form import check_ssml, decoded, find_tag, speakable
from fapengine.voices.services import SERVICES
from fapengine.wire import fap_osc, osc
from fapengine.wire.framing import LengthDecoder, SlipDecoder, encode_length, encode_slip
from fapengine.wire.rtp import RtpSender
from fapengine.wire.speech_osc import codec, schema
from tests.fit_files import format_fit
from tests.recordings import BVH, mview_file, pos_file, wave_file
from tests.serve_example import EXAMPLE
from tests.unit.files.glb import Builder, square, write_rig
from tests.unit.files.test_avatars import packed, with_draco
from tests.unit.files.test_gltf import vrm
from tests.unit.mesh.rigs import own_rig
from tests.unit.speech.samples import SAMPLES
from tests.unit.wire.rtp_receiver import RtpReceiver

TEXTS = (DataError, UsageError)
CORPUS = Path(__file__).with_name("corpus")
RNG_SEED = 0


@dataclass(frozen=True)
class Reader:
    """One reader, and what it reads when all is well."""

    name: str
    read: Callable[[bytes], object]
    good: tuple[bytes, ...]
    refuses: type[Exception] | tuple[type[Exception], ...] = DataError
    """What it may raise for bytes that it does not take: a DataError, or a UsageError for what a user writes."""


@cache
def readers() -> tuple[Reader, ...]:
    """List them all."""
    return (*_codec(), *_timings(), *_motion(), *_capture(), *_meshes(), *_tables(), *_media(), *_texts(), *_wire())


def _codec() -> Iterable[Reader]:
    streams = tuple(path.read_bytes() for path in sorted(CORPUS.glob("*.fba")))
    yield Reader("FBA", decode, streams)
    yield Reader("FBA, resync", lambda data: decode(data, errors="resync"), streams)
    yield Reader("epf", parse_epf, tuple(path.read_bytes() for path in sorted(CORPUS.glob("*.epf"))))
    texts = tuple(path.read_bytes() for path in sorted(CORPUS.glob("*.fap")))
    yield Reader("fap", parse_fap, texts)
    yield Reader("fap, shown", lambda data: shown(parse_fap(data)), texts)
    yield Reader(
        "fit",
        parse_fit,
        (format_fit(PARTNERS), b"2\n1 3\n2 14 5\n1\n0 1 1\n1 2 0 1 1 0 1 1 0\n1 1 1 1 1 0 1 2 0\n"),
    )


def _timings() -> Iterable[Reader]:
    for name, text in SAMPLES.items():
        kind = name.split()[0]
        wishes = ParseOptions(columns="fps=24" if kind == "moho" else None)

        def timings(data: bytes, kind: str = kind, wishes: ParseOptions = wishes) -> object:
            return parse_timings(data, file_format=kind, options=wishes)

        yield Reader(f"timings, {name}", timings, (text.encode(),))
    yield Reader("timings, any", parse_timings, tuple(text.encode() for text in SAMPLES.values()))


def _track() -> FapTrack:
    values = np.random.default_rng(RNG_SEED).integers(-40, 90, (4, 68))
    values[:, :2] = 0
    return FapTrack.from_values(np.maximum(values, 0), rate_hz=30.0)


def _motion() -> Iterable[Reader]:
    rows = np.random.default_rng(RNG_SEED).random((3, 55)).round(3).tolist()
    tables = tuple(format_blend_csv(_track(), shapes) for shapes in ("arkit", "oculus", "vrm0"))
    yield Reader("shapes", parse_blend_track, (*tables, json.dumps({"FrameIndex": 0, "BlendShapes": rows}).encode()))
    lines = []
    for frame in range(4):
        at = f"eeada2a5.{frame * 0x0888_8888:08x}"
        lines += [f"{at} /VMC/Ext/T f {frame / 30:f}", f'{at} /VMC/Ext/Blend/Val sf "jawOpen" {frame / 10:f}']
        lines += [f'{at} /VMC/Ext/Blend/Val sf "{name}" 0.2' for name in ARKIT_NAMES[:12]]
        lines.append(f"{at} /VMC/Ext/Blend/Apply ")
    yield Reader("VMC recording", parse_vmc_recording, ("\n".join(lines).encode(),))


def _capture() -> Iterable[Reader]:
    track = MarkerTrack(
        positions_mm=np.random.default_rng(RNG_SEED).normal(0, 60, (5, 4, 3)),
        labels=("8.1", "8.2", "8.3", "8.4"),
        rate_hz=100.0,
    )
    of_twelve = replace(track, positions_mm=np.tile(track.positions_mm, (1, 3, 1)), labels=tuple(map(str, range(12))))
    picture = Picture(width_px=640, height_px=480, eye_corners_mm=90, rate_hz=30)
    few = np.random.default_rng(1).random((1, 468, 3)).round(2).tolist()
    for name, parse, *good in (
        ("C3D", parse_c3d, format_c3d(track)),
        ("TRC", parse_trc, format_trc(track)),
        ("marker table", parse_table, format_table(track), format_table(track, long=True), wave_file(track)),
        ("NPZ", parse_npz, format_npz(track)),
        ("POS", parse_pos, pos_file(track), pos_file(of_twelve, header=False)),
        ("MVIEW", parse_mview, mview_file(track)),
        ("BVH", parse_bvh, BVH),
        ("landmarks", lambda data: parse_landmarks(data, picture), json.dumps(few).encode()),
    ):
        units = "mm" if parse is parse_bvh else None  # its files state none
        yield Reader(name, lambda data, parse=parse, units=units: understand(parse(data), units=units), tuple(good))


def _no_file(name: str) -> bytes:
    raise DataError(f"uri: got {name}, expected none")


def _meshes() -> Iterable[Reader]:
    builder = Builder()
    builder.node(mesh=square(builder, targets=("rise", "fall")))
    small = (builder.glb(), builder.gltf(), vrm(0).glb(), vrm(1).glb())
    yield Reader("glTF", lambda data: read_scene(parse_gltf(data, _no_file)), small)
    yield Reader("glTF, Draco", lambda data: read_scene(parse_gltf(data, _no_file)), (with_draco(packed()).glb(),))
    yield Reader("Draco", lambda data: decode_draco(data, {"POSITION": 0}, ""), (packed(),))
    rig = write_rig(own_rig(("jawOpen", "mouthClose"))).glb()
    yield Reader("glTF, a face", lambda data: read_scene(parse_gltf(data, _no_file)), (rig,))
    obj = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvt 0 1\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1 3 4\n"
    ply = (
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    stl = (
        b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
        b"endsolid a\n"
    )
    for suffix, good in (("obj", obj), ("ply", ply), ("stl", stl)):
        yield Reader(f"mesh, {suffix}", _from_file(load_mesh, f"mesh.{suffix}"), (good,))


def _tables() -> Iterable[Reader]:
    corners = np.eye(3)
    points = b"point,vertex\n8.1,0\n8.2,1\n2.1,2\n", b"point,x,y,z\n8.1,1,0,0\n8.2,0,1,0\n"
    faces = np.array([[0, 1, 2]])
    yield Reader(
        "feature points", _from_file(lambda path: load_feature_points(path, corners, faces), "points.csv"), points
    )
    fdp = (
        b'<xfdp><head><fapu ENS0="51" ES0="69" IRISD0="16" MNS0="30" MW0="50"/></head>'
        b'<fdp affects="skin" index="2" name="2.1"/><fdp affects="skin" index="1" name="8.1"/></xfdp>',
        b"1.0 face 0 0 0 0 0 0\n2.1 0 -1 0 0.2\n8.1 0 0 0 0.1\nNUL 0\n",
    )
    yield Reader("feature points, fdp", parse_fdp, fdp)
    mapping = b'[shapes]\nsmile = "mouthSmileLeft"\nopen = { 3 = 900.0, 5 = -300.0 }\nrest = "unused"\n'
    yield Reader("mapping", _from_file(load_mapping, "mapping.toml"), (mapping,))
    yield Reader("serve.toml", lambda data: parse_config(data, "serve.toml"), (EXAMPLE.encode(),))
    files = dict(profile_files("grid_s1_en"))
    for name, data in sorted(files.items()):
        yield Reader(f"profile, {name}", lambda data, name=name: parse_profile(_signed(files, name, data)), (data,))
    folder = _folder()
    table = b"frame,time_s,8.1_x,8.1_y,8.1_z\n"
    table = format_table(MarkerTrack(positions_mm=np.ones((3, 1, 3)), labels=("8.1",), rate_hz=50.0)) or table
    (folder / "take.csv").write_bytes(table)
    session = (
        b'subject = "S03"\nlanguage = "en-GB"\nunits = "mm"\nup = "+y"\nhead = ["LFHD"]\n'
        b'neutral = { take = "take", start_s = 0.0, end_s = 1.0 }\nfapu_mm = { es0 = 62.0 }\n[points]\nLLIP = "8.2"\n'
        b'[[pose]]\nexpression = "joy"\ntake = "take"\nstart_s = 0.0\nend_s = 0.02\n'
    )

    def in_session(data: bytes) -> object:
        (folder / "session.toml").write_bytes(data)
        return load_session(folder)

    yield Reader("session.toml", in_session, (session,))
    yield from _head()


def _signed(files: dict[str, bytes], name: str, data: bytes) -> dict[str, bytes]:
    """Replace one file, and make the sum of the whole right, so that what comes behind that check is searched too."""
    before, after = (hashlib.sha256(one).hexdigest().encode() for one in (files[name], data))
    return {other: data if other == name else bytes(held).replace(before, after) for other, held in files.items()}


def _head() -> Iterable[Reader]:
    from fapengine.mesh.default_head.head import build_head

    folder = _folder()
    head = replace(build_head(level="coarse"), texture=None)  # "picture" reads pictures
    save_head(folder, head, HeadInfo(source="ours", licence="Apache-2.0", used=(), lacking=()))
    for name in ("head.toml", next(path.name for path in folder.glob("*.npz"))):
        files = {path.name: path.read_bytes() for path in folder.iterdir()}

        def in_head(data: bytes, name: str = name, files: dict[str, bytes] = files) -> object:
            for other, held in _signed(files, name, data).items():
                if other.endswith(".toml") or other == name:
                    (folder / other).write_bytes(held)
            try:
                return load_folder(folder)
            finally:
                (folder / name).write_bytes(files[name])

        yield Reader(f"head, {name}", in_head, (files[name],))


def _media() -> Iterable[Reader]:
    samples = (3000 * np.sin(np.arange(2000) * 0.2)).astype(np.int16)
    plain = io.BytesIO()
    with wave.open(plain, "wb") as out:
        out.setparams((1, 2, 16000, 0, "NONE", ""))
        out.writeframes(samples.tobytes())
    yield Reader("sound, WAV", _from_file(load_sound, "sound.wav"), (plain.getvalue(),))
    for container, name in (("flac", "flac"), ("ogg", "libopus"), ("mp3", "libmp3lame")):
        buffer = io.BytesIO()
        with av.open(buffer, "w", format=container) as file:
            stream = file.add_stream(name, rate=48000, layout="mono")
            resampler = av.AudioResampler(format=stream.format, layout="mono", rate=48000, frame_size=stream.frame_size)
            frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
            frame.sample_rate = 16000
            for piece in (*resampler.resample(frame), *resampler.resample(None), None):
                file.mux(stream.encode(piece))
        yield Reader(f"sound, {container}", _from_file(load_sound, f"sound.{container}"), (buffer.getvalue(),))
    pixels = Image.fromarray(np.random.default_rng(RNG_SEED).integers(0, 255, (12, 16, 3), dtype=np.uint8))
    pictures = []
    for kind in ("PNG", "JPEG", "WEBP", "BMP"):
        buffer = io.BytesIO()
        pixels.save(buffer, kind)
        pictures.append(buffer.getvalue())
    for suffix in (".mp4", ".webm", ".gif"):
        path = _folder() / f"film{suffix}"
        write_moving(path, [np.asarray(pixels)] * 3, rate_hz=25.0)
        yield Reader(f"film, {suffix}", _from_file(_film, f"film{suffix}"), (path.read_bytes(),))
    yield Reader("picture", _from_file(load_picture, "picture.png"), tuple(pictures))


def _film(path: Path) -> None:
    for _ in stream_pictures(path, max_side=64):
        pass


def _texts() -> Iterable[Reader]:
    spoken = "Hello — “there”, 3 naïve cafés? Ünïcode ﬁ 🙂.".encode()
    marked = b'<speak>Hello <break time="1s"/> <prosody rate="slow">there</prosody> &amp; you</speak>'

    def text(data: bytes) -> object:
        words = decoded(data)
        return speakable(words), find_tag(words)

    yield Reader("text", text, (spoken, marked))
    yield Reader("SSML", lambda data: check_ssml(speakable(decoded(data)).text), (marked,), TEXTS)
    for name, parse, *good in (
        ("--expression", parse_expression, b"joy:0.4@1.5-3", b"surprise@word"),
        ("--columns", parse_columns, b"start=a,end=b,label=c,unit=ms"),
        ("--look", parse_look, b"hair_colour=red,age=0.8,level=fine"),
        ("--size", parse_size, b"640x480"),
        ("--background", parse_background, b"#102030"),
    ):
        yield Reader(f"option {name}", lambda data, parse=parse: parse(data.decode("utf-8", "replace")), good, TEXTS)


def _wire() -> Iterable[Reader]:
    (frame,) = fap_osc.encode_track(FapTrack.from_values(_track().values[:1], rate_hz=25.0), session="anna")
    mixed = osc.message("/x", "sbihfdTFN", "é", b"abc", 1, 2, 3.0, 4.0, True, False, None)
    told = (
        codec.encode(schema.Hello("anna", token="word")),
        codec.encode(
            schema.Phones("anna", 1, 0, 0, (schema.WirePhone("m", 0, 80_000), schema.WirePhone("a", 80_000, 9)))
        ),
        codec.encode(schema.CancelUtterance("anna", -1, -1, 200)),
        codec.encode(schema.SpeakText("anna", "Hello.")),
        codec.encode(schema.WordTimes("anna", 1, 0, (schema.WireWord("Hi", 0, 300_000),), "en")),
    )
    kinds = schema.from_sender()

    def messages(data: bytes) -> None:
        for message in osc.parse_packet(data):
            if message.address in kinds:
                codec.parse(kinds[message.address], message)

    yield Reader("OSC", osc.parse_packet, (mixed, *osc.bundles([mixed, frame], limit=9999)))
    yield Reader("OSC, speech", messages, told)
    yield Reader("OSC, frame", fap_osc.decode_frame, (frame,))
    planes = Encoder(rate_hz=25.0, options=EncoderOptions(plane_start_codes="all"))
    packets = RtpSender(ssrc=1).plane(planes.frame([0, 0, *range(66)]), 0.0)
    yield Reader("RTP", lambda data: RtpReceiver().packet(data), tuple(packets))
    aligned = b'{"chars": ["a", "b", " "], "charStartTimesMs": [0, 9, 20], "charDurationsMs": [9, 11, 4]}'
    stamps = b'{"words": ["ab"], "start": [0.1], "end": [0.2]}'
    words = b'{"words": ["ab"], "wordStartTimeSeconds": [0.1], "wordEndTimeSeconds": [0.2]}'
    spoken = {
        "elevenlabs": b'{"audio": "AAAA", "isFinal": null, "normalizedAlignment": ' + aligned + b"}",
        "cartesia": b'{"type": "timestamps", "word_timestamps": ' + stamps + b"}",
        "inworld": b'{"result": {"audioContent": "AAAA", "timestampInfo": {"wordAlignment": ' + words + b"}}}",
        "fish": msgspec.msgpack.encode({"event": "audio", "audio": b"\0\0", "alignment": {"segments": []}}),
    }
    for name, answer in spoken.items():
        yield Reader(f"voice, {name}", lambda data, name=name: SERVICES[name]("v", "k").feed(data), (answer,))
    yield Reader("SLIP", lambda data: SlipDecoder().feed(data), (encode_slip(mixed) * 2,))
    yield Reader("length prefix", lambda data: LengthDecoder().feed(data), (encode_length(mixed) * 2,))
    asked = (
        {"type": "say", "text": "Hello.", "rate": 160}, {"type": "express", "name": "joy", "level": 0.5},
        {"type": "look", "yaw": 0.1, "pitch": 0.0}, {"type": "plays", "on": True},
    )  # fmt: skip
    yield Reader("page", lambda data: parse_request(data.decode("utf-8", "replace")),
                 tuple(json.dumps(one).encode() for one in asked))  # fmt: skip
    yield Reader("page, sound", parse_sound, (SOUND_HEAD.pack(SOUND_KIND, 16_000) + bytes(range(64)),))


def _folder() -> Path:
    """A new folder in memory, where there is one; it goes with the process."""
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=memory if memory.is_dir() else None))
    _FOLDERS.append(folder)
    return folder


_FOLDERS: list[Path] = []


def clean() -> None:
    """Remove what readers of files were given."""
    while _FOLDERS:
        shutil.rmtree(_FOLDERS.pop(), ignore_errors=True)
    readers.cache_clear()


def _from_file(load: Callable[[Path], object], name: str) -> Callable[[bytes], object]:
    path = _folder() / name

    def read(data: bytes) -> object:
        path.write_bytes(data)
        return load(path)

    return read


NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
ODD = (
    b"", b"-", b"1e999", b"-1", b"NaN", b"Infinity", b"1e300", b"99999999999", b"4294967295", b"0", b"1e-300",
    b'"', b"\n", b"\0", "é".encode(), b"\xff", b"{", b"[[", b"null", b"\t", b"x y", b"<", b"&", b"=", b",", b"true",
    b"\x80\x00\x00\x00", b"\xff\xff\xff\xff", b"\x7f\xff", b"[" * 300,
)  # fmt: skip
