"""Random meshes, cameras, FAPs and textures, drawn with the address and undefined-behaviour sanitizers.

    python -m tests.native.fuzz [--cases 300] [--seed 1] [--head NAME]

Each case is a mesh of up to 400 vertices in images of up to 300 x 300 pixels; some have numbers that are none, or that
index nothing, which must be refused. Every tenth case is the head NAME with random FAPs. Three frames are drawn with
every set of instructions that this processor has: they must be the same bytes. The first fault ends the run.
"""

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.native import built

FLAGS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
STAGE = "FAPENGINE_FUZZ_STAGE"
INSTRUCTIONS = ("x86-64", "x86-64-v3", "x86-64-v4")


@dataclass
class Counts:
    """What was tried."""

    meshes: int = 0
    refused: int = 0
    heads: int = 0
    frames: int = 0
    near: int = 0
    """Frames with a camera among the vertices."""
    odd: int = 0
    """Frames with numbers that are none, or huge."""


def random_mesh(rng: np.random.Generator) -> tuple[Any, ...]:
    count = int(rng.integers(3, 400))
    entries = rng.normal(0, 0.02, (1, 1024, 4)).astype(np.float32)
    entries[..., 3] = rng.integers(0, 128, (1, 1024))
    vertices = rng.normal(0, 1, (count, 21)).astype(np.float32)
    vertices[:, :3] *= 10 ** rng.uniform(0, 3)
    vertices[:, 6:12] = rng.uniform(0, 1, (count, 6))
    vertices[:, 10] *= 400
    vertices[:, 16] = rng.integers(0, 5, count)
    vertices[:, 17:19] = rng.uniform(0, 1, (count, 2)) * (rng.random((count, 2)) < 0.5)
    vertices[:, 19] = rng.integers(0, 1000, count)
    vertices[:, 20] = rng.integers(0, 24, count) * (rng.random(count) < 0.7)
    if rng.random() < 0.2:
        vertices[rng.integers(count), rng.integers(21)] = rng.choice([np.nan, np.inf, -np.inf, 1e30, -5])
    if rng.random() < 0.05:
        entries[0, rng.integers(1024), 3] = rng.choice([128, -1, np.nan])
    parts = {
        name: rng.integers(0, count, (rng.integers(0, 80), 3))
        for name in ("face", "cutout", "eyeball", "eye", "strand")
    }
    if rng.random() < 0.05:
        parts["eye"] = np.array([[0, 1, count]])
    return vertices, entries, rng.normal(0, 0.01, entries.shape).astype(np.float32), parts


def random_frame(rng: np.random.Generator, counts: Counts, size: tuple[int, int]) -> np.ndarray:
    from fapengine.render.camera import FAR_MM, NEAR_MM, Camera

    is_near = rng.random() < 0.3
    camera = Camera(
        yaw_deg=rng.uniform(-180, 180), pitch_deg=rng.uniform(-80, 80), target_mm=tuple(rng.normal(0, 60, 3)),
        distance_mm=rng.uniform(101, 160 if is_near else 1900), field_deg=rng.uniform(1.5, 119),
    )  # fmt: skip
    bones = np.tile(np.eye(4), (5, 1, 1)) + rng.normal(0, 0.05, (5, 4, 4))
    bones[:, 3, :3] = rng.normal(0, 5, (5, 3))
    share = (FAR_MM + NEAR_MM) / (FAR_MM - NEAR_MM)
    values = [
        rng.normal(0, 200, 128), bones, rng.uniform(0, 1, 2), rng.uniform(-1, 1, 4), rng.uniform(0, 1, 3),
        camera.clip_from_world(size[0] / size[1]).T, camera.position_mm,
        ((share + 1) / 2, FAR_MM * NEAR_MM / (FAR_MM - NEAR_MM)),
    ]  # fmt: skip
    frame = np.concatenate([np.ravel(each) for each in values]).astype(np.float32)
    if is_odd := rng.random() < 0.2:
        frame[rng.integers(0, len(frame), 3)] = rng.choice([np.nan, np.inf, -np.inf, 1e38, -1e38, 0], 3)
    counts.frames, counts.near, counts.odd = counts.frames + 1, counts.near + is_near, counts.odd + is_odd
    return frame


def run(cases: int, seed: int, name: str) -> Counts:
    from fapengine.files.heads.load import load_head
    from fapengine.mpeg4 import fap
    from fapengine.render.packing import frame_uniforms, pack

    native, counts = built.imported(FLAGS), Counts()
    head = load_head(name)
    packed = pack(head)
    for case in range(cases):
        rng = np.random.default_rng([seed, case])
        size = tuple(int(side) for side in rng.integers(1, 300, 2))
        is_head = case % 10 == 9
        if is_head:
            mesh = packed.vertices, packed.displacements, packed.normal_deltas, packed.parts
            counts.heads += 1
        else:
            mesh = random_mesh(rng)
            counts.meshes += 1
        skin = rng.integers(0, 256, (*rng.integers(1, 40, 2), 4), dtype=np.uint8) if rng.random() < 0.7 else None
        ground = rng.integers(0, 256, (size[1], size[0], 4), dtype=np.uint8) if rng.random() < 0.7 else None
        frames = [random_frame(rng, counts, size) for _ in range(3)]
        if is_head:
            for frame in frames:
                uniforms = frame_uniforms(head, rng.normal(0, 10 ** rng.uniform(1, 4), fap.FAP_COUNT))
                frame[:128], frame[128:208] = uniforms.channels, uniforms.bones.ravel()
        hows = [
            (bool(rng.random() < 0.5), bool(rng.random() < 0.8), str(rng.choice(["rgb", "rgba", "i420"])))
            for _ in frames
        ]
        drawn: dict[str, bytes] = {}
        for instructions in INSTRUCTIONS:
            try:
                native.select(instructions)
            except ValueError:  # not this processor's
                continue
            try:
                face = native.Face(*mesh)
            except ValueError:
                counts.refused += instructions == INSTRUCTIONS[0]
                continue
            face.canvas(size, ground)
            if skin is not None:
                face.skin(skin)
            images = [
                face.draw(frame, at_vertices=at_vertices, soft=soft, form=form)
                for frame, (at_vertices, soft, form) in zip(frames, hows, strict=True)
            ]
            drawn[instructions] = b"".join(image.tobytes() for image in images)
            face.close()
        if len(set(drawn.values())) > 1:
            sys.exit(f"case {case} of seed {seed}: {', '.join(drawn)} draw different bytes")
    return counts


def start_with_sanitizers(module: str) -> None:
    """Start a program again, so that the sanitizer's library is the first that is loaded; returns in that process."""
    if STAGE in os.environ:
        return
    command = [*built.build_hook().compiler(""), "-print-file-name=libasan.so"]
    sanitizer = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    built.built(FLAGS)
    environment = os.environ | {STAGE: "1", "LD_PRELOAD": sanitizer, "ASAN_OPTIONS": "detect_leaks=0"}
    sys.exit(subprocess.run([sys.executable, "-m", module, *sys.argv[1:]], env=environment).returncode)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--head", default="default")
    options = parser.parse_args()
    start_with_sanitizers("tests.native.fuzz")
    counts = run(options.cases, options.seed, options.head)
    print(
        f"seed {options.seed}: {counts.meshes} random meshes ({counts.refused} refused), {counts.heads} times"
        f" {options.head}; {counts.frames} frames, {counts.near} with a camera among the vertices, {counts.odd} with"
        " numbers that are none or huge; each with every set of instructions: no fault, the same bytes"
    )


if __name__ == "__main__":
    main()
