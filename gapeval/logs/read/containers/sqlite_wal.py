"""The `-wal` beside a database: what of it is finished. The rest sqlite passes over in silence."""

import struct
from dataclasses import dataclass
from pathlib import Path

HEADER, FRAME = 32, 24  # bytes
MAGIC = 0x377F0682  # with the last bit set where checksums are of big-endian words
LOOKED_THROUGH = 1 << 26  # bytes; of more, only whether anything is finished at all


@dataclass(frozen=True, slots=True)
class Wal:
    """size: of the file [bytes]; finished: up to the end of the last finished transaction, 0 without any.

    is_all: whether the whole file was looked through.
    """

    size: int
    finished: int
    is_all: bool

    @property
    def left_over(self) -> int:
        """Bytes of transactions that are not finished, or damaged."""
        return self.size - self.finished if self.is_all else 0


def read_wal(path: Path) -> Wal:
    """As sqlite itself would go through it: until the first frame whose salts or checksum are not right."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(HEADER)
        if len(head) < HEADER:
            return Wal(size, 0, True)
        magic, _, page, _, *salts = struct.unpack(">8I", head)[:6]
        if magic & ~1 != MAGIC or not 512 <= page <= 65536 or page & (page - 1):
            return Wal(size, 0, True)
        order = ">" if magic & 1 else "<"
        sums = _checksum(head[:24], order, (0, 0))
        if sums != struct.unpack(">2I", head[24:]):
            return Wal(size, 0, True)
        finished = 0
        while len(frame := file.read(FRAME + page)) == FRAME + page:
            _, committed, *own = struct.unpack(">4I", frame[:16])
            sums = _checksum(frame[FRAME:], order, _checksum(frame[:8], order, sums))
            if own != salts or sums != struct.unpack(">2I", frame[16:FRAME]):
                # What is behind a checkpoint is of an earlier round, and in the database since.
                return Wal(size, finished, own == salts or not finished)
            if committed:
                finished = file.tell()
                if size > LOOKED_THROUGH:
                    return Wal(size, finished, False)
    return Wal(size, finished, True)


def _checksum(data: bytes, order: str, sums: tuple[int, int]) -> tuple[int, int]:
    one, other = sums
    for first, second in struct.iter_unpack(order + "2I", data):
        one = (one + first + other) & 0xFFFFFFFF
        other = (other + second + one) & 0xFFFFFFFF
    return one, other
