"""Nightly fault injection: ``make faults``, or ``python -m tests.faults``. A few moments of it run as a test.

At random moments something is killed: a command that writes, a server, its voice, its ear, its guard, its sender, a
browser, an agent's painter or recognizer. Afterwards files are whole, faces rest, those who were not killed go on, and
nothing runs on that should not.
"""
