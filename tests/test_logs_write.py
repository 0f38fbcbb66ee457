"""logs.write by itself: whatever is written is read back, to the last bit."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.frame import Frame, Transform
from gapeval.logs.read import RefusedScan, read_frames, read_recording
from gapeval.logs.write import CONTAINERS, Cloud, Link, Links, log_path, write_log

NOW = 1_650_000_000 * 10**9 + 123_456_789
POINTS = np.array([[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25]], dtype=np.float32)
NOWHERE = Transform.identity()


def messages(scans, pose=NOWHERE, mount=NOWHERE):
    """Clouds (N, 3), a tenth of a second apart, of a robot at a pose."""
    yield Links(NOW - 10**8, (Link("base_link", "laser", mount),), is_static=True)
    for index in range(-1, len(scans) + 1):
        stamp = NOW + index * 10**8
        yield Links(stamp, (Link("map", "base_link", pose),), is_static=False)
        if 0 <= index < len(scans):
            yield Cloud(stamp, "/points", "laser", np.asarray(scans[index], dtype=np.float32))


def read(path):
    recording = read_recording(path, LogSection())
    return list(read_frames(recording, 0, recording.matched))


finite = st.floats(-1e6, 1e6)
quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1)
transforms = st.builds(Transform.of, st.tuples(finite, finite, finite), quaternions)
places = st.floats(-200, 200, width=32)
scans = st.lists(st.lists(st.tuples(places, places, places), max_size=30), min_size=1, max_size=3)


@pytest.mark.parametrize("container", CONTAINERS)
@settings(max_examples=20, deadline=None)
@given(scans=scans, pose=transforms, mount=transforms)
def test_what_is_written_is_what_independent_readers_read(tmp_path_factory, container, scans, pose, mount):
    """Any transform and any points, none at all too: to the last bit, in order, at their stamps."""
    path = log_path(tmp_path_factory.mktemp("log"), "a", container)
    write_log(path, container, messages(scans, pose, mount))
    found = {"/points": [], "/tf": [], "/tf_static": []}
    store = get_typestore(Stores.ROS2_HUMBLE) if container == "mcap" else None
    with AnyReader([path], default_typestore=store) as reader:
        for connection, _, raw in reader.messages():
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    assert len(found["/points"]) == len(scans)
    for index, (message, points) in enumerate(zip(found["/points"], scans, strict=True)):
        expected = np.array(points, dtype="<f4").reshape(-1, 3)
        assert bytes(message.data) == expected.tobytes()
        assert (message.height, message.width) == (1, len(points))
        assert (message.point_step, message.row_step) == (12, 12 * len(points))
        stamp = NOW + index * 10**8
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(stamp, 10**9)
    assert (len(found["/tf"]), len(found["/tf_static"])) == (len(scans) + 2, 1)
    for message, parent, child, given_transform in (
        *((m, "map", "base_link", pose) for m in found["/tf"]),
        (found["/tf_static"][0], "base_link", "laser", mount),
    ):
        (link,) = message.transforms
        assert (link.header.frame_id, link.child_frame_id) == (parent, child)
        t, q = link.transform.translation, link.transform.rotation
        assert [t.x, t.y, t.z] == given_transform.translation.tolist()
        assert [q.x, q.y, q.z, q.w] == given_transform.quaternion.tolist()


@pytest.mark.parametrize("container", CONTAINERS)
def test_what_is_written_is_read_back(tmp_path, container):
    """By our own reader: poses and mounts to the last bit, points moved by the mount."""
    turn = Transform.of([1.5, -2.0, 0.25], [0.1, 0.2, -0.3, 0.9])
    mount = Transform.of([0.5, 0.25, 1.0], [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
    path = log_path(tmp_path, "b", container)
    write_log(path, container, messages([POINTS, POINTS + 1], turn, mount))
    frames = read(path)
    assert [frame.stamp for frame in frames] == [NOW, NOW + 10**8]
    for frame, points in zip(frames, (POINTS, POINTS + 1), strict=True):
        assert frame.pose.translation.tolist() == turn.translation.tolist()
        assert frame.pose.quaternion.tolist() == turn.quaternion.tolist()
        assert frame.sensor.quaternion.tolist() == mount.quaternion.tolist()
        expected = np.column_stack([0.5 - points[:, 1], 0.25 + points[:, 0], 1.0 + points[:, 2]])
        np.testing.assert_allclose(frame.points, expected, atol=1e-6)


@pytest.mark.parametrize("container", CONTAINERS)
def test_an_empty_cloud_is_written_and_refused_when_read(tmp_path, container):
    path = log_path(tmp_path, "c", container)
    write_log(path, container, messages([np.empty((0, 3)), POINTS]))
    kinds = [type(frame) for frame in read(path)]
    assert kinds == [RefusedScan, Frame]


def test_logs_are_called_by_their_kind(tmp_path):
    assert {kind: log_path(tmp_path, "x", kind).name for kind in CONTAINERS} == {
        "mcap": "x.mcap",
        "ros1": "x.bag",
        "ros2": "x",
    }


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_log_is_whole_or_as_it_was(tmp_path, container):
    """Written over, it is the new one; given up midway, it is the old one, and nothing lies beside it."""
    path = log_path(tmp_path, "d", container)

    def broken():
        yield from list(messages([POINTS]))[:-1]
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_log(path, container, broken())
    assert list(tmp_path.iterdir()) == []
    write_log(path, container, messages([POINTS]))
    with pytest.raises(ZeroDivisionError):
        write_log(path, container, broken())
    assert len(read(path)) == 1
    write_log(path, container, messages([POINTS, POINTS]))
    assert len(read(path)) == 2
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_place_that_cannot_be_written_is_one_line(tmp_path, container):
    path = log_path(tmp_path / "missing", "e", container)
    if container == "ros2":
        (tmp_path / "missing").write_text("a file")
    with pytest.raises(LogError) as caught:
        write_log(path, container, messages([POINTS]))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
