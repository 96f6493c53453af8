"""docs/pictures/demo.webp and demo.mp4: the animation at the top of README, and the video with sound of the site.

Run ``python -m design.demo_animation``.
"""

import subprocess
import sys
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"
COMMAND = (
    *("say", "Oh! Hello there. I speak, I listen, and I smile."),
    *("--expression", "surprise:0.7@0-0.5", "--expression", "joy:0.6@0.9-9"),
)
FILES = {
    "demo.webp": ("--size", "400x400", "--fps", "20"),
    "demo.mp4": ("--size", "400x400", "--fps", "30"),
}


def main() -> None:
    with TemporaryDirectory() as folder:
        for name, options in FILES.items():
            made = Path(folder) / name
            subprocess.run([sys.executable, "-m", "fapengine", *COMMAND, *options, "-o", str(made)], check=True)
            copyfile(made, PICTURES / name)
            print(f"{name}: {(PICTURES / name).stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
