"""Many faces in real time, without a socket, a file or a clock: commands and the time go in, FAP frames come out."""
