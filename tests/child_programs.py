"""Programs that a pipeline has started, as the kernel lists them."""

from pathlib import Path


def programs_at(port: int, pipe: bytes) -> list[int]:
    """Processes with a port and a pipe in their arguments, also such as have ended and are not reaped."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0") if entry.name.isdigit() else []
        except OSError:
            continue  # ended meanwhile
        if pipe in words and any(f":{port}".encode() in word for word in words):
            found.append(int(entry.name))
    return found
