"""PointCloud2: points written into any legal layout come back; headers that lie are refused, nothing else."""

import math
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from logs_writer import CLOUD, ROS1, ROS2, cloud_message

from gapeval.frame import Transform
from gapeval.logs.read.container import Topic
from gapeval.logs.read.messages.cloud import DATATYPES, UnreadableCloudError, cloud_points, transformed
from gapeval.logs.read.messages.message import UndecodableError, decode

QUICK = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def message(**values):
    fields = [SimpleNamespace(name=n, offset=o, datatype=d, count=c) for n, o, d, c in values.pop("fields")]
    return SimpleNamespace(fields=fields, **values)


def plain(points, **changes):
    """A decoded cloud of 16-byte points with some fields changed."""
    return cloud_message(ROS2, 0, "lidar", points, **changes)


@st.composite
def layouts(draw):
    """(message, points as written, as float64) in a random legal layout."""
    order = draw(st.sampled_from("<>"))
    codes = draw(st.lists(st.sampled_from(sorted(DATATYPES)), min_size=3, max_size=3))
    if draw(st.booleans()):
        codes = [7, 7, 7]
    # x, y, z and others in any order, with any gaps between them.
    names = draw(st.permutations(["x", "y", "z", "intensity", "ring", "t"]))
    kinds = dict(zip("xyz", codes, strict=True)) | {"intensity": 7, "ring": 4, "t": 8}
    offset, fields, offsets = 0, [], {}
    for name in names:
        offset += draw(st.integers(0, 5))
        offsets[name] = offset
        fields.append((name, offset, kinds[name], draw(st.sampled_from([0, 1]))))
        offset += np.dtype(DATATYPES[kinds[name]][1]).itemsize
    step = offset + draw(st.integers(0, 9))
    height, width = draw(st.integers(1, 4)), draw(st.integers(1, 6))
    padding = draw(st.integers(0, 7)) if height > 1 else 0
    row = width * step + padding
    data = np.frombuffer(draw(st.binary(min_size=height * row, max_size=height * row)), np.uint8).copy()
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = np.empty((height * width, 3))
    for column, name in enumerate("xyz"):
        dtype = np.dtype(order + DATATYPES[kinds[name]][1])
        if dtype.kind == "f":
            values = (rng.normal(size=len(points)) * 1000).astype(dtype)
            values[rng.random(len(points)) < 0.1] = np.nan
            values[rng.random(len(points)) < 0.05] = -np.inf
        else:
            values = rng.integers(
                np.iinfo(dtype).min, np.iinfo(dtype).max, len(points), dtype.newbyteorder("=")
            )
            values = values.astype(dtype)
        values[rng.random(len(points)) < 0.3] = 0
        for i in range(len(values)):
            at = i // width * row + i % width * step + offsets[name]
            data[at : at + dtype.itemsize] = np.frombuffer(values[i : i + 1].tobytes(), np.uint8)
        points[:, column] = values
    trailing = draw(st.integers(0, 3))
    decoded = message(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=order == ">",
        point_step=step,
        row_step=draw(st.sampled_from([row, 0, 77])) if height == 1 else row,
        data=np.append(data, np.zeros(trailing, np.uint8)),
        is_dense=draw(st.booleans()),
    )
    return decoded, points


@QUICK
@given(layouts())
def test_points_of_any_layout_come_back_exactly(layout):
    decoded, points = layout
    finite = np.isfinite(points).all(axis=1)
    zero = (points == 0).all(axis=1)
    kept = points[finite & ~zero]
    if not len(kept):
        with pytest.raises(UnreadableCloudError, match="no finite point"):
            cloud_points(decoded)
        return
    found = cloud_points(decoded)
    assert np.array_equal(found.xyz.astype(np.float64), kept)
    assert (found.not_finite, found.zero) == (int((~finite).sum()), int(zero.sum()))


HEADER = ("height", "width", "point_step", "row_step")
SIZES = st.one_of(st.integers(0, 300), st.sampled_from([2**16, 2**31 - 1, 2**31, 2**32 - 1]))


@QUICK
@given(
    st.dictionaries(st.sampled_from(HEADER), SIZES, min_size=1),
    st.lists(
        st.tuples(st.sampled_from(["x", "y", "z", "xyz", ""]), SIZES, st.integers(0, 255), SIZES), max_size=5
    ),
    st.booleans(),
)
def test_headers_that_lie_are_refused_before_anything_is_allocated(header, fields, keep_fields):
    points = np.arange(60, dtype=np.float32).reshape(20, 3) + 1
    if not keep_fields:
        header = header | {"fields": fields}
    decoded = plain(points, **header)
    tracemalloc.start()
    try:
        found = cloud_points(decoded)
        # Points may overlap in the data, but each has at least one byte of its own.
        assert 0 < len(found.xyz) <= len(decoded.data)
    except UnreadableCloudError as error:
        assert error.reason in (  # noqa: PT017
            "empty cloud",
            "no finite point",
            "header lies about its size",
            "no usable x, y, z fields",
        )
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < 500_000


