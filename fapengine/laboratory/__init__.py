"""The laboratory: recordings in, a face model out. Joins ``capture``, ``models`` and ``trajectory``; pure."""
