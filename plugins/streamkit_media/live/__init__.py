"""Live sources: connections that are made again, watched from outside, and never fall behind.

The states of a source, each reported as an element message `connection`:

    connecting ---> connected ---> (the stream ends, or fails) ---> retrying ---> connecting ...
                                    silence: stalled first           no more tries: gave-up

- `livesource`: the base of `livesrc` and `rtspsrc`. Its thread, the engine's, makes one `LiveConnection`
  after another, each an epoch of its own, and gives its packets to the pads. It waits for a packet for half
  a second at a time, and for the delay before a retry; both waits end when the pipeline stops.
- `endpoint`: what `rtspclientsink` shares with them: address, credentials, TLS, and whether to try again.
- `connection`: a `LiveConnection` has a thread of its own, in which it opens its input and reads it to the
  end, and a queue to the source's thread. A slow consumer makes the queue drop packets up to a keyframe;
  frames that have waited are decoded and not shown, up to the newest. A watchdog in the source's thread
  notices where FFmpeg does not keep its limit.
- `timeline`: numbers and times of the packets over all connections.
- `liveinput`: a `LiveInput` opens a connection, gives packets of whole frames, and can be cut from another
  thread. FFmpeg opens a URL (`UrlInput`, and `rtsp.rtspinput`) or a camera (`camerainput`); a transport
  stream is received here (`datagraminput`, `srtinput`) and demultiplexed by FFmpeg.
- `accessunits`: joins what RTP and MPEG-TS carry to frames, without waiting for the next frame as FFmpeg
  does.
- `transportstream`: transport packets in datagrams, and where a sender begins another stream.
- `sockets`: cuts connections of FFmpeg, which waits for its own time limit otherwise.
- `reachability`: why a server cannot be reached or trusted.

Opening, and each read, takes `timeout-s` at most. Stopping cuts the connection and waits for its thread for
1.8 s; one that is in a call that cannot be cut, such as a look-up of a name, ends at its own limit.
"""
