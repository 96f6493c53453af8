"""Reports of ``fapengine inspect``: one row per kind of file in :mod:`.kinds`, one module for related kinds."""
