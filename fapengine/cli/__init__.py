"""The command line: one file a verb. Exit codes: 0 done, 1 data, 2 usage, 3 resource."""

from fapengine.cli.main import main

__all__ = ["main"]
