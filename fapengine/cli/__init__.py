"""The command line: one file a verb. Exit codes: 0 done, 1 data, 2 usage, 3 resource.

It is written with typer and rich; where they are not installed, a smaller one takes its place.
"""

from importlib.util import find_spec

if find_spec("typer") and find_spec("rich"):
    from fapengine.cli.main import main
else:
    from fapengine.cli._small import main

__all__ = ["main"]
