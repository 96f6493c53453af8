"""Text input: its normal form, words, pieces and scripts, and SSML."""
