"""Many live faces, without sockets, files or a clock: commands and the time go in, FAP frames come out."""
