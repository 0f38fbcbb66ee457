"""When each point was measured, for every name, type and unit that drivers write."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from logs_writer import ROS1, ROS2, START, cloud_message

from gapeval.logs.read.container import Topic
from gapeval.logs.read.messages.cloud import (
    DATATYPES,
    NO_TIME,
    PackedCloud,
    PackedField,
    UnreadableCloudError,
)
from gapeval.logs.read.messages.content import time_field, timed_cloud
from gapeval.logs.read.messages.point_time import NAMES, timed_points

CLOUD = "sensor_msgs/msg/PointCloud2"
CODES = {name: code for code, (name, _) in DATATYPES.items()}
STAMP = START + 123_456_789


def packed(values, kind="float32", name="time", stamp=STAMP, order="<", xyz=None, origin=None):
    """A cloud of points (n, 3) with one more field in front of them."""
    values = np.asarray(values)
    dtype = np.dtype([(name, order + DATATYPES[CODES[kind]][1]), ("xyz", order + "f4", 3)])
    rows = np.ones(len(values), dtype)
    rows[name] = values
    if xyz is not None:
        rows["xyz"] = xyz
    offset = dtype.fields["xyz"][1]
    fields = [PackedField(name, 0, CODES[kind])]
    fields += [PackedField(axis, offset + 4 * i, CODES["float32"]) for i, axis in enumerate("xyz")]
    data, step = np.frombuffer(rows.tobytes(), np.uint8), dtype.itemsize
    return PackedCloud(
        stamp, "lidar", 1, len(rows), tuple(fields), order == ">", step, step * len(rows), data, None, origin
    )


# What drivers write: (field, type, values of a scan of 0.1 s, unit, origin, tolerance [ns]).
SCAN = np.linspace(0, 0.1, 5)
DRIVERS = {
    "ouster": ("t", "uint32", SCAN * 1e9, "ns", "stamp", 0),
    "velodyne": ("time", "float32", SCAN, "s", "stamp", 10),
    "velodyne, back from the end": ("time", "float32", SCAN - 0.1, "s", "stamp", 10),
    "hesai": ("timestamp", "float64", SCAN + STAMP / 1e9, "s", "absolute", 300),
    "livox": ("timestamp", "float64", SCAN * 1e9 + STAMP, "ns", "absolute", 300),
    "livox, offset": ("offset_time", "uint32", SCAN * 1e9, "ns", "stamp", 0),
    "in microseconds": ("t", "uint32", SCAN * 1e6, "us", "stamp", 0),
    "in microseconds, with a sign": ("timeOffset", "int32", SCAN * 1e6 - 50_000, "us", "stamp", 0),
    "microseconds since 1970": ("ts", "float64", np.rint(SCAN * 1e6 + STAMP / 1e3), "us", "absolute", 1000),
    "seconds as double": ("Time_Stamp", "float64", SCAN, "s", "stamp", 1),
}


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("order", "<>")
def test_what_drivers_write(driver, order):
    name, kind, values, unit, origin, tolerance = DRIVERS[driver]
    timed, found = timed_points(packed(values, kind, name, order=order))
    start = {"velodyne, back from the end": -100_000_000, "in microseconds, with a sign": -50_000_000}
    expected = np.rint(SCAN * 1e9) + start.get(driver, 0)
    assert np.abs(timed.nanoseconds - expected).max() <= tolerance
    assert timed.nanoseconds.dtype == np.int64
    assert (found.name, found.type, found.unit, found.origin) == (name, kind, unit, origin)
    assert found.span == pytest.approx(0.1, abs=1e-5)


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from(["s", "us", "ns"]),
    st.sampled_from(["uint32", "int32", "float32", "float64"]),
    st.booleans(),
    st.floats(0.005_001, 2.1),
    st.sampled_from([0.0, -1.0, -0.5]),
    st.integers(10**18, 4 * 10**18),
)
def test_times_of_any_unit_come_back(unit, kind, is_absolute, span, share, stamp):
    """What is written as whole steps of a unit comes back, to the type's precision."""
    factor = {"s": 10**9, "us": 10**3, "ns": 1}[unit]
    fits = kind == "float64" or not is_absolute
    fits &= kind != "uint32" or share == 0
    assume(fits and (unit != "s" or kind.startswith("float")))
    offsets = np.rint(np.linspace(share * span, (1 + share) * span, 7) * 1e9).astype(np.int64)
    whole = offsets + (stamp if is_absolute else 0)
    if kind.startswith("float"):
        values = whole.astype(np.float64) / factor
    else:
        values = whole // factor
        whole = values * factor
    cloud = packed(values, kind, stamp=stamp)
    timed, found = timed_points(cloud)
    assert (found.unit, found.origin) == (unit, "absolute" if is_absolute else "stamp")
    expected = whole - (stamp if is_absolute else 0)
    digits = {"float32": 2.0**-23, "float64": 2.0**-52}.get(kind, 0.0)
    assert np.abs(timed.nanoseconds - expected).max() <= digits * np.abs(whole).max() + 1


