"""Looks at a stream or file from all sides."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import asdict
from operator import itemgetter
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit, urlunsplit

from streamkit import StreamkitError, choose_source, mask_secrets
from streamkit.output.names import FileNames, is_network, local_path
from streamkit_media.container import check_file
from streamkit_media.doctor.checks import stream_checks
from streamkit_media.doctor.report import Check, Report, Verdict
from streamkit_media.doctor.server import NoAnswer, ask_options
from streamkit_media.doctor.watch import Seen, watch
from streamkit_media.live.reachability import LIVE_SCHEMES, RTSP_SCHEMES, connection_failure, port_of
from streamkit_telemetry_formats.telemetryreader import NoTelemetry, TelemetryFile

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
        transport: tcp or udp, for RTSP.
        report_step: called with a line before each step that takes seconds; nothing by default.
    """
    if location.partition("://")[0].lower() in (*LIVE_SCHEMES, *RTSP_SCHEMES):
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
        factory, properties = "rtspsrc", {**properties, "location": location, "transport": transport}
        checks = _reach(location, timeout_s)
    else:
        factory, properties, transport = "livesrc", {**properties, "uri": location}, scheme
    if any(check.verdict is Verdict.BAD for check in checks):
        return _reported(where, checks)
    report_step(f"watching {where} for {seconds:g} s")
    seen = watch(factory, properties, 2 * timeout_s + 1, seconds)
    if not seen.packets:
        checks.append(Check("stream", Verdict.BAD, seen.error or f"no packet within {timeout_s:g} s"))
        return _reported(where, checks)
    checks += stream_checks(seen, is_live=True, transport=transport, is_rtsp=is_rtsp)
    return _reported(where, checks, _live_line(location, properties, seen))


def _reported(where: str, checks: list[Check], line: str = "") -> Report:
    """The report; what cannot be used gets no pipeline."""
    is_bad = any(check.verdict is Verdict.BAD for check in checks)
    return Report(where, tuple(checks), "" if is_bad else line)


def _reach(location: str, timeout_s: float) -> list[Check]:
    try:
        port, parts = port_of(location), urlsplit(location)
        host = parts.hostname or ""
    except ValueError as error:
        return [Check("address", Verdict.BAD, f"{error}; write rtsp://host:port/path")]
    if not host:
        return [Check("address", Verdict.BAD, "no host in it; write rtsp://host:port/path")]
    reason = connection_failure(host, port, timeout_s)
    if reason:
        return [Check("reach", Verdict.BAD, f"{reason}; check address, cable and firewall")]
    bare = urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))
    if parts.scheme == "rtsps":
        return [Check("reach", Verdict.GOOD, f"{host} port {port} answers")]
    try:
        server = ask_options(host, port, bare, timeout_s)
    except (NoAnswer, OSError) as error:
        return [Check("server", Verdict.BAD, f"{host} port {port}: {error}; is this an RTSP server?")]
    reached = f"{host} port {port}, connected in {server.connect_ms:.1f} ms"
    answered = f"{server.software or 'unnamed'}, answers in {server.answer_ms:.0f} ms ({server.status})"
    return [
        Check("reach", Verdict.GOOD, reached),
        Check("server", Verdict.GOOD, answered, asdict(server)),
    ]


def _live_line(location: str, properties: Mapping[str, Any], seen: Seen) -> str:
    parts = urlsplit(location)
    user, mark, host = parts.netloc.rpartition("@")
    bare = mask_secrets(urlunsplit(parts._replace(netloc=host)))
    secrets = " user-id=${user} user-pw=${password}" if mark and user else ""
    settings = "--set user=NAME --set password=SECRET " if secrets else ""
    if "transport" in properties:
        source = f"rtspsrc name=s location={bare}{secrets} transport={properties['transport']}"
    else:
        source = f"livesrc name=s uri={bare}{secrets}"
    pose, klv = _pose_parts(seen)
    queue = "queue max-size-buffers=1 leaky=downstream"
    line = f"{source} ! decode{pose} ! {queue} ! {TRACKING} ! zenohsink key=uav/1{klv}"
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
            return Report(where, (Check("file", Verdict.BAD, str(error)),), "")
        size = local_path(location).stat().st_size
        text = f"{size / 1e6:.1f} MB" if size >= 100_000 else f"{size} bytes"
        checks.append(Check("file", Verdict.GOOD, text, {"bytes": size}))
    seen = watch("filesrc", {"location": location}, max(timeout_s, 10.0), None)
    if not seen.packets and is_network(location):
        return Report(where, (*checks, Check("stream", Verdict.BAD, seen.error or "no packet came")), "")
    if not seen.packets:
        return _telemetry_file(location, checks, seen.error)
    checks += stream_checks(seen, is_live=False, transport="")
    if len(seen.packets) == 1:
        return _reported(where, checks, _one_frame_line(location, seen))
    pose, klv = _pose_parts(seen)
    if not pose and (sidecar := telemetry_beside(location)) is not None:
        checks[-1] = Check(
            "telemetry", Verdict.GOOD, f"none inside; {sidecar.name} next to it has the positions"
        )
        pose = f" ! posesync location={in_description(str(sidecar))}"
    source = f"filesrc name=s location={mask_secrets(in_description(location))}"
    tracks = f"tracksink location=tracks.jsonl if-exists=fail{klv}"
    return _reported(where, checks, f'streamkit launch "{source} ! decode{pose} ! {TRACKING} ! {tracks}"')


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
        more = (
            f"; nor telemetry: {str(fault).removeprefix(location + ': ')}"
            if isinstance(fault, NoTelemetry)
            else ""
        )
        checks.append(Check("stream", Verdict.BAD, error + more))
        return _reported(where, checks)
    assert first is not None
    assert last is not None
    counts = file.reader.counts()
    length = (last.pts - first.pts) / 1e9
    text = f"{counts['poses']} positions over {length:.1f} s, {first.source}"
    facts = {"positions": counts["poses"], "seconds": length, "source": first.source, **counts}
    complaint = file.reader.complaint()
    verdict = Verdict.NOTE if complaint else Verdict.GOOD
    check = Check("telemetry", verdict, f"{text}; {complaint}" if complaint else text, facts)
    pose = f"posesync location={in_description(location)}"
    line = f'streamkit launch "filesrc location=VIDEO ! decode ! {pose} ! fakesink"'
    return Report(where, (*checks, check), line)


def _pose_parts(seen: Seen) -> tuple[str, str]:
    pad, counts = seen.best_telemetry
    return (" ! posesync name=p", f"  s.{pad} ! p.telemetry") if counts["poses"] else ("", "")


def in_description(value: str) -> str:
    """A value as a description within double quotes of a shell needs it: bare, or with blanks escaped."""
    return re.sub(r"([^\w./:@%+,=-])", r"\\\1", value)
