"""Phones: timing formats, phone sets, phones to visemes."""
