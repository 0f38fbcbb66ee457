"""A `-wal` beside a database: what is finished in it is read, the rest told, and no file is touched."""

import shutil
import sqlite3
from pathlib import Path

import pytest
from logs_writer import clouds, driving, lidar, write_sorted

from gapeval.config import LogSection
from gapeval.logs.read import read_frames, read_recording
from gapeval.logs.read.containers.sqlite_wal import read_wal


def killed(folder: Path, finished: int, unfinished: int) -> Path:
    """A recorder that was killed: so many of ten clouds in the database, then some finished in the -wal, then
    a transaction that was never finished, though it was written already.
    """
    whole = write_sorted(folder / "whole.db3", lidar(), driving(), clouds(10), container="db3")
    path = folder / "log.db3"
    with sqlite3.connect(whole) as source:
        rows = source.execute(
            "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN "
            "(SELECT id FROM topics WHERE name = '/points') ORDER BY timestamp"
        ).fetchall()
        source.execute("DELETE FROM messages WHERE topic_id = ?", (rows[0][0],))
    source.close()
    writer = sqlite3.connect(whole, isolation_level=None)
    insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
    here = len(rows) - finished - unfinished
    writer.executemany(insert, rows[:here])
    writer.execute("PRAGMA journal_mode = WAL").fetchall()
    writer.execute("PRAGMA wal_autocheckpoint = 0").fetchall()
    writer.execute("PRAGMA cache_size = 1")  # so that what is unfinished is written, too
    if finished:
        writer.execute("BEGIN")
        writer.executemany(insert, rows[here : here + finished])
        writer.execute("COMMIT")
    if unfinished:
        writer.execute("BEGIN")
        writer.executemany(insert, rows[here + finished :])
    for suffix in ("", "-wal"):
        shutil.copyfile(f"{whole}{suffix}", f"{path}{suffix}")
    if unfinished:
        writer.execute("ROLLBACK")
    writer.close()
    return path


@pytest.mark.parametrize(("finished", "unfinished"), [(4, 0), (0, 5), (3, 3)])
def test_what_is_finished_is_read_and_the_rest_is_told(tmp_path, finished, unfinished):
    path = killed(tmp_path, finished, unfinished)
    wal = path.with_name("log.db3-wal")
    before = {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in (path, wal)}
    recording = read_recording(path, LogSection())
    assert recording.total == 10 - unfinished
    assert len(list(read_frames(recording, 0, recording.matched))) == 10 - unfinished
    assert [loss.file for loss in recording.losses] == (["log.db3-wal"] if unfinished else [])
    written = read_wal(wal)
    assert (written.finished > 0) == (finished > 0)
    if unfinished:
        (loss,) = recording.losses
        assert loss.bytes == written.size - written.finished > 0
    after = {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in (path, wal)}
    assert after == before
    assert not path.with_name("log.db3-shm").exists()


@pytest.mark.parametrize("place", [10, 40, 3000])
def test_a_damaged_wal_counts_as_far_as_it_is_sound(tmp_path, place):
    path = killed(tmp_path, 4, 0)
    wal = path.with_name("log.db3-wal")
    data = bytearray(wal.read_bytes())
    data[place] ^= 0xFF
    wal.write_bytes(data)
    recording = read_recording(path, LogSection())
    assert recording.total == 6
    (loss,) = recording.losses
    assert (loss.file, loss.bytes) == ("log.db3-wal", len(data))
    assert wal.read_bytes() == data
