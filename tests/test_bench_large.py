"""The logs that scripts/bench_large.py writes are what it says they are."""

import bench_large
import pytest
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2.storage_mcap import McapReader

from gapeval.logs.read.containers.opening import open_container


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_a_log_with_holes_is_a_healthy_log(tmp_path, kind):
    path = tmp_path / "log"
    getattr(bench_large, f"write_{kind}")(path, 20, 50_000)
    with open_container(path) as container:
        assert {topic.name: topic.count for topic in container.topics} == {"/points": 20, "/tf": 100}
        read = [(t.name, time, bytes(raw)) for t, time, raw in container.messages({"/points"}, None, None)]
        heads = [(t.name, time) for t, time, _ in container.heads({"/points"}, {"/tf"}, None, None)]
        assert (container.losses, container.notices) == ([], ())
    assert len(heads) == 120
    assert [len(raw) for _, _, raw in read] == [50_000] * 20
    if kind != "db3":
        reader = Ros1Reader(path) if kind == "bag" else McapReader(path)
        reader.open()
        connections = [one for one in reader.connections if one.topic == "/points"]
        assert [("/points", time, bytes(raw)) for _, time, raw in reader.messages(connections)] == read
        reader.close()
