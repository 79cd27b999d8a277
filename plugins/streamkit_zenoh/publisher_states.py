"""PublisherStates: whether the publishers of a key run, or have ended."""

from streamkit_zenoh.wire.numbering import RecentDict
from streamkit_zenoh.wire.status import StatusRecord


class PublisherStates:
    """The last reported state of each publisher of a key: running or ended."""

    def __init__(self) -> None:
        self._latest_run = 0  # of the records
        self._running: RecentDict[str, tuple[int, bool]] = RecentDict()
        self._awaits_status = False  # of a publisher that has appeared

    def note_appeared(self) -> None:
        """Notes that a publisher has appeared, which has not sent a status yet."""
        self._awaits_status = True

    def note_record(self, run: int) -> None:
        """Notes the run of a record."""
        self._latest_run = max(self._latest_run, run)

    def note_status(self, status: StatusRecord) -> None:
        """Notes a status; one of an earlier run, or a reply from before the end, may come after it."""
        self._awaits_status = False
        run, is_running = self._running.get(status.source, (status.run, True))
        if status.run > run or (status.run == run and is_running):
            self._running[status.source] = (status.run, status.state != "ended")

    def has_unended(self) -> bool:
        """Whether a publisher never said that it ends; False where none says anything of itself.

        One that is killed at its start has appeared, or sent records, and perhaps no status yet.
        """
        known = self._running.values()
        is_unknown = self._awaits_status or all(run < self._latest_run for run, _ in known)
        return bool(known) and (is_unknown or any(is_running for _, is_running in known))
