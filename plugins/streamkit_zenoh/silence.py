"""What receivers say when no record comes."""

SILENCE_S = 5.0  # time without a record
MAX_KEYS = 8  # that are named
LOST_FEED = "though a publisher is there: has it lost its feed?"


def others_text(keys: list[str]) -> str:
    """That only other keys are published, and a few of them; "" if none is."""
    more = f" and {len(keys) - MAX_KEYS} more" if len(keys) > MAX_KEYS else ""
    return f"no publisher has this key; others have {', '.join(keys[:MAX_KEYS])}{more}" if keys else ""
