"""Broken logs are read as far as their bytes allow, and what was lost is told, once."""

import pytest
from damage import BAG_DAMAGES, DB3_DAMAGES, FOLDER_DAMAGES, MCAP_DAMAGES, Damaged, lying_size_bag

from gapeval.logs.read.container import HEAD
from gapeval.logs.read.opening import open_container

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
