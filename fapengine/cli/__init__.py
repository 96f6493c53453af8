"""The command line: one module per command. Exit codes: 0 success, 1 data, 2 usage, 3 resource."""

import os
from importlib.util import find_spec

# Matrices are small here: threads of a product wait for each other for longer than they work. NumPy reads it once.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if find_spec("typer") and find_spec("rich"):
    from fapengine.cli.main import main
else:
    from fapengine._late import require
    from fapengine.cli._ending import run_to_the_end

    def main() -> None:
        """Report that typer or rich is missing; Python can use fapengine without them."""
        run_to_the_end(lambda: require("command line", typer="typer", rich="rich"))


__all__ = ["main"]
