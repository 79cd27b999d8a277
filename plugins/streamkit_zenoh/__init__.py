"""Track records over zenoh: publishing, receiving, and writing them to a file.

`endpoints`, `keys`, `session`, `presence`, `sender` and `mailbox` import nothing of streamkit and serve as a
small library by themselves: a zenoh session that opens and closes within bounds, finds its partners on the
same machine without a router, and loses no record unseen.
"""
