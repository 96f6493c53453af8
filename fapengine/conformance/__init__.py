"""Suites that others run against their own programs: ``python -m fapengine.conformance``.

Each case has a number, a place in the documents that it checks, and a sentence; verdicts are a table or JSON.
"""
