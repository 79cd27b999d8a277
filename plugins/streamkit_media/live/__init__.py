"""Live sources: connections that are made again, watched from outside, and never fall behind.

The way of a packet: a `LiveInput` opens a connection, with FFmpeg or a socket of its own (`liveinput`,
`datagraminput`, `rtsp.rtspinput`), and gives packets of whole frames (`accessunits`). A `LiveConnection`
reads it in a thread, gives each packet its number and times (`timeline`), and queues it for the source, whose
thread may be slow (`slowconsumer`). The `LiveSource`, `livesrc` or `rtspsrc`, makes one connection after
another, each an epoch of its own, with the retries of an `Endpoint`.
"""
