"""The checks of what came out of a stream."""

from __future__ import annotations

from dataclasses import asdict
from fractions import Fraction

from streamkit_media.doctor.measure import Decoded, Measured, measure, try_decoding
from streamkit_media.doctor.report import Check, Verdict
from streamkit_media.doctor.watch import Seen

LONG_KEYFRAME_INTERVAL_S = 2.0
LARGE_JITTER_MS = 50.0
RATE_TOLERANCE = 0.1
HEADROOM = 1.5  # decoding is not the only work
REFUSALS = {
    "bad_packets": "damaged",
    "broken_tags": "values not of the length or range of their tag",
    "broken_subtitles": "of which times or position cannot be read",
}
ENOUGH_FRAMES = 10  # to speak of a rate


def stream_checks(seen: Seen, *, is_live: bool, transport: str) -> list[Check]:
    """All checks of a stream that gave packets."""
    found = measure(seen.packets)
    decoded = try_decoding(seen.kept)
    checks = [
        _format_check(seen, transport),
        _decoding_check(decoded, found.rate if is_live else None),
        _rate_check(seen, found),
        _keyframe_check(found, is_live),
    ]
    if is_live:
        checks += [_jitter_check(found), _clock_check(seen)]
    return [*checks, _loss_check(found), _telemetry_check(seen)]


def _format_check(seen: Seen, transport: str) -> Check:
    caps = seen.kept[0].caps
    width, height = caps.get("width"), caps.get("height")
    size = f"{width!s} x {height!s}" if width else "size unknown before the first key frame"
    over = f" over {transport.upper()}" if transport else ""
    facts = {"codec": caps.name, "width": width, "height": height, "transport": transport}
    return Check("stream", Verdict.GOOD, f"{caps.name}, {size}{over}", facts)


def _decoding_check(decoded: Decoded, live_rate: float | None) -> Check:
    facts = asdict(decoded)
    if not decoded.pictures:
        why = f": {decoded.error}" if decoded.error else ""
        text = f"none of {decoded.packets} packets decodes{why}; the video is damaged, encrypted or cut short"
        return Check("decoding", Verdict.BAD, text, facts)
    text = f"{decoded.pictures} frames of {decoded.packets} packets"
    if decoded.error:
        return Check("decoding", Verdict.NOTE, f"{text}, the others do not decode: {decoded.error}", facts)
    if decoded.damaged:
        return Check("decoding", Verdict.NOTE, f"{text}, {decoded.damaged} of them damaged", facts)
    if decoded.rate is None or decoded.pictures < ENOUGH_FRAMES:
        return Check("decoding", Verdict.GOOD, text, facts)
    text += f", {decoded.rate:.0f}/s on this machine"
    if live_rate is not None and decoded.rate < live_rate * HEADROOM:
        hint = f"the stream has {live_rate:.0f}/s: ask the camera for less, or set decode skip="
        return Check("decoding", Verdict.NOTE, f"{text}; {hint}", facts)
    return Check("decoding", Verdict.GOOD, text, facts)


def _rate_check(seen: Seen, found: Measured) -> Check:
    declared = seen.kept[0].caps.get("framerate")
    declared_rate = float(declared) if isinstance(declared, int | Fraction) else None
    facts = {"declared": declared_rate, "measured": found.rate, "bit_rate": found.bit_rate}
    if found.rate is None:
        return Check("frame rate", Verdict.NOTE, "too few frames to measure it", facts)
    text = f"{found.rate:.2f}/s measured"
    text += f", {declared_rate:.2f}/s declared" if declared_rate else ", none declared"
    text += f", {found.bit_rate / 1e6:.2f} Mbit/s" if found.bit_rate else ""
    if found.is_variable:
        return Check("frame rate", Verdict.NOTE, f"{text}; it varies", facts)
    is_off = declared_rate is not None and abs(found.rate - declared_rate) > RATE_TOLERANCE * declared_rate
    return Check("frame rate", Verdict.NOTE if is_off else Verdict.GOOD, text, facts)


def _keyframe_check(found: Measured, is_live: bool) -> Check:
    interval = found.keyframe_interval_s
    facts = {"interval_s": interval, "seen": found.keyframes}
    if interval is None:
        text = (
            f"{found.keyframes} seen; set the camera's key-frame interval to 1 or 2 s" if is_live else "one"
        )
        return Check("key frames", Verdict.NOTE if is_live else Verdict.GOOD, text, facts)
    if interval > LONG_KEYFRAME_INTERVAL_S and is_live:
        text = f"every {interval:.1f} s; after a loss the video recovers only then: 1 or 2 s are better"
        return Check("key frames", Verdict.NOTE, text, facts)
    return Check("key frames", Verdict.GOOD, f"every {interval:.1f} s at most", facts)


def _jitter_check(found: Measured) -> Check:
    if found.jitter_ms is None:
        return Check("jitter", Verdict.NOTE, "too few frames to measure it")
    verdict = Verdict.NOTE if found.jitter_ms > LARGE_JITTER_MS else Verdict.GOOD
    hint = "; raise latency=" if verdict is Verdict.NOTE else ""
    return Check("jitter", verdict, f"{found.jitter_ms:.1f} ms{hint}", {"jitter_ms": found.jitter_ms})


def _loss_check(found: Measured) -> Check:
    total = found.packets + found.missing
    facts = {"missing": found.missing, "received": found.packets}
    if not found.missing:
        return Check("loss", Verdict.GOOD, f"none of {total} frames is missing", facts)
    return Check("loss", Verdict.NOTE, f"{found.missing} of {total} frames are missing", facts)


def _clock_check(seen: Seen) -> Check:
    if seen.origins.get("rtcp"):
        return Check("clock", Verdict.GOOD, "capture times by the server's RTCP reports", dict(seen.origins))
    text = "no RTCP sender report yet: capture times are those of arrival here"
    return Check("clock", Verdict.NOTE, text, dict(seen.origins))


def _telemetry_check(seen: Seen) -> Check:
    pad, counts = seen.best_telemetry
    kind, total = f"MISB KLV, pad {pad}", counts["good_packets"] + counts["bad_packets"]
    if pad == "subtitle":
        kind, total = "DJI subtitles", counts["subtitles"]
    refused = [f"{counts[name]} {words}" for name, words in REFUSALS.items() if counts[name]]
    if total and (counts["poses"] or refused):
        text = ", ".join([f"{kind}: {total} packets, {counts['poses']} with a position", *refused])
        return Check("telemetry", Verdict.NOTE if refused else Verdict.GOOD, text, counts)
    if total:
        return Check("telemetry", Verdict.NOTE, f"{kind}: {total} packets, none with a position", counts)
    if counts["skipped_bytes"]:
        text = f"{counts['skipped_bytes']} bytes of KLV, but no packet of ST 0601 or EG 0104"
        return Check("telemetry", Verdict.NOTE, text, counts)
    text = "none inside; posesync location=FILE.SRT reads it from a file"
    return Check("telemetry", Verdict.NOTE, text, counts)
