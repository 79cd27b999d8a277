"""How frames, events and messages reach another process: sockets, shared memory, and a typed encoding."""
