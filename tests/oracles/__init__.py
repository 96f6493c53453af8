"""Programs of others open what we write: ``make oracles`` fetches those that a clone lacks, and runs these."""