@pytest.mark.parametrize(
    ("values", "kind", "detail"),
    [
        (np.zeros(4), "float32", "time goes from 0 to 0, which is no scan"),
        (np.full(4, 7), "uint32", "time goes from 7 to 7, which is no scan"),
        ([0, 4.0], "float32", "time goes from 0 to 4, which is no scan"),
        ([0, 0.004], "float32", "time goes from 0 to 0.004, which is no scan"),
        ([0, 2], "uint32", "time goes from 0 to 2, which is no scan"),
        ([0, 4_000_000_000], "uint32", "time goes from 0 to 4000000000, which is no scan"),
        ([0, np.nan], "float32", "time is not finite for every point"),
        ([0, np.inf], "float64", "time is not finite for every point"),
        ([-1.7e308, 1.7e308], "float64", "which is no scan"),
        ([500.0, 500.1], "float64", "time begins at 500 s, near neither 0 nor the stamp, 1700000000 s"),
        ([1.6e9, 1.6e9 + 0.1], "float64", "time begins at 1600000000 s, near neither 0 nor the stamp"),
        (np.linspace(0, 100, 5), "uint8", "time goes from 0 to 100, which is no scan"),
    ],
)
def test_times_that_make_no_sense_are_none(values, kind, detail):
    with pytest.raises(UnreadableCloudError) as caught, np.errstate(all="ignore"):
        timed_points(packed(values, kind))
    assert caught.value.reason == NO_TIME
    assert detail in caught.value.detail


def test_under_simulated_clocks_the_nearer_origin_counts():
    times = np.array([0.0, 0.1])
    early = timed_points(packed(times, stamp=5 * 10**9))[0].nanoseconds
    assert np.abs(early - [0, 100_000_000]).max() <= 10
    late = timed_points(packed(times + 5, "float64", stamp=5 * 10**9))[0].nanoseconds
    assert np.abs(late - [0, 100_000_000]).max() <= 1
    early = timed_points(packed(times + 2, "float64", stamp=2 * 10**9))[0].nanoseconds
    assert np.abs(early - [0, 100_000_000]).max() <= 1


def test_points_that_are_left_out_have_no_say():
    xyz = [[1, 2, 3], [np.nan] * 3, [0, 0, 0], [4, 5, 6], [1e13, 0, 0]]
    timed, _ = timed_points(packed([0, np.nan, 9e9, 0.05, -7], xyz=xyz))
    assert timed.points.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert np.abs(timed.nanoseconds - [0, 50_000_000]).max() < 10


def test_the_first_field_that_makes_sense_counts():
    values = np.zeros(3, dtype=[("t", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("timestamp", "<f8")])
    values["x"], values["timestamp"] = 1, STAMP / 1e9 + np.array([0, 0.05, 0.1])
    fields = [("t", 0, 6, 1), ("x", 4, 7, 1), ("y", 8, 7, 1), ("z", 12, 7, 1), ("timestamp", 16, 8, 1)]
    data = np.frombuffer(values.tobytes(), np.uint8)
    for store, way in ((ROS1, "ros1"), (ROS2, "cdr")):
        message = cloud_message(
            store, STAMP, "lidar", np.ones((3, 3)), fields=fields, point_step=24, row_step=72, data=data
        )
        serialize = store.serialize_ros1 if way == "ros1" else store.serialize_cdr
        topic, raw = Topic("/points", CLOUD, 1, way), bytes(serialize(message, CLOUD))
        assert time_field(topic, raw).name == "timestamp"
        nanoseconds = timed_cloud(topic, raw).nanoseconds
        assert np.abs(nanoseconds - [0, 50_000_000, 100_000_000]).max() < 300


def test_clouds_without_a_field_of_times():
    raw = bytes(ROS2.serialize_cdr(cloud_message(ROS2, STAMP, "lidar", np.ones((3, 3))), CLOUD))
    with pytest.raises(UnreadableCloudError, match="no field is named like a time; it has x, y, z, int"):
        timed_cloud(Topic("/points", CLOUD, 1, "cdr"), raw)


@pytest.mark.parametrize("name", sorted(NAMES))
def test_names_are_known_in_any_case(name):
    for spelling in (name, name.upper(), name.title()):
        assert timed_points(packed(SCAN, name=spelling))[1].name == spelling


def test_a_field_that_lies_outside_of_its_point_is_no_time():
    cloud = packed(SCAN)
    broken = PackedCloud(
        **{name: getattr(cloud, name) for name in PackedCloud.__slots__}
        | {"fields": (PackedField("t", 14, 7), PackedField("time", 0, 77), *cloud.fields[1:])}
    )
    with pytest.raises(UnreadableCloudError, match="no time for each point: field t ends at 18 of 16"):
        timed_points(broken)
