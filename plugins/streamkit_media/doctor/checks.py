"""Checks of what came out of a stream, with their verdicts, and how they are shown."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any

from streamkit import mask_secrets
from streamkit_media.codecs import OTHER
from streamkit_media.decoding.decode import INTERLACED, NOT_SQUARE
from streamkit_media.decoding.presentation_times import WRONG_TIMES
from streamkit_media.doctor.measure import Decoded, Measured, measure, try_decoding
from streamkit_media.doctor.watch import Seen

LONG_KEYFRAME_INTERVAL_S = 2.0
LARGE_JITTER_MS = 50.0
RATE_TOLERANCE = 0.1
HEADROOM = 1.5  # decoding is not the only work
# A packet may be a second field, or a frame that is not shown (the alternate reference of VP8, one in seven).
MIN_DECODED, PACKETS_LEFT_OUT = 0.8, 3
REFUSALS = {
    "bad_packets": "damaged",
    "broken_tags": "values not of the length or range of their tag",
    "broken_subtitles": "of which times or position cannot be read",
}
ENOUGH_FRAMES = 10  # to speak of a rate
OVERLAID = (
    "Graphics in the picture, as a logo, are tracked, too: put hudmask areas=X,Y,WIDTH,HEIGHT before stitch."
)
NO_TIMES = "a bare stream has no times"
Verdict = enum.StrEnum("Verdict", "GOOD NOTE BAD")


@dataclass(frozen=True, slots=True)
class Check:
    """One check."""

    name: str  # what was looked at
    verdict: Verdict  # good, note (worth knowing) or bad
    text: str  # what was found, for people, secrets masked; where it is not good, also what to do
    facts: dict[str, Any]  # the same for programs


def good(name: str, text: str, **facts: Any) -> Check:
    """A check that found nothing wrong."""
    return Check(name, Verdict.GOOD, mask_secrets(text), facts)


def note(name: str, text: str, **facts: Any) -> Check:
    """A check that found something worth knowing."""
    return Check(name, Verdict.NOTE, mask_secrets(text), facts)


def bad(name: str, text: str, **facts: Any) -> Check:
    """A check that says why the stream cannot be used."""
    return Check(name, Verdict.BAD, mask_secrets(text), facts)


def good_if(is_good: bool, name: str, text: str, **facts: Any) -> Check:
    """A good check, else a note."""
    return (good if is_good else note)(name, text, **facts)


def is_usable(checks: Iterable[Check]) -> bool:
    """Whether none of the checks is bad."""
    return all(check.verdict is not Verdict.BAD for check in checks)


@dataclass(frozen=True, slots=True)
class Report:
    """All checks of one stream."""

    location: str  # without passwords
    checks: tuple[Check, ...]  # in the order they were made
    pipeline: str  # a line to begin with; "" where the stream cannot be used

    @property
    def is_usable(self) -> bool:
        """Whether nothing is bad."""
        return is_usable(self.checks)

    def as_json(self) -> dict[str, Any]:
        """The report as JSON values."""
        return {"usable": self.is_usable, **asdict(self)}

    def as_text(self) -> str:
        """The report for people."""
        width = max((len(check.name) for check in self.checks), default=0)
        lines = [f"{check.verdict:<4}  {check.name:<{width}}  {check.text}" for check in self.checks]
        if self.pipeline:
            lines += ["", f"  {self.pipeline}"]
        if "! framediff" in self.pipeline:
            lines += ["", f"  {OVERLAID}"]
        return "\n".join(lines)


def stream_checks(seen: Seen, *, is_live: bool, transport: str, is_rtsp: bool = False) -> list[Check]:
    """All checks of a stream that gave packets; an RTSP server sends the times of capture."""
    found = measure(seen.packets)
    decoded = try_decoding(seen.kept)
    speed = _decoding_check(decoded, found.rate if is_live else None)
    checks = [_format_check(seen, transport, decoded.size), speed]
    if others := seen.unread_videos:
        text = f"one is looked at; video-stream={others[0]} of the source reads another of {others}"
        checks.append(note("videos", text, others=others))
    if decoded.interlaced:
        checks.append(note("fields", INTERLACED))
    if decoded.are_times_wrong or seen.are_times_wrong:
        checks.append(note("times", WRONG_TIMES))
    if decoded.pixel_shape:
        checks.append(note("pixels", NOT_SQUARE.format(shape=decoded.pixel_shape)))
    if found.packets == 1 and not is_live:
        return [*checks, note("length", seen.shortfall or "one frame"), _telemetry_check(seen, is_live=False)]
    if seen.shortfall:
        checks.append(note("length", seen.shortfall))
    checks += [_rate_check(seen, found), _keyframe_check(found, is_live)]
    if is_live:
        checks.append(_jitter_check(found))
    if is_rtsp:
        checks.append(_clock_check(seen))
    return [*checks, _loss_check(found), _telemetry_check(seen, is_live=is_live)]


def _format_check(seen: Seen, transport: str, size_seen: tuple[int, int] | None) -> Check:
    """The codec and size; a stream joined between keyframes has its size only in the frames."""
    caps = seen.kept[0].caps
    width, height = size_seen or (caps.get("width"), caps.get("height"))
    size = f"{width!s} x {height!s}" if width else "size unknown before the first keyframe"
    over = f" over {transport.upper()}" if transport else ""
    if caps.get("flipped"):
        over += ", which decode turns upside down"
    if rotation := caps.get("rotation"):
        over += f", which decode rotates counter-clockwise by {rotation!s} degrees"
    codec = caps.name if caps.name != OTHER else f"{caps.name}, codec={caps['codec']}"
    facts = {"codec": codec, "width": width, "height": height, "transport": transport}
    return good("stream", f"{codec}, {size}{over}", **facts)


def _decoding_check(decoded: Decoded, live_rate: float | None) -> Check:
    facts, text = asdict(decoded), f"{decoded.frames} frames of {decoded.packets} packets"
    text += f", {decoded.hidden} more are hidden by the file's edit list" if decoded.hidden else ""
    if not decoded.packets and decoded.error:
        return bad("decoding", decoded.error, **facts)
    if not decoded.frames:
        why = f": {decoded.error}" if decoded.error else ""
        text = f"none of {decoded.packets} packets decodes{why}; the video is damaged, encrypted or cut short"
        return bad("decoding", text, **facts)
    if decoded.error:
        return note("decoding", f"{text}, the others do not decode: {decoded.error}", **facts)
    most = decoded.packets - decoded.interlaced - decoded.hidden
    if decoded.frames < min(MIN_DECODED * most, most - PACKETS_LEFT_OUT):
        return note("decoding", f"{text}, the others give none: the video is damaged or incomplete", **facts)
    if decoded.damaged:
        return note("decoding", f"{text}, {decoded.damaged} of them damaged", **facts)
    if decoded.rate is None or decoded.frames < ENOUGH_FRAMES:
        return good("decoding", text, **facts)
    text += f", {decoded.rate:.0f}/s on this machine"
    if live_rate is not None and decoded.rate < live_rate * HEADROOM:
        text += f"; the stream has {live_rate:.0f}/s: ask the camera for less, or set decode skip="
        return note("decoding", text, **facts)
    return good("decoding", text, **facts)


def _rate_check(seen: Seen, found: Measured) -> Check:
    rate = seen.kept[0].caps.get("framerate")
    declared = float(rate) if isinstance(rate, int | Fraction) else None
    facts = {"declared": declared, "measured": found.rate, "bit_rate": found.bit_rate}
    if not found.has_times:
        return note("frame rate", f"{NO_TIMES}; decode gives them at {declared or 25:g}/s", **facts)
    if found.rate is None:
        return note("frame rate", "too few frames to measure it", **facts)
    text = f"{found.rate:.2f}/s measured"
    text += f", {declared:.2f}/s declared" if declared else ", none declared"
    text += f", {found.bit_rate / 1e6:.2f} Mbit/s" if found.bit_rate else ""
    text += "; it varies" if found.is_variable else ""
    is_off = declared is not None and abs(found.rate - declared) > RATE_TOLERANCE * declared
    return good_if(not (is_off or found.is_variable), "frame rate", text, **facts)


def _keyframe_check(found: Measured, is_live: bool) -> Check:
    interval = found.keyframe_interval_s
    is_good = not is_live or (interval is not None and interval <= LONG_KEYFRAME_INTERVAL_S)
    if found.keyframes and not found.has_times:
        is_good, text = True, f"{found.keyframes} in {found.packets} packets"
    elif not found.keyframes and not is_live:
        is_good, text = False, f"none in {found.packets} packets: nothing can be decoded whole"
    elif interval is None:
        text = "one" if is_good else f"{found.keyframes} seen; set the camera's keyframe interval to 1 or 2 s"
    elif is_good:
        is_each = found.keyframes >= found.packets
        text = "each frame is one" if is_each else f"every {interval:.1f} s at most"
    else:
        text = f"every {interval:.1f} s; after a loss the video recovers only then: 1 or 2 s are better"
    return good_if(is_good, "keyframes", text, interval_s=interval, seen=found.keyframes)


def _jitter_check(found: Measured) -> Check:
    if found.jitter_ms is None:
        return note("jitter", "too few frames to measure it")
    is_good = found.jitter_ms <= LARGE_JITTER_MS
    text = f"{found.jitter_ms:.1f} ms" + ("" if is_good else "; raise latency=")
    return good_if(is_good, "jitter", text, jitter_ms=found.jitter_ms)


def _loss_check(found: Measured) -> Check:
    if not found.has_times:
        return good("loss", f"{found.packets} frames; without times a missing one is not seen")
    text = f"none of {found.packets} frames is missing"
    if found.missing:
        text = f"{found.missing} of {found.packets + found.missing} frames are missing"
    return good_if(not found.missing, "loss", text, missing=found.missing, received=found.packets)


def _clock_check(seen: Seen) -> Check:
    if seen.origins["rtcp"]:
        return good("clock", "capture times by the server's RTCP reports", **seen.origins)
    text = "no RTCP sender report yet: capture times are those of arrival here"
    return note("clock", text, **seen.origins)


def _telemetry_check(seen: Seen, *, is_live: bool) -> Check:
    if photograph := seen.photograph:
        latitude, longitude = photograph.latitude, photograph.longitude
        text = f"in the photograph: {latitude:.6f} {longitude:.6f}, {photograph.source}"
        return good("telemetry", text, latitude=latitude, longitude=longitude)
    pad, counts = seen.best_telemetry
    kind, total = f"MISB KLV, pad {pad}", counts["good_packets"] + counts["bad_packets"]
    if pad == "subtitle":
        kind, total = "DJI subtitles", counts["subtitles"]
    refused = [f"{counts[name]} {words}" for name, words in REFUSALS.items() if counts[name]]
    if total and (counts["poses"] or refused):
        text = ", ".join([f"{kind}: {total} packets, {counts['poses']} with a position", *refused])
    elif total:
        text = f"{kind}: {total} packets, none with a position"
    elif counts["skipped_bytes"]:
        text = f"{counts['skipped_bytes']} bytes of KLV, but no packet of ST 0601 or EG 0104"
    else:
        is_video = not is_live and len(seen.packets) > 1
        text = "none inside" + ("; posesync location=FILE.SRT reads it from a file" if is_video else "")
    return good_if(bool(counts["poses"]) and not refused, "telemetry", text, **counts)
