"""Alphabets of phones, and sets of phones that tools use: labels into IPA."""
