"""Text as it comes: its normal form, its words and scripts, SSML."""
