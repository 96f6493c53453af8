"""What ``fapengine inspect`` finds in files: a row for each kind in :mod:`.kinds`, a module for related kinds."""
