"""What of a log was lost, each part of it told once."""

from dataclasses import dataclass, field

from gapeval.logs.read.container import Loss

# Reasons; a Loss puts them beside file, bytes and times.
CUT = "the file was never closed or is cut: what came behind its last whole record is not there"
UNREADABLE_RECORDS = "no record can be made out there"
BAD_CHUNK = "a chunk does not decompress"
BAD_CHECKSUM = "a chunk does not match its checksum (CRC)"
BAD_CHUNK_RECORDS = "the records in a chunk are damaged"
BOMB = "a chunk would be larger than its compression allows, or than 1 GiB"
UNKNOWN_COMPRESSION = "a chunk is compressed in a way that gapeval does not know"
INDEX_LIES = "the index points to where nothing is, so the file was read from end to end"
UNDESCRIBED = "messages of a topic that the log does not describe"
BAD_MESSAGE = "a compressed message does not decompress"


ODD_ROW = "a row of the database is no message"
MISSING_ROWS = "rows are missing from the database"
BROKEN_CHAIN = "a message's pages in the database do not hang together"
CUT_DATABASE = "the database is cut: its last pages are not there"
UNFINISHED_WAL = "what was written last was never finished, or is damaged"
WAL_LEFT = "the database is damaged, so what is in its -wal file was not read"


CUT_COMPRESSED = "the file's compression is cut or damaged: what came behind is not there"
MISSING_PART = "a part of the log is not there, though metadata.yaml names it"
UNREADABLE_PART = "a part of the log cannot be read"


class LostError(Exception):
    """A part of which nothing can be used. reason: one of those above."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Losses:
    """found: in the order in which they were met."""

    found: list[Loss] = field(default_factory=list)
    _known: set[Loss] = field(default_factory=set)

    def add(self, loss: Loss) -> None:
        if loss not in self._known:
            self._known.add(loss)
            self.found.append(loss)
