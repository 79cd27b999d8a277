"""NumberedFilesSink: base of the sinks that write many files."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from streamkit.element.older_files import IfExists
from streamkit.element.output_sink import OutputFileSink
from streamkit.element.property import Property
from streamkit.element.settings_of import SettingsOf
from streamkit.output.names import local_path
from streamkit.output.retention import Retention, RetentionLimits


class NumberedFilesSink(OutputFileSink):
    """Base class of sinks that write many files, of which the oldest may be deleted.

    Attributes:
        remembers_earlier_runs: whether files of earlier runs count, too.
    """

    remembers_earlier_runs: ClassVar[bool] = True

    if_exists: IfExists = Property(
        IfExists.CONTINUE,
        doc="Older files: refuse them, continue their numbers (one file: refuse it), or replace them.",
    )
    retention_limits = SettingsOf(RetentionLimits)

    def start(self) -> None:
        """Checks the name, and reads which files of earlier runs may be deleted."""
        super().start()
        pattern = local_path(self.location)
        ledger = pattern.with_name(f".{pattern.name}.written") if self.remembers_earlier_runs else None
        self._retention = Retention(self.retention_limits, pattern.parent, ledger)

    def file_is_complete(self, path: Path, companion: Path | None = None) -> None:
        """Notes a complete file, and one that is kept as long; deletes what is kept no longer."""
        if deleted := self._retention.add(path, self.clock.utc_ns() / 1e9, companion):
            self.results["deleted_files"] += deleted
