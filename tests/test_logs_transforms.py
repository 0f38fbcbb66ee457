"""Transforms at many stamps at once, against one stamp at a time with plain numbers."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs_writer import ROS2, TF, tf_message

from gapeval.config import StaticTransform
from gapeval.errors import LogError
from gapeval.frame import Transform
from gapeval.logs.read.container import Topic
from gapeval.logs.read.messages.content import transforms as read_transforms
from gapeval.logs.read.samples import add_transforms, build_tree, tf_topics
from gapeval.logs.read.transforms import (
    AFTER,
    BEFORE,
    GAP,
    OK,
    TransformTree,
    ancestors,
    find_path,
    frames,
    lookup,
    make_edge,
    slerp,
    with_pose,
)

SECOND = 1_000_000_000
TURN = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # a quarter turn to the left
HERE = (0.0, 0.0, 0.0, 1.0)


def moving(parent, child, samples):
    """samples: (stamp, translation, quaternion)."""
    rows = [(*t, *q) for _, t, q in samples]
    return make_edge(parent, child, "at its stamps", rows, [stamp for stamp, _, _ in samples], "/tf")


def fixed(parent, child, translation=(0, 0, 0), quaternion=HERE):
    return make_edge(parent, child, "always", [(*translation, *quaternion)], [0], "/tf_static")


# The slow reference: 4 x 4 matrices, one stamp at a time, a plain scan through the samples.


def matrix(translation, quaternion):
    out = np.eye(4)
    transform = Transform.of(translation, quaternion)
    out[:3, :3], out[:3, 3] = transform.matrix, transform.translation
    return out


def slow_slerp(a, b, share):
    a, b = (np.array(q, dtype=float) / math.sqrt(sum(v * v for v in q)) for q in (a, b))
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-6:
        return a + (b - a) * share
    return (math.sin((1 - share) * angle) * a + math.sin(share * angle) * b) / math.sin(angle)


def slow_edge(samples, stamp, max_gap):
    """(matrix or None, reason) of samples sorted by stamp."""
    exact = [s for s in samples if s[0] == stamp]
    if exact:
        return matrix(*exact[-1][1:]), OK
    before = [s for s in samples if s[0] < stamp]
    after = [s for s in samples if s[0] > stamp]
    if not before:
        return None, BEFORE
    if not after:
        return None, AFTER
    (t0, a, p), (t1, b, q) = before[-1], after[0]
    if t1 - t0 > max_gap * SECOND:
        return None, GAP
    share = (stamp - t0) / (t1 - t0)
    translation = [u + (v - u) * share for u, v in zip(a, b, strict=True)]
    return matrix(translation, slow_slerp(p, q, share)), OK


numbers = st.floats(-5, 5).map(lambda v: round(v, 3))
quaternions = st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: sum(v * v for v in q) > 0.01)
samples_of = st.lists(
    st.tuples(st.integers(0, 30), st.tuples(numbers, numbers, numbers), quaternions),
    min_size=1,
    max_size=8,
    unique_by=lambda sample: sample[0],
).map(lambda samples: sorted((SECOND // 10 * s, t, q) for s, t, q in samples))


@settings(max_examples=150, deadline=None)
@given(
    samples_of,
    samples_of,
    st.tuples(numbers, numbers, numbers),
    quaternions,
    st.lists(st.integers(-5, 35), min_size=1, max_size=10),
)
def test_chains_against_the_slow_reference(first, second, translation, quaternion, tenths):
    tree = TransformTree(
        (
            moving("map", "odom", first),
            moving("odom", "base", second),
            fixed("base", "lidar", translation, quaternion),
            fixed("odom", "beacon", translation, quaternion),
        )
    )
    stamps = np.array([SECOND // 10 * t + 3 for t in tenths] + [SECOND // 10 * t for t in tenths])
    still = matrix(translation, quaternion)
    ways = {("map", "lidar"): "ab", ("lidar", "map"): "ab", ("base", "beacon"): "b"}
    for (target, source), needed in ways.items():
        found = lookup(tree, target, source, stamps, 0.5)
        for i, stamp in enumerate(stamps):
            a, why_a = slow_edge(first, stamp, 0.5)
            b, why_b = slow_edge(second, stamp, 0.5)
            reasons = {why for why, edge in ((why_a, "a"), (why_b, "b")) if edge in needed and why != OK}
            if reasons:
                assert found.reasons[i] in reasons
                assert found.distances[i] > 0
                continue
            assert found.valid[i]
            expected = {
                ("map", "lidar"): lambda a=a, b=b: a @ b @ still,
                ("lidar", "map"): lambda a=a, b=b: np.linalg.inv(a @ b @ still),
                ("base", "beacon"): lambda b=b: np.linalg.inv(b) @ still,
            }[target, source]()
            transform = found.transforms.at(i)
            np.testing.assert_allclose(transform.matrix, expected[:3, :3], atol=1e-9)
            np.testing.assert_allclose(transform.translation, expected[:3, 3], atol=1e-8)


def test_halfway_goes_along_the_shorter_arc_whatever_the_signs():
    for sign in (1, -1):
        there = tuple(sign * v for v in TURN)
        edge = moving("map", "base", [(0, (0, 0, 0), HERE), (SECOND, (2, 4, 6), there)])
        found = lookup(TransformTree((edge,)), "map", "base", np.array([SECOND // 2]), 5.0)
        assert found.transforms.translation.tolist() == [[1, 2, 3]]
        x, y, z, w = found.transforms.quaternion[0]
        assert (x, y) == (0, 0)
        assert math.isclose(2 * math.atan2(z, w), math.pi / 4, rel_tol=1e-12)


def test_samples_themselves_come_out_exactly():
    samples = [(i * SECOND, (0.1 * i, 1 / 3, -7.7), (0.1 * i, 0.2, -0.3, 0.9)) for i in range(9)]
    samples[4] = (4 * SECOND, (1, 2, 3), (0.6, 0, 0, -0.8))
    found = lookup(
        TransformTree((moving("map", "base", samples),)), "map", "base", np.arange(9) * SECOND, 0.001
    )
    assert found.valid.all()
    assert found.transforms.translation.tolist() == [list(t) for _, t, _ in samples]
    assert found.transforms.quaternion[4].tolist() == [0.6, 0, 0, -0.8]


@given(st.floats(0, 1), quaternions, st.floats(-1e-7, 1e-7))
def test_slerp_is_a_unit_quaternion_also_between_nearly_equal_ones(share, quaternion, small):
    a = np.array([quaternion]) / np.linalg.norm(quaternion)
    b = a + small * np.array([[1.0, -1.0, 0.5, 0.25]])
    b /= np.linalg.norm(b)
    mixed = slerp(a, b, np.array([[share]]))
    assert abs(np.linalg.norm(mixed) - 1) < 1e-12
    np.testing.assert_allclose(mixed, a, atol=1e-6)


def test_nothing_is_extrapolated_and_gaps_are_not_bridged():
    edge = moving("map", "base", [(s * SECOND // 10, (s, 0, 0), HERE) for s in (10, 12, 20, 21)])
    stamps = np.array([9, 10, 11, 12, 13, 19, 20, 21, 22]) * (SECOND // 10)
    found = lookup(TransformTree((edge,)), "map", "base", stamps, 0.5)
    assert found.reasons.tolist() == [BEFORE, OK, OK, OK, GAP, GAP, OK, OK, AFTER]
    assert (found.distances / SECOND).tolist() == [0.1, 0, 0, 0, 0.8, 0.8, 0, 0, 0.1]
    assert found.transforms.translation[found.valid, 0].tolist() == [10, 11, 12, 20, 21]


def test_the_last_sample_wins_among_equal_stamps():
    edge = moving("map", "base", [(2, (9, 9, 9), HERE), (1, (1, 0, 0), HERE), (2, (2, 0, 0), HERE)])
    assert edge.stamps.tolist() == [1, 2]
    assert edge.samples.translation[:, 0].tolist() == [1, 2]
    still = make_edge("base", "lidar", "always", [(5, 0, 0, *HERE), (3, 0, 0, *HERE)], [9, 4], "/tf_static")
    assert still.samples.translation.tolist() == [[3, 0, 0]]


def test_quaternions_need_not_be_of_unit_length():
    found = lookup(
        TransformTree((fixed("base", "lidar", (0, 0, 0), (0, 0, 3, 3)),)), "base", "lidar", np.array([5]), 1
    )
    np.testing.assert_allclose(found.transforms.quaternion, [TURN], rtol=1e-15)


@pytest.mark.parametrize("bad", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (math.inf, 0, 0, 1), (1e200, 0, 0, 1)])
def test_a_quaternion_without_direction_is_named(bad):
    samples = [(0, (0, 0, 0), HERE), (7, (0, 0, 0), bad)]
    tree = TransformTree((moving("odom", "base", samples), fixed("base", "lidar")))
    with pytest.raises(LogError, match=r"odom<-base of /tf at stamp 7 is no transform"):
        lookup(tree, "odom", "lidar", np.array([1]), 1)
    assert lookup(tree, "base", "lidar", np.array([1]), 1).valid.all()


def test_two_parents_are_named_only_where_they_matter():
    tree = TransformTree(
        (moving("map", "base", [(0, (0, 0, 0), HERE)]), fixed("base", "lidar"), fixed("cart", "base"))
    )
    with pytest.raises(LogError) as caught:
        find_path(tree, "map", "lidar")
    assert str(caught.value) == (
        "frame base has two parents, map (/tf) and cart (/tf_static); record only one of the two transforms"
    )
    assert len(find_path(tree, "base", "lidar")) == 1
    assert find_path(tree, "base", "elsewhere") is None
    assert find_path(tree, "base", "base") == []


def test_a_pose_topic_wins_against_tf_and_may_lead_to_any_frame_of_the_robot():
    tf = TransformTree(
        (
            moving("map", "odom", [(0, (0, 0, 0), HERE)]),
            moving("odom", "base", [(0, (1, 0, 0), HERE)]),
            fixed("base", "imu", (0, 0, 0.5)),
            fixed("base", "lidar", (0, 0, 2)),
        )
    )
    pose = moving("map", "imu", [(0, (10, 0, 0.5), HERE)])
    tree = with_pose(tf, pose)
    found = lookup(tree, "map", "lidar", np.array([0]), 1)
    assert found.transforms.translation.tolist() == [[10, 0, 2]]
    assert ancestors(tree, "imu")[0] == "map"
    # Another world: nothing is cut.
    tree = with_pose(tf, moving("gps", "base", [(0, (7, 0, 0), HERE)]))
    assert lookup(tree, "gps", "base", np.array([0]), 1).transforms.translation.tolist() == [[7, 0, 0]]
    assert lookup(tree, "map", "base", np.array([0]), 1).transforms.translation.tolist() == [[1, 0, 0]]
    assert frames(tree) == ("base", "gps", "imu", "lidar", "map", "odom")


def test_rings_do_not_hang():
    tree = TransformTree((fixed("a", "b"), fixed("b", "c"), fixed("c", "a")))
    assert ancestors(tree, "a") == ["c", "b", "a"]
    assert len(find_path(tree, "a", "c")) == 1


def samples_from(*messages):
    samples = {}
    for topic, stamp, transforms in messages:
        raw = bytes(ROS2.serialize_cdr(tf_message(ROS2, stamp, transforms), TF))
        add_transforms(samples, topic, read_transforms(Topic(topic, TF, 1, "cdr"), raw))
    return samples


def test_slashes_in_front_of_frames_mean_nothing():
    samples = samples_from(("/tf", 5, [("/map", "/base", (1, 2, 3), TURN), ("map", "base", (4, 5, 6), TURN)]))
    tree, notices = build_tree(samples, ())
    assert [(edge.name, edge.samples.translation.tolist()) for edge in tree.edges] == [
        ("map<-base", [[4, 5, 6]])
    ]
    assert notices == ()


def test_an_edge_of_both_kinds_moves_and_a_setting_wins():
    samples = samples_from(
        ("/tf", 5, [("map", "odom", (1, 0, 0), HERE)]),
        ("/tf_static", 1, [("map", "odom", (2, 0, 0), HERE), ("base", "lidar", (0, 0, 1), HERE)]),
        ("/tf", 6, [("odom", "odom", (0, 0, 0), HERE)]),
    )
    extra = (StaticTransform(parent="/base", child="lidar", translation=(0, 0, 9)),)
    tree, notices = build_tree(samples, extra)
    kinds = {edge.name: (edge.is_static, edge.samples.translation[0].tolist()) for edge in tree.edges}
    assert kinds == {"map<-odom": (False, [1, 0, 0]), "base<-lidar": (True, [0, 0, 9])}
    assert notices == (
        "map<-odom is on /tf_static and on /tf; /tf is used",
        "base<-lidar of log.transforms replaces the log's own",
        "odom is its own parent on /tf; left out",
    )


def test_tf_of_one_robot_is_read():
    def names(*topics, near=None):
        return tf_topics([Topic(name, "tf2_msgs/msg/TFMessage", 1, "cdr") for name in topics], near)

    assert names("/tf", "/tf_static", "/b/tf") == ("/tf", "/tf_static")
    assert names("/b/tf", "/b/tf_static") == ("/b/tf", "/b/tf_static")
    assert names("/a/tf", "/b/tf", near="/b/lidar/points") == ("/b/tf",)
    with pytest.raises(LogError, match="tf of several robots, in /a, /b; record one robot per log"):
        names("/a/tf", "/b/tf", near="/points")
