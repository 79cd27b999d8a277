"""Examines a stream or file: all checks, and a pipeline line to begin with."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from operator import itemgetter
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit, urlunsplit

from streamkit import StreamkitError, choose_source, mask_secrets
from streamkit.output.names import FileNames, is_network, local_path
from streamkit_media.container import check_file, open_container, video_stream
from streamkit_media.doctor.checks import Check, Report, bad, good, good_if, is_usable, stream_checks
from streamkit_media.doctor.server import NoAnswer, ask_options
from streamkit_media.doctor.watch import Seen, watch
from streamkit_media.files.completeness import declared_length_s, tolerance_s
from streamkit_media.live.reachability import RTSP_SCHEMES, port_of, server_failure
from streamkit_telemetry_formats.telemetryreader import NoTelemetry, TelemetryFile

FILE_PACKETS = 3000  # of the beginning of a file
PLAYED_TOLERANCES = 1.5  # of its end
VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv"})  # of files that are no bare telemetry
TRACKING = "stitch ! framediff ! waveleteigen ! particletrack"


def examine(
    location: str,
    seconds: float,
    timeout_s: float,
    transport: str,
    report_step: Callable[[str], object] = str,
) -> Report:
    """Makes all checks.

    Args:
        location: path or URL.
        seconds: how long to watch a live stream.
        timeout_s: limit for connecting and for silence.
        transport: tcp, udp or auto, for RTSP.
        report_step: called with a line before each step that takes seconds; nothing by default.
    """
    if choose_source(location).is_live:
        return _examine_live(location, seconds, timeout_s, transport, report_step)
    return _examine_file(location, timeout_s)


# A live stream.


def _examine_live(
    location: str, seconds: float, timeout_s: float, transport: str, report_step: Callable[[str], object]
) -> Report:
    where = mask_secrets(location)
    report_step(f"connecting to {where}, {timeout_s:g} s at most")
    scheme = location.partition("://")[0].lower()
    is_rtsp, checks = scheme in RTSP_SCHEMES, list[Check]()
    properties: dict[str, Any] = {"reconnect": "never", "timeout_s": timeout_s}
    if is_rtsp:
        properties |= {"location": location, "transport": transport}
        checks = _reach(location, timeout_s)
    else:
        properties["uri"] = location
    if not is_usable(checks):
        return _report(where, checks)
    report_step(f"watching {where} for {seconds:g} s")
    seen = watch("rtspsrc" if is_rtsp else "livesrc", properties, 2 * timeout_s + 1, seconds)
    if not seen.packets:
        checks.append(bad("stream", seen.error or f"no packet within {timeout_s:g} s"))
        return _report(where, checks)
    checks += stream_checks(seen, is_live=True, transport=seen.carrier, is_rtsp=is_rtsp)
    proven = "tcp" if seen.carrier == "tcp" else transport
    source = f"rtspsrc name=s location={{}} transport={proven}" if is_rtsp else "livesrc name=s uri={}"
    return _report(where, checks, _live_line(location, source, seen))


def _report(where: str, checks: Sequence[Check], line: str = "") -> Report:
    """The report; what cannot be used gets no pipeline."""
    return Report(where, tuple(checks), line if is_usable(checks) else "")


def _reach(location: str, timeout_s: float) -> list[Check]:
    try:
        port, parts = port_of(location), urlsplit(location)
    except ValueError as error:
        return [bad("address", f"{error}; write rtsp://host:port/path")]
    host = parts.hostname or ""
    if not host:
        return [bad("address", "no host in it; write rtsp://host:port/path")]
    if reason := server_failure(location, timeout_s):
        return [bad("reach", f"{reason}; check address, cable and firewall")]
    if parts.scheme == "rtsps":
        return [good("reach", f"{host} port {port} answers")]
    bare = urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))
    try:
        server = ask_options(host, port, bare, timeout_s)
    except (NoAnswer, OSError) as error:
        return [bad("server", f"{host} port {port}: {error}; is this an RTSP server?")]
    name, status = server["software"] or "unnamed", server["status"]
    return [
        good("reach", f"{host} port {port}, connected in {server['connect_ms']:.1f} ms"),
        good("server", f"{name}, answers in {server['answer_ms']:.0f} ms ({status})", **server),
    ]


def _live_line(location: str, source: str, seen: Seen) -> str:
    """The line for a source whose location is to be filled in."""
    parts = urlsplit(location)
    user, mark, host = parts.netloc.rpartition("@")
    bare = mask_secrets(urlunsplit(parts._replace(netloc=host)) if mark else location)
    settings = ""
    if mark and user:
        settings, bare = (
            "--set user=NAME --set password=SECRET ",
            f"{bare} user-id=${{user}} user-pw=${{password}}",
        )
    pose, klv = _pose_parts(seen)
    queue = "queue max-size-buffers=1 leaky=downstream"
    line = f"{source.format(bare)} ! decode{pose} ! {queue} ! {TRACKING} ! zenohsink key=uav/1{klv}"
    return f"streamkit launch {settings}'{line}'"


# A file.


def _examine_file(location: str, timeout_s: float) -> Report:
    if choose_source(location).element == "multifilesrc":  # the first stands for all
        location = str(min(FileNames(location).existing(), default=(location, 0), key=itemgetter(1))[0])
    where, checks = mask_secrets(location), list[Check]()
    if not is_network(location):
        try:
            check_file(location)
        except StreamkitError as error:
            return _report(where, [bad("file", str(error))])
        size = local_path(location).stat().st_size
        text = f"{size / 1e6:.1f} MB" if size >= 100_000 else f"{size} bytes"
        checks.append(good("file", text, bytes=size))
    seen = watch("filesrc", {"location": location}, max(timeout_s, 10.0), None, FILE_PACKETS)
    if not seen.packets and is_network(location):
        return _report(where, [*checks, bad("stream", seen.error or "no packet came")])
    if not seen.packets:
        return _telemetry_file(location, checks, seen.error)
    if len(seen.packets) >= FILE_PACKETS and not is_network(location):
        seen.shortfall = _end_of(location, timeout_s)
    checks += stream_checks(seen, is_live=False, transport="")
    if len(seen.packets) == 1:
        return _report(where, checks, _one_frame_line(location, seen))
    pose, klv = _pose_parts(seen)
    if not pose and (sidecar := telemetry_beside(location)) is not None:
        checks[-1] = good("telemetry", f"none inside; {sidecar.name} next to it has the positions")
        pose = f" ! posesync location={in_description(str(sidecar))}"
    source = f"filesrc name=s location={mask_secrets(in_description(location))}"
    tracks = f"tracksink location=tracks.jsonl if-exists=fail{klv}"
    return _report(where, checks, f'streamkit launch "{source} ! decode{pose} ! {TRACKING} ! {tracks}"')


def _end_of(location: str, timeout_s: float) -> str:
    """The shortfall at the end of a long file, whose beginning alone was read; "" if it is whole."""
    with suppress(StreamkitError), open_container(location) as container:
        length_s = declared_length_s(container, video_stream(container, location))
        if length_s is not None:
            begin_s = max(0.0, length_s - PLAYED_TOLERANCES * tolerance_s(length_s))
            end = watch("filesrc", {"location": location, "start_s": begin_s}, max(timeout_s, 10.0), None)
            return end.shortfall
    return ""


def telemetry_beside(location: str) -> Path | None:
    """The subtitle file with DJI telemetry that has the video's name, as the drone stores it."""
    if is_network(location):
        return None
    path = local_path(location)
    for suffix in (".SRT", ".srt"):
        with suppress(OSError, ValueError), closing(TelemetryFile(path.with_suffix(suffix))) as file:
            if file.next() is not None:
                return path.with_suffix(suffix)
    return None


