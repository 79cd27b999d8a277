"""streamkit: a frame-stream graph engine whose elements come from plugins.

The public names; each is imported when it is first used, so that starting stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from streamkit.element.base import Element as Element
    from streamkit.element.branching import Combine as Combine
    from streamkit.element.branching import Split as Split
    from streamkit.element.pad import Direction as Direction
    from streamkit.element.pad import Pad as Pad
    from streamkit.element.pad import PadTemplate as PadTemplate
    from streamkit.element.pad import Presence as Presence
    from streamkit.element.property import Property as Property
    from streamkit.element.property import SettingsOf as SettingsOf
    from streamkit.element.property_text import Choice as Choice
    from streamkit.element.sink import OnError as OnError
    from streamkit.element.sink import Sink as Sink
    from streamkit.element.source import Source as Source
    from streamkit.element.transform import Transform as Transform
    from streamkit.errors import DescriptionError as DescriptionError
    from streamkit.errors import ElementFailure as ElementFailure
    from streamkit.errors import NotNegotiated as NotNegotiated
    from streamkit.errors import PropertyError as PropertyError
    from streamkit.errors import ResourceError as ResourceError
    from streamkit.errors import StateError as StateError
    from streamkit.errors import StreamError as StreamError
    from streamkit.errors import StreamkitError as StreamkitError
    from streamkit.errors import write_remedy as write_remedy
    from streamkit.flow.caps import ANY as ANY
    from streamkit.flow.caps import Caps as Caps
    from streamkit.flow.caps import Structure as Structure
    from streamkit.flow.caps_values import FractionRange as FractionRange
    from streamkit.flow.caps_values import IntRange as IntRange
    from streamkit.flow.caps_values import ValueList as ValueList
    from streamkit.flow.events import CapsEvent as CapsEvent
    from streamkit.flow.events import DiscontinuityEvent as DiscontinuityEvent
    from streamkit.flow.events import EndOfStream as EndOfStream
    from streamkit.flow.events import EosEvent as EosEvent
    from streamkit.flow.events import Event as Event
    from streamkit.flow.events import Flushing as Flushing
    from streamkit.flow.events import FlushStart as FlushStart
    from streamkit.flow.events import FlushStop as FlushStop
    from streamkit.flow.events import GapEvent as GapEvent
    from streamkit.flow.events import Segment as Segment
    from streamkit.flow.events import SegmentEvent as SegmentEvent
    from streamkit.flow.frame import Capture as Capture
    from streamkit.flow.frame import Frame as Frame
    from streamkit.flow.frame import FrameFlags as FrameFlags
    from streamkit.flow.messages import Message as Message
    from streamkit.flow.messages import MessageKind as MessageKind
    from streamkit.flow.metadata import Detections as Detections
    from streamkit.flow.metadata import Features as Features
    from streamkit.flow.metadata import FeatureSpace as FeatureSpace
    from streamkit.flow.metadata import Pose as Pose
    from streamkit.flow.metadata import Provenance as Provenance
    from streamkit.flow.metadata import Registration as Registration
    from streamkit.flow.metadata import RegistrationStatus as RegistrationStatus
    from streamkit.flow.metadata import Track as Track
    from streamkit.flow.metadata import Tracks as Tracks
    from streamkit.flow.metadata import TrackState as TrackState
    from streamkit.flow.record import TRACKS_CAPS as TRACKS_CAPS
    from streamkit.flow.record import TrackRecord as TrackRecord
    from streamkit.flow.record import decode_record as decode_record
    from streamkit.flow.record import encode_record as encode_record
    from streamkit.flow.record import record_line as record_line
    from streamkit.flow.record import track_record as track_record
    from streamkit.flow.scaling import scale_metadata as scale_metadata
    from streamkit.flow.video import LUMA_CAPS as LUMA_CAPS
    from streamkit.flow.video import luma as luma
    from streamkit.flow.video import raw_video_caps as raw_video_caps
    from streamkit.graph.pipeline import Pipeline as Pipeline
    from streamkit.masking import mask_secrets as mask_secrets

_HOMES = {
    "streamkit.element.base": ("Element",),
    "streamkit.element.branching": ("Combine", "Split"),
    "streamkit.element.property_text": ("Choice",),
    "streamkit.element.pad": ("Direction", "Pad", "PadTemplate", "Presence"),
    "streamkit.element.property": ("Property", "SettingsOf"),
    "streamkit.element.sink": ("OnError", "Sink"),
    "streamkit.element.source": ("Source",),
    "streamkit.element.transform": ("Transform",),
    "streamkit.errors": (
        "DescriptionError", "ElementFailure", "NotNegotiated", "PropertyError", "ResourceError",
        "StateError", "StreamError", "StreamkitError", "write_remedy",
    ),
    "streamkit.flow.caps": ("ANY", "Caps", "Structure"),
    "streamkit.flow.caps_values": ("FractionRange", "IntRange", "ValueList"),
    "streamkit.flow.events": (
        "CapsEvent", "DiscontinuityEvent", "EndOfStream", "EosEvent", "Event", "FlushStart", "FlushStop",
        "Flushing", "GapEvent", "Segment", "SegmentEvent",
    ),
    "streamkit.flow.frame": ("Capture", "Frame", "FrameFlags"),
    "streamkit.flow.messages": ("Message", "MessageKind"),
    "streamkit.flow.metadata": (
        "Detections", "Features", "FeatureSpace", "Pose", "Provenance", "Registration", "RegistrationStatus",
        "Track", "TrackState", "Tracks",
    ),
    "streamkit.flow.record": (
        "TRACKS_CAPS", "TrackRecord", "decode_record", "encode_record", "record_line", "track_record",
    ),
    "streamkit.flow.scaling": ("scale_metadata",),
    "streamkit.flow.video": ("LUMA_CAPS", "luma", "raw_video_caps"),
    "streamkit.graph.pipeline": ("Pipeline",),
    "streamkit.masking": ("mask_secrets",),
}  # fmt: skip
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}
__all__ = sorted(_HOME_OF)  # noqa: PLE0605  the same names as above, written once


def __getattr__(name: str) -> object:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'streamkit' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME_OF})