@QUICK
@given(
    st.sampled_from(["cdr", "ros1"]),
    st.lists(st.tuples(st.integers(0, 399), st.integers(0, 255)), max_size=6),
    st.integers(0, 400),
)
def test_any_bytes_give_points_or_a_reason(serialization, changes, cut):
    points = np.arange(30, dtype=np.float32).reshape(10, 3) + 1
    store = ROS1 if serialization == "ros1" else ROS2
    made = cloud_message(store, 10**18, "lidar", points)
    serialize = store.serialize_ros1 if serialization == "ros1" else store.serialize_cdr
    raw = bytearray(serialize(made, CLOUD))
    for at, value in changes:
        raw[at % len(raw)] = value
    raw = raw[: len(raw) - cut] if cut < 100 else raw
    topic = Topic("/points", CLOUD, 1, serialization)
    try:
        found = cloud_points(decode(topic, bytes(raw)))
    except (UndecodableError, UnreadableCloudError) as error:
        found = str(error)
    assert found


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"width": 0}, "empty cloud"),
        ({"height": 0}, "empty cloud"),
        ({"point_step": 0}, "header lies about its size: point_step is 0"),
        ({"width": 21}, "header lies about its size: 1 x 21 points need 336 bytes, it has 320"),
        ({"width": 2**32 - 1, "height": 2**32 - 1, "row_step": 0}, "header lies about its size"),
        ({"width": 10, "height": 2, "row_step": 159}, "row_step 159 < 10 points of 16 bytes"),
        ({"point_step": 8}, "header lies about its size: field z ends at 12 of 8"),
        ({"fields": []}, "no usable x, y, z fields: it has none"),
        ({"fields": [("x", 0, 7, 1), ("y", 4, 7, 1)]}, "no usable x, y, z fields: it has x, y"),
        ({"fields": [("x", 0, 9, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]}, "x is of the unknown datatype 9"),
        (
            {"data": np.full(320, 0xFF, np.uint8)},
            "no finite point: 20 NaN or infinite, 0 at exactly (0, 0, 0)",
        ),
        ({"data": np.zeros(320, np.uint8)}, "no finite point: 0 NaN or infinite, 20 at exactly (0, 0, 0)"),
    ],
)
def test_reasons(changes, reason):
    with pytest.raises(UnreadableCloudError) as caught:
        cloud_points(plain(np.ones((20, 3)), **changes))
    assert reason in str(caught.value)


def test_opposite_coordinates_are_not_taken_for_zero():
    points = [[1, -1, 0], [0, 0, 0], [-0.0, 0, 0], [2, 2, -4], [1e-30, 0, 0]]
    found = cloud_points(plain(points))
    assert found.xyz.tolist() == np.float32([[1, -1, 0], [2, 2, -4], [1e-30, 0, 0]]).tolist()
    assert (found.not_finite, found.zero) == (0, 2)


def test_absurd_distances_are_left_out_like_infinity():
    found = cloud_points(plain([[1, 2, 3], [3e38, 3e38, 3e38], [2e13, 0, 0], [3e38, -3e38, 1]]))
    assert found.xyz.tolist() == [[1, 2, 3]]
    assert found.not_finite == 3


def test_large_coordinates_keep_their_precision():
    rng = np.random.default_rng(3)
    near = rng.uniform(-80, 80, size=(20_000, 3))
    robot = Transform.of([500_000.25, 5_400_000.75, 312.5], [0.1, -0.2, 0.3, 0.9])
    utm = robot.apply(near)
    decoded = message(
        height=1,
        width=len(utm),
        fields=[("x", 0, 8, 1), ("y", 8, 8, 1), ("z", 16, 8, 1)],
        is_bigendian=False,
        point_step=24,
        row_step=0,
        data=np.frombuffer(utm.tobytes(), np.uint8),
        is_dense=True,
    )
    found = cloud_points(decoded).xyz
    assert found.dtype == np.float64
    back = Transform.of(robot.apply_inverse(np.zeros(3)), robot.quaternion * [-1, -1, -1, 1])
    there = transformed(back, found)
    assert there.dtype == np.float32
    assert np.abs(there - near).max() < 1e-5


def test_transformed_is_the_transform_whatever_the_number_of_points():
    rng = np.random.default_rng(4)
    transform = Transform.of([1.5, -2.5, 0.75], [0.3, 0.1, -0.5, 0.8])
    points = rng.uniform(-150, 150, size=(30_001, 3)).astype(np.float32)
    expected = transform.apply(points.astype(np.float64))
    assert np.abs(transformed(transform, points) - expected).max() < 1e-5
    for count in (1, 2, 3, 7, 8191, 8192, 8193):
        assert np.array_equal(transformed(transform, points[:count]), transformed(transform, points)[:count])
    assert math.isclose(np.linalg.norm(transform.quaternion), 1)