def _one_frame_line(location: str, seen: Seen) -> str:
    """A mosaic of a photograph and those with the next numbers; without them, the frame alone."""
    path = local_path(location)
    number = re.search(r"\d{2,}(?!.*\d)", path.stem)
    is_photograph = seen.kept[0].caps.name.startswith("image/") and not is_network(location)
    if not is_photograph or number is None or "%" in location or not _has_next(path, number):
        shown = mask_secrets(in_description(location))
        return f'streamkit launch "filesrc location={shown} ! decode ! fakesink"'
    digits = number.group()
    name = f"{path.stem[: number.start()]}%0{len(digits)}d{path.stem[number.end() :]}{path.suffix}"
    source = f"multifilesrc location={in_description(str(path.with_name(name)))} start-index={int(digits)}"
    return f'streamkit launch "{source} ! decode ! stitch location=mosaic-%d.png ! fakesink"'


def _has_next(path: Path, number: re.Match[str]) -> bool:
    following = f"{int(number.group()) + 1:0{len(number.group())}d}"
    return path.with_stem(f"{path.stem[: number.start()]}{following}{path.stem[number.end() :]}").exists()


def _telemetry_file(location: str, checks: list[Check], error: str) -> Report:
    """A file without video may hold telemetry."""
    where = mask_secrets(location)
    try:
        with closing(TelemetryFile(local_path(location))) as file:
            first = last = file.next()
            while (sample := file.next()) is not None:
                last = sample
    except (OSError, ValueError) as fault:
        reason = str(fault).removeprefix(location + ": ")
        is_video = Path(where).suffix.lower() in VIDEO_SUFFIXES
        more = f"; nor telemetry: {reason}" if isinstance(fault, NoTelemetry) and not is_video else ""
        return _report(where, [*checks, bad("stream", error + more)])
    assert first is not None
    assert last is not None
    counts, source = file.reader.counts(), first.source
    length = (last.pts - first.pts) / 1e9
    text = f"{counts['poses']} positions over {length:.1f} s, {source}"
    if complaint := file.reader.complaint():
        text += f"; {complaint}"
    facts = {"positions": counts["poses"], "seconds": length, "source": source, **counts}
    pose = f"posesync location={in_description(location)}"
    line = f'streamkit launch "filesrc location=VIDEO ! decode ! {pose} ! fakesink"'
    return _report(where, [*checks, good_if(not complaint, "telemetry", text, **facts)], line)


def _pose_parts(seen: Seen) -> tuple[str, str]:
    pad, counts = seen.best_telemetry
    return (" ! posesync name=p", f"  s.{pad} ! p.telemetry") if counts["poses"] else ("", "")


def in_description(value: str) -> str:
    """A value as a description within double quotes of a shell needs it: bare, or with blanks escaped."""
    return re.sub(r"([^\w./:@%+,=-])", r"\\\1", value.replace("\\", r"\\"))
