"""FAP streams: the binary FBA bitstream and the text formats."""
