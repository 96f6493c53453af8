"""Sinks, which send faces to other programs: a row for each kind in :mod:`.kinds`, a module for each transport."""
