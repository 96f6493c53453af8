"""The owner of each session: one rule (:mod:`.rule`) for processes and machines."""
