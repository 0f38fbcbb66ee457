"""Broken logs are read as far as their bytes allow, and what was lost is told, once."""

import re
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from backports import zstd
from damage import (
    BAG_DAMAGES,
    DB3_DAMAGES,
    FOLDER_DAMAGES,
    MCAP_DAMAGES,
    Damaged,
    bad_checksum_mcap,
    bag,
    db3,
    lying_size_bag,
    mcap,
    mcap_map,
    records,
    sent,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from logs_writer import clouds, driving, lidar, write_sorted

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read import RefusedScan, preparation, read_frames, read_recording
from gapeval.logs.read.container import HEAD, Loss
from gapeval.logs.read.containers.losses import BAD_CHECKSUM
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.playback import DAMAGED

CASES = [
    *[(damage, codec) for damage in BAG_DAMAGES for codec in ("none", "lz4", "bz2")],
    *[(lying_size_bag, codec) for codec in ("lz4", "bz2")],
    *[(damage, codec) for damage in MCAP_DAMAGES for codec in ("none", "lz4", "zstd")],
    *[(damage, "") for damage in (*DB3_DAMAGES, *FOLDER_DAMAGES)],
]


@pytest.mark.parametrize(
    ("damage", "codec"), CASES, ids=[f"{damage.__name__}-{codec}".rstrip("-") for damage, codec in CASES]
)
def test_all_that_is_left_is_read(tmp_path, damage, codec):
    case: Damaged = damage(tmp_path, codec) if codec else damage(tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    with open_container(case.path) as container:
        names = sorted({topic.name for topic in container.topics})
        read = [(topic.name, time, bytes(raw)) for topic, time, raw in container.messages(names, None, None)]
        assert sorted(read) == sorted(case.sent)
        assert [time for _, time, _ in read] == sorted(time for _, time, _ in read)
        assert tuple(loss.reason for loss in container.losses) == case.reasons
        assert container.notices == case.notices
        again = [(topic.name, time, bytes(raw)) for topic, time, raw in container.messages(names, None, None)]
        assert again == read
        heads = list(container.heads(names, (), None, None))
        begun = [(t.name, time, bytes(raw)[:HEAD]) for t, time, raw in heads]
        assert {(name, time, raw[:HEAD]) for name, time, raw in read} <= set(begun)
        whole = [(t.name, time, bytes(raw)) for t, time, raw in container.heads(names, names, None, None)]
        assert set(read) <= set(whole)
        assert [one[:2] for one in whole] == [one[:2] for one in begun]
        assert (len(begun) == len(read)) == case.heads
        assert tuple(loss.reason for loss in container.losses) == case.reasons
        middle = read[len(read) // 2][1]
        late = [(t.name, time, bytes(raw)) for t, time, raw in container.messages(names, middle, None)]
        assert late == [one for one in read if one[1] >= middle]
    assert before == {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}


@dataclass(frozen=True, repr=False)
class Whole:
    """The bytes of a log, and what is in it."""

    content: bytes
    items: set


@pytest.fixture(scope="module")
def whole_logs(tmp_path_factory):
    """By kind."""
    folder = tmp_path_factory.mktemp("whole")
    paths = {
        "bag": bag(folder / "bag"),
        "bag-lz4": bag(folder / "bag-lz4", "lz4"),
        "mcap": mcap(folder / "mcap"),
        "mcap-zstd": mcap(folder / "mcap-zstd", "zstd"),
        "mcap-unchunked": mcap(folder / "mcap-unchunked", use_chunking=False),
        "db3": db3(folder / "db3"),
    }
    logs = {kind: Whole(path.read_bytes(), set(messages(path))) for kind, path in paths.items()}
    return logs | {"zstd": Whole(zstd.compress(logs["mcap"].content), logs["mcap"].items)}


def messages(path):
    with open_container(path) as container:
        names = {topic.name for topic in container.topics}
        return [(topic.name, time, bytes(raw)) for topic, time, raw in container.messages(names, None, None)]


@pytest.mark.parametrize("kind", ["bag", "bag-lz4", "mcap", "mcap-zstd", "mcap-unchunked", "db3", "zstd"])
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 1))
def test_wherever_a_file_is_cut_what_is_read_was_in_it(whole_logs, kind, share):
    content, items = whole_logs[kind].content, whole_logs[kind].items
    with TemporaryDirectory() as folder:
        path = Path(folder, "log")
        path.write_bytes(content[: 20 + int(share * (len(content) - 21))])
        try:
            with open_container(path) as container:
                assert container.losses or container.notices
            read = messages(path)
        except LogError:
            # Nothing was left.
            read = []
    assert len(read) == len(set(read))
    assert set(read) <= items
    if share > 0.99 and kind in ("bag", "mcap", "mcap-unchunked"):
        assert read


@pytest.mark.parametrize("kind", ["bag", "bag-lz4", "mcap", "mcap-zstd", "mcap-unchunked", "db3", "zstd"])
def test_a_whole_log_has_no_losses(whole_logs, tmp_path, kind):
    content, items = whole_logs[kind].content, whole_logs[kind].items
    path = tmp_path / "log"
    path.write_bytes(content)
    with open_container(path) as container:
        names = {topic.name for topic in container.topics}
        assert len(list(container.messages(names, None, None))) == len(items)
        assert (container.losses, container.notices) == ([], ())
    version = 1 if kind.startswith("bag") else 2
    assert items == set(sent(records(40 if kind == "db3" else 10), version))


def test_a_loss_says_what_where_and_when(tmp_path):
    case = bad_checksum_mcap(tmp_path, "lz4")
    whole = mcap_map(mcap(tmp_path / "whole", "lz4"))
    times = [time for _, time, _ in whole.held[1]]
    start, stop = whole.chunks[1]
    with open_container(case.path) as container:
        list(container.messages({"/points"}, None, None))
        expected = Loss(case.path.name, BAD_CHECKSUM, stop - start, len(times), min(times), max(times))
        assert container.losses == [expected]
        # What lies outside of what is asked for is not looked at, and not told.
    with open_container(case.path) as container:
        list(container.messages({"/points"}, max(times) + 1, None))
        assert container.losses == []


def test_the_survey_of_a_log_looks_at_every_checksum(tmp_path):
    """Also of plain chunks, whose heads alone could be read: what is in a bad one is used for nothing."""
    path = write_sorted(tmp_path / "log.mcap", lidar(), driving(), clouds(), container="mcap-none")
    data = bytearray(path.read_bytes())
    at = data.index(b"base_link", len(data) // 2)
    data[at : at + 4] = b"BASE"
    path.write_bytes(data)
    recording = read_recording(path, LogSection())
    (loss,) = recording.losses
    assert loss.reason == "a chunk does not match its checksum (CRC)"
    strict = f"{path}: not whole: {loss}; leave out --strict to use the rest"
    with pytest.raises(LogError, match=re.escape(strict)):
        read_recording(path, LogSection(strict=True))


def test_windows_on_a_damaged_chunk_of_a_large_log_are_refused(tmp_path, monkeypatch):
    """Its clouds were known by their heads; that their checksum is wrong shows when they are read."""
    path = mcap(tmp_path / "log.mcap")
    known, data = mcap_map(path), bytearray(path.read_bytes())
    data[known.chunks[1][0] + 9 + 24] ^= 1
    path.write_bytes(data)
    lost = [time for topic, time, _ in known.held[1] if topic == "/points"]
    every = [time for chunk in known.held for topic, time, _ in chunk if topic == "/points"]
    monkeypatch.setattr(preparation, "LARGE", 0)
    for scans in (1, 3):
        log = LogSection.model_validate({"accumulate": {"scans": scans}})
        recording = read_recording(path, log)
        items = list(read_frames(recording, 0, recording.matched))
        for number, item in enumerate(items):
            window = every[number : number + scans]
            assert isinstance(item, RefusedScan) == bool(set(window) & set(lost))
            assert getattr(item, "reason", DAMAGED) == DAMAGED
        assert {isinstance(item, RefusedScan) for item in items} == {True, False}
    with pytest.raises(LogError, match=r"a chunk does not match its checksum .* leave out --strict"):
        read_recording(path, LogSection(strict=True))  # which looks at the first clouds
