"""Whose a session is: one rule (:mod:`.rule`), which every entry point asks; of several machines and workers too."""
