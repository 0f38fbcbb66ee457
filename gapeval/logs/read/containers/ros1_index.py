"""Where everything is in a ROS 1 bag: from its index where that is whole, else by a walk through it."""

from gapeval.errors import LogError
from gapeval.logs.read.containers.blocks import LAST_TIME
from gapeval.logs.read.containers.losses import Losses
from gapeval.logs.read.containers.raw_file import CutError, RawFile
from gapeval.logs.read.containers.ros1_chunk import chunk_at
from gapeval.logs.read.containers.ros1_records import (
    FIRST,
    Index,
    Op,
    Record,
    RecordError,
    chunk_info,
    connection,
    number,
    record_at,
)
from gapeval.logs.read.containers.ros1_salvage import walked

DAMAGED_INDEX = "the index is damaged or missing, so the file was read from end to end"


def read_index(file: RawFile, losses: Losses) -> Index:
    """The index of a bag, whatever state that is in; what is missing of the file is among the losses."""
    try:
        return _indexed(file)
    except (RecordError, CutError):
        index = walked(file, losses)
        index.notices = (DAMAGED_INDEX,)
        return index


def is_indexed(file: RawFile) -> bool:
    """Whether the index says where everything is."""
    try:
        _indexed(file)
    except (RecordError, CutError):
        return False
    return True


def _indexed(file: RawFile) -> Index:
    """The index at the end of the file. Raises RecordError or CutError where it is missing or wrong."""
    head = record_at(file, len(FIRST))
    if head.op != Op.BAG:
        raise RecordError("no header of a bag")
    if head.fields.get(b"encryptor"):
        raise LogError(f"{file.path}: encrypted ROS 1 bag; decrypt it with `rosbag decrypt`")
    at = number(head.fields, b"index_pos", 8)
    if at < head.stop:
        raise RecordError("no index")
    index = Index()
    while at < file.size:
        record = record_at(file, at)
        _take(file, index, record)
        at = record.stop
    if (len(index.connections), len(index.chunks)) != (
        number(head.fields, b"conn_count", 4),
        number(head.fields, b"chunk_count", 4),
    ) or not _agrees(file, index):
        raise RecordError("an index that is not of this bag")
    return index


def _take(file: RawFile, index: Index, record: Record) -> None:
    if record.op == Op.CONNECTION:
        owner, described = connection(record.fields, file.read(record.data, record.stop - record.data))
        index.connections[owner] = described
    elif record.op == Op.CHUNK_INFO:
        chunk = chunk_info(file, record)
        if not 0 <= chunk.start <= chunk.end <= LAST_TIME and chunk.counts:
            raise RecordError("a chunk that ends before it starts")
        index.chunks.append(chunk)
    else:
        raise RecordError("an index with other records in it")


def _agrees(file: RawFile, index: Index) -> bool:
    """Whether chunks are where the index has them; of many, three are looked at."""
    chunks = index.chunks
    try:
        for chunk in [chunks[i] for i in sorted({0, len(chunks) // 2, len(chunks) - 1})] if chunks else []:
            chunk_at(file, chunk.offset)
    except (RecordError, CutError):
        return False
    return set(index.counts) <= set(index.connections)
