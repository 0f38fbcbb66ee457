"""Files that are whole or not there, and what must not be replaced."""

import os
import stat
import threading
from pathlib import Path

import pytest

from gapeval.errors import GapevalError
from gapeval.files import write_whole


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    for content in (b"one", b"another"):
        write_whole(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_leads_where_it_led(tmp_path: Path) -> None:
    path, link = tmp_path / "a.txt", tmp_path / "link"
    path.write_bytes(b"one")
    link.symlink_to(path)
    write_whole(link, b"another")
    assert link.is_symlink()
    assert path.read_bytes() == b"another"


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(path.read_bytes()))
    reader.start()
    write_whole(path, b"through it")
    reader.join(10)
    assert read == [b"through it"]
    assert stat.S_ISFIFO(path.stat().st_mode)


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(GapevalError, match="cannot be written"):
        write_whole(tmp_path / "no folder" / "a.txt", b"")
