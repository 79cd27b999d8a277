"""Publishers number their records: gaps are losses, and a number that goes back is a new publisher."""

from collections import OrderedDict

# Keys come from the network: those heard longest ago are forgotten.
KEY_LIMIT = 1024


class Numbering:
    """Follows the numbers of each key.

    Attributes:
        restarts: how often a publisher has begun anew.
    """

    def __init__(self) -> None:
        self.restarts = 0
        self._last: OrderedDict[str, int] = OrderedDict()

    def lost_before(self, key: str, text: bytes) -> int:
        """How many records of this key were lost just before the one with this number.

        Args:
            key: where it was published.
            text: the number in decimal digits; anything else is no number, and tells nothing.
        """
        if not (text.isdigit() and len(text) < 19):
            return 0
        number, last = int(text), self._last.get(key)
        self._last[key] = number
        self._last.move_to_end(key)
        if len(self._last) > KEY_LIMIT:
            self._last.popitem(last=False)
        if last is None:
            return 0
        if number <= last:
            self.restarts += 1
            return 0
        return number - last - 1
