"""A server of several processes and machines: the parent, its workers, and the store that machines share."""
