"""Draw held-out sentences frame by frame, captured lips above planned ones, on the same head.

    python -m design.lip_strips --train data/speech_train.npz -o out/strips [--sentences 6]

One picture a sentence; above each frame stands the phone whose middle is nearest to it. Depth and tongue, which the
tracker does not know, are the planned ones in both. They show how a person moved: do not publish them.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from bench.fidelity import NAMES, UNMEASURED, add_files, learn, read_files
from fapengine.app.inspection.faces import draw_mouths
from fapengine.files.pictures import drawable, font
from fapengine.mpeg4.track import to_codable
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style

TILE, LINE, COLUMNS = 110, 22, 15


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_files(parser)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/strips"), help="default: %(default)s")
    parser.add_argument("--sentences", type=int, default=6, help="default: %(default)s")
    options = parser.parse_args()
    training, tested = read_files(options)
    profile, rate_hz = learn(training, tested.rate_hz).profile, tested.rate_hz
    options.output.mkdir(parents=True, exist_ok=True)
    for clip in tested.clips[:: max(len(tested.clips) // options.sentences, 1)][: options.sentences]:
        spoken = np.flatnonzero(clip.spoken)
        planned = plan(
            clip.phones, profile, rng=np.random.default_rng(0), rate_hz=rate_hz, style=Style.speech_only()
        ).track.values[spoken]  # fmt: skip
        order = [NAMES.index(name) for name in profile.space.points]
        captured = displacements_to_faps(clip.points[spoken][:, order], profile.space.points, profile.fapu)
        captured[:, list(UNMEASURED)] = planned[:, list(UNMEASURED)]
        labels = [""] * len(spoken)
        for phone in clip.phones.phones:
            nearest = round((phone.start_s + phone.end_s) / 2 * rate_hz) - spoken[0]
            if 0 <= nearest < len(spoken) and not phone.is_silence:
                labels[nearest] += phone.label
        strips = [draw_mouths(faps) for faps in (to_codable(captured), planned)]
        rows = -(-len(spoken) // COLUMNS)
        sheet = Image.new("RGB", (COLUMNS * TILE, rows * (2 * TILE + LINE)), "white")
        pen = ImageDraw.Draw(sheet)
        for frame, label in enumerate(labels):
            row, column = divmod(frame, COLUMNS)
            x, y = column * TILE, row * (2 * TILE + LINE)
            pen.text((x + 4, y), drawable(label), fill="black", font=font(15))
            for below, strip in enumerate(strips):
                sheet.paste(Image.fromarray(strip[frame]).resize((TILE, TILE)), (x, y + LINE + below * TILE))
        sheet.save(options.output / f"{clip.name}.png")
        print(clip.name, clip.text)


if __name__ == "__main__":
    main()
