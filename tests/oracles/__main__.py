"""Run every foreign program that is here on what we write: ``python -m tests.oracles out/oracles``."""

import sys
from pathlib import Path

from tests.oracles.aarch64 import check_aarch64
from tests.oracles.bare import check_bare_environment
from tests.oracles.bare_debian import check_bare_debian
from tests.oracles.engines import check_receivers
from tests.oracles.marks import check_with_exiftool
from tests.oracles.programs import check_programs
from tests.oracles.proxy import check_behind_nginx
from tests.oracles.pyodide import check_in_pyodide
from tests.oracles.scenes import check_with_blender, check_with_three, check_with_validator, write_scenes
from tests.oracles.turn import check_with_turn


def main(root: Path) -> None:
    """Fail on the first answer that is not what it should be; avatars of others lie in ``avatars`` of the folder."""
    modules = (root / "node_modules").resolve()
    scenes = root / "scenes"
    paths = write_scenes(scenes, root / "avatars")
    check_with_validator([path.resolve() for path in paths], modules)
    check_with_three(scenes, modules)
    check_with_blender(scenes)
    check_with_exiftool()
    check_programs(root)
    check_bare_environment(root)
    check_bare_debian(root)
    check_aarch64(root)
    check_in_pyodide(root)
    check_with_turn()
    check_behind_nginx()
    check_receivers(root)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
