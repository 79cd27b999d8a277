"""Masks secrets and bounds the length of texts that leave the process.

Forms of secrets:

    scheme://USER:PASSWORD@host     up to the last `@`, also where the password holds / # ? @ or a blank
    scheme://USER:PASSWORD          without a host: a port is a number
    USER:PASSWORD@host              an address without its scheme
    ...password=VALUE...            in a property, query or path, and in the text of a mapping
    PROTOCOL/USER@host:1#CONFIG     an endpoint: the user, and what configures the link, keys among it
    Authorization: SCHEME VALUE     a header

Errors are masked when they are made, messages when they are posted, graphs when they are printed.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from typing import Any

MASK = "***"
TEXT_LIMIT = 4000
END_LENGTH = 500  # what stands last in a long text is often its reason

NAMES = r"passw|passphrase|pwd|secret|token|credential|user[-_]?pw|api[-_]?key|private[-_]?key"
# Secret as the field of an address, plain words elsewhere; cameras have `loginpas`, clouds `X-Amz-Signature`.
QUERY_NAMES = r"key|pw|sig|sas|jwt|[\w-]{0,40}(?:auth|pass?|signature)"
SECRET_NAME = re.compile(NAMES, re.IGNORECASE)
ASSIGNED = rf"(?:(?:{NAMES})[\w-]{{0,40}}|(?<=[?&;#_])(?:{QUERY_NAMES}))"
# A value ends with its quote, at a blank, or where the next field begins: `..._password=VALUE_channel=1`.
QUOTED = r"""(?P<quote>["'])(?:\\.|(?!(?P=quote)).)*"""
BARE = r"""(?:\\.|(?![_,&;?][A-Za-z]{1,20}=|,\s)(?!["'](?:[\s,;:.)\]}>]|$))[^&;\s])*"""
NAMED = re.compile(
    rf"""{ASSIGNED}(?:["']?\s{{0,2}}=\s{{0,2}}(?P<value>{QUOTED}|{BARE})|["']\s{{0,2}}:\s{{0,2}}(?P<member>{
        QUOTED.replace("quote", "mark")
    }))""",
    re.IGNORECASE,
)
HEADER = re.compile(
    r"authorization[\"']?\s{0,2}[:=]\s{0,2}[\"']?(?P<value>\w{1,20} [^\s\"']+)", re.IGNORECASE
)
ENDPOINT_USER = re.compile(r"\b[a-z]{2,5}/(?P<value>[^\s,/@]{1,255})@[^\s,/@]{1,255}:\d")
ENDPOINT_CONFIG = re.compile(r"\b[a-z]{2,5}/[^\s,/#]{1,255}:\d{1,5}(?:\?[^\s#]{0,255})?#(?P<value>[^\s,]+)")
VARIABLE = re.compile(r"\$\{\w[\w-]*\}")  # names a value and is none

SCHEME = re.compile(r"(?<![^\s\"'=(,;<\[{])([A-Za-z][A-Za-z0-9+.\-]{0,63}):((?:\\?/){1,3})")
COLON = re.compile(r":|%3a", re.IGNORECASE)
PRESET = re.compile(r"@preset\b")
PATH = re.compile(r"[/?#\s]")
INSERTED = re.compile(r"\$\{[^}]*\}")
AUTHORITY = re.compile(r"[^/?#\s\"'@\[\]]*")
PORT = re.compile(r"(?:\d*|port)\W*", re.IGNORECASE)
WORD = re.compile(r"\S+")
BEFORE_USER = "='\"([{,<"

Span = tuple[int, int]


def is_secret_name(name: str) -> bool:
    """Whether the value of a property of this name must not be shown."""
    return SECRET_NAME.search(name) is not None


def mask_secrets(text: str) -> str:
    """The text with every secret in it replaced by `MASK`.

    A character that may or may not belong to a password is masked. Masking the masked text again changes
    nothing.
    """
    # A mask may join what stood before and behind a secret into one more value: mask until that is done.
    while (masked := _replaced(text, lambda _: MASK)) != text:
        text = masked
    return text


def star_secrets(text: str) -> str:
    """The text with every character of a secret replaced by a star, so that columns are unchanged."""
    return _replaced(text, lambda secret: re.sub(".", "*", secret))


def bounded(text: str) -> str:
    """The text, or its beginning and end with the number of characters left out between them."""
    left_out, head = len(text) - TEXT_LIMIT, TEXT_LIMIT - END_LENGTH
    return (
        text
        if left_out <= 0
        else f"{text[:head]} ... ({left_out} characters left out) ... {text[-END_LENGTH:]}"
    )


def presentable(text: str) -> str:
    """The text without secrets and with bounded length."""
    return bounded(mask_secrets(text))


def presentable_value(value: Any, show: Callable[[str], str] = presentable) -> Any:
    """A copy of a value with `show` applied to every text in it, also in mappings, lists and tuples."""
    if isinstance(value, str):
        shown = show(value)
        return value if shown == value else shown  # an enum's member stays one
    if isinstance(value, Mapping):
        return {
            presentable_value(name, show): MASK
            if isinstance(name, str) and isinstance(item, str) and item and is_secret_name(name)
            else presentable_value(item, show)
            for name, item in value.items()
        }
    if type(value) in (list, tuple):
        return type(value)(presentable_value(item, show) for item in value)
    return value


def secret_spans(text: str) -> list[Span]:
    """Spans of secrets in a text, (start, end), sorted and disjoint; in linear time."""
    if ":" not in text and "=" not in text and "%" not in text:
        return []
    spans = credential_spans(text)
    for match in NAMED.finditer(text):
        start, end = match.span("value" if match["value"] is not None else "member")
        start += text[start : start + 1] in ("'", '"')
        if end > start and not VARIABLE.fullmatch(text, start, end):
            spans.append((start, end))
    for form in (HEADER, ENDPOINT_USER, ENDPOINT_CONFIG):
        spans += [match.span("value") for match in form.finditer(text)]
    return _merged(spans)


def credential_spans(text: str) -> list[Span]:
    """Spans of user and password of URIs in a text."""
    if ":" not in text:
        return []
    marks = list(SCHEME.finditer(text))
    spans = [span for span in _of_addresses(text, marks) if span[1] > span[0]]
    return _merged([*spans, *_without_scheme(text, [mark.start() for mark in marks])])


def _of_addresses(text: str, marks: list[re.Match[str]]) -> Iterator[Span]:
    for index, mark in enumerate(marks):
        if mark[1].lower() == "file" and mark[2].count("/") == 3:
            continue
        start = mark.end()
        stop = marks[index + 1].start() if index + 1 < len(marks) else len(text)
        for end in ("\n", " ! "):  # of a line, of an element in a description
            found = text.find(end, start, stop)
            stop = found if found >= 0 else stop
        yield _user_information(text, start, stop)


def _user_information(text: str, start: int, stop: int) -> Span:
    """The part of an address before its host; empty where there is none."""
    authority = AUTHORITY.match(text, start, stop)
    assert authority is not None, "an empty authority matches"
    at = text.rfind("@", start, stop)
    while at > start and text[at - 1].isspace() and PRESET.match(text, at):
        at = text.rfind("@", start, at)
    if at >= 0 and COLON.search(text, start, at):
        return start, at
    before_path = PATH.search(text, start, stop)
    at = text.rfind("@", start, before_path.start() if before_path else stop)
    if at >= 0:
        return start, at
    _, mark, port = INSERTED.sub("0", authority.group()).rpartition(":")
    if mark and not PORT.fullmatch(port):
        word = WORD.match(text, start, stop)
        assert word is not None, "an authority with a port is not empty"
        return start, start + len(word.group().rstrip("\"'),.;:]}>"))
    return start, start


def _without_scheme(text: str, marks: list[int]) -> Iterator[Span]:
    """`user:password@` in words that begin no address and no path."""
    if "@" not in text:
        return
    for word in WORD.finditer(text):
        at, colon = word.group().rfind("@"), word.group().find(":")
        if not 0 < colon < at:
            continue
        nearest = bisect_left(marks, word.start())
        if nearest < len(marks) and marks[nearest] < word.start() + at:
            continue
        start = max(word.group().rfind(mark, 0, colon) for mark in BEFORE_USER) + 1
        if word.group()[start] not in "/.~":
            yield word.start() + start, word.start() + at


def _replaced(text: str, shown: Callable[[str], str]) -> str:
    pieces, position = [], 0
    for start, end in secret_spans(text):
        pieces += [text[position:start], shown(text[start:end])]
        position = end
    return "".join([*pieces, text[position:]]) if pieces else text


def _merged(spans: list[Span]) -> list[Span]:
    found: list[Span] = []
    for start, end in sorted(spans):
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return found
