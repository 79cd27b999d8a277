"""The files and URLs that the page can play: what each is, its pipeline, and why one cannot be played."""

from __future__ import annotations

from os.path import isfile  # unlike Path's, False where a name is too long or a folder is closed
from pathlib import Path
from urllib.parse import urlsplit

from streamkit import (
    ANY,
    Caps,
    ElementFailure,
    Pipeline,
    RecordFile,
    choose_source,
    display_size,
    mask_secrets,
)

PAGE_CODECS = ("video/x-h264", "video/x-h265")  # of packets that browsers decode; else they get images


def is_source(text: str) -> bool:
    """Whether an argument is a file, or the URL or number of a camera, and not a key."""
    return "://" in text or isfile(text) or choose_source(text).is_live


def is_run(text: str) -> bool:
    """Whether an argument is the records of a finished run."""
    return Path(text).suffix.lower() == ".jsonl"


def pipeline_for(location: str, *, encodes: bool = False) -> tuple[str, str]:
    """The name of the pipeline for a location, and the element and property that take it.

    Args:
        location: file, URL or camera.
        encodes: whether the video of a live feed is encoded anew.
    """
    if is_run(location):
        return "run.pipe", "tracksrc location"
    source = choose_source(location)
    name = "camera.pipe" if source.is_live else "file.pipe"
    if source.is_live and (encodes or gives_images(location)):
        name = "encoded_camera.pipe"
    if isfile(location) and not has_page_codec(caps_of(location)):
        name = "images.pipe"
    return name, f"{source.element} {source.property}"


def local_camera(location: str) -> str:
    """The device of a live location that is a camera of this machine; "" where it is another."""
    if location.isdecimal():
        return f"/dev/video{location}"
    parts = urlsplit(location)
    return parts.path if parts.scheme in ("", "v4l2") else ""


def gives_images(location: str) -> bool:
    """Whether a live location gives JPEG images: a camera of this machine, or a web camera."""
    return bool(local_camera(location)) or urlsplit(location).path.endswith((".mjpg", ".mjpeg"))


def unplayable(location: str, *, with_records: bool = False) -> str:
    """Why a file cannot be played; "" where it can, and for a URL or camera, which is opened with the page.

    Args:
        location: file or URL.
        with_records: whether it is the video of a finished run, of which the page gets the packets.
    """
    if choose_source(location).is_live or "://" in location:
        return ""
    try:
        caps = caps_of(location)
    except ElementFailure as error:
        return str(error.cause)
    if with_records and not has_page_codec(caps):
        remedy = f"filesrc location={location} ! decode ! videofilesink location=flight.mp4"
        name = "" if caps is None else caps.name
        return f"{location}: browsers decode no {name}; convert it: streamkit launch '{remedy}'"
    return ""


def has_page_codec(caps: Caps | None) -> bool:
    """Whether browsers decode packets of these caps."""
    return caps is not None and caps.name in PAGE_CODECS


def wrong_address(url: str) -> str:
    """Why no element receives from a URL; "" where one does, though nothing may answer there."""
    try:
        source, host = choose_source(url), urlsplit(url).hostname
    except ValueError as error:
        return f"{mask_secrets(url)!r}: {error}"
    scheme, mark, _ = url.partition("://")
    if not source.is_live and mark and scheme.lower() != "file" and not host:
        return f"{mask_secrets(url)!r} names no host; write for example {scheme}://camera/video.mjpg"
    if not source.is_live:
        return ""
    if (device := local_camera(url)) and not Path(device).exists():
        return f"{device}: there is no such camera; check the name: ls /dev/video*"
    pipeline = Pipeline.parse(f"{source.element} name=camera ! fakesink")
    pipeline["camera"].set_property(source.property, url)
    try:
        with pipeline:
            pipeline.ready()  # checks the address, and connects to nothing
    except ElementFailure as error:
        return str(error.cause)
    return ""


def size_conflict(records: str, video: str) -> str:
    """Why records are not those of a video: frames of another size; "" where none is known to differ."""
    caps = caps_of(video)
    size = None if caps is None else display_size(caps)
    _, record = next(iter(RecordFile(records)), (0, None))
    recorded = (None, None) if record is None else (record.width, record.height)
    if size is None or None in recorded or size == recorded:
        return ""
    return "{}: the tracks are of frames of {} x {} px, the video has {} x {}; give their own video".format(
        video, *recorded, *size
    )


def caps_of(file: str) -> Caps | None:
    """The caps of a file's packets or records, as far as its head tells.

    Raises:
        ElementFailure: the file cannot be played; `cause` says why.
    """
    element = "tracksrc" if is_run(file) else choose_source(file).element
    pipeline = Pipeline.parse(f"{element} name=file ! fakesink")
    pipeline["file"].location = file
    with pipeline:
        pipeline.ready()
        caps: Caps | None = pipeline["file"].negotiate(ANY)
    return caps
