"""Clouds gathered from disorderly logs, against a reference that does everything one by one."""

import pickle
import re
from bisect import insort
from collections import Counter
from itertools import pairwise
from statistics import median

import numpy as np
import pytest
from logs_writer import CLOUD, Record, cloud_message, write_sorted
from moving_robot import MOUNT, REAR, SECOND, START, into_robot, tf

from gapeval.config import LogSection
from gapeval.frame import Frame
from gapeval.logs.read import RefusedScan, read_frames, read_recording

FRONT, BACK = "/points", "/rear"
MOUNTS = {FRONT: MOUNT, BACK: REAR}
FRAMES = {FRONT: "lidar", BACK: "rear"}
MISSING = (START + 90 * SECOND // 100, START + 145 * SECOND // 100)  # no poses in between
GAP = 0.2  # s, log.max_tf_gap
EARLY = "begins before enough scans are there to accumulate"
ALONE = "no cloud of /rear within half its period"
REPEATED = "stamp repeated"
SPANS = [(0, 3), (5, 6), (2, 12), (7, 50)]

WINDOWS = [None, {"scans": 1}, {"scans": 3}, {"seconds": 0.35}, {"seconds": 0.02}]


class Drive:
    """Scans of six points each, of one or two lasers; some are empty, repeated, lying, or without a pose.

    scans: topic -> (stamp, points in the map, kind) in the order of the log.
    """

    def __init__(self, seed, topics, deskew):
        self.rng = np.random.default_rng(seed)
        self.deskew = deskew
        self.scans = {}
        self.records = []
        for topic in topics:
            period = SECOND // 10 if topic == FRONT else SECOND // 6
            stamps = START + np.arange(2 * SECOND // period) * period
            stamps = stamps + self.rng.integers(0, period // 3, len(stamps))
            delays = self.rng.integers(0, 3 * SECOND // 10, len(stamps))  # more than a period: out of order
            kinds = self.rng.choice(["", "empty", "lies", "again"], len(stamps), p=[0.8, 0.1, 0.03, 0.07])
            rows = []
            for stamp, delay, kind in zip(stamps.tolist(), delays.tolist(), kinds.tolist(), strict=True):
                rows.append((stamp + delay, stamp, kind))
                if kind == "again":
                    rows.append((stamp + delay + SECOND // 3, stamp, ""))
            rows.sort()
            self.scans[topic] = [self._scan(topic, *row) for row in rows]

    def _scan(self, topic, time, stamp, kind):
        world = self.rng.uniform([-8, -8, -0.5], [14, 8, 2.0], (0 if kind == "empty" else 6, 3))
        times = self.rng.integers(-4, 9, len(world)) * 10**6
        seen = MOUNTS[topic].apply_inverse(into_robot(world, stamp + times * self.deskew))
        rows = np.zeros(len(world), dtype=[("xyz", "<f4", 3), ("time", "<f4")])
        rows["xyz"], rows["time"] = seen, times / 1e9
        layout = {
            "fields": [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("time", 12, 7, 1)],
            "data": rows.view(np.uint8).reshape(-1),
        } | ({"width": 7} if kind == "lies" else {})
        self.records.append(
            Record(topic, CLOUD, time, lambda s: cloud_message(s, stamp, FRAMES[topic], seen, **layout))
        )
        return stamp, world, kind

    def write(self, path):
        poses = [r for r in tf(2.6, lidar=MOUNT, rear=REAR) if not MISSING[0] < r.time < MISSING[1]]
        return write_sorted(path, poses, self.records)

    def clouds(self, window, every):
        """Expected: (stamp, points in the map or None) for each cloud, and the refused ones by reason."""
        refused = Counter()
        known = {}
        for topic, scans in self.scans.items():
            known[topic] = {}
            for stamp, world, kind in scans:
                if stamp in known[topic]:
                    refused[REPEATED] += 1
                    continue
                known[topic][stamp] = (world, kind)
            for stamp in sorted(known[topic]):
                if MISSING[0] <= stamp <= MISSING[1]:
                    del known[topic][stamp]
                    refused["pose"] += 1
        front = sorted(known[FRONT])
        period = median(b - a for a, b in pairwise(front))
        found = []
        for place, stamp in enumerate(front):
            if window is None:
                mine = [stamp]
            elif "scans" in window:
                mine = front[place - window["scans"] + 1 : place + 1] if place + 1 >= window["scans"] else []
            else:
                begin = stamp - window["seconds"] * 1e9
                mine = [s for s in front[: place + 1] if s > begin] if begin >= front[0] - period else []
            if not mine:
                refused[EARLY] += 1
                continue
            members = [(s, 0, FRONT) for s in mine]
            if BACK in self.scans:
                back = sorted(known[BACK])
                limit = median(b - a for a, b in pairwise(back)) / 2
                partners = [min(back, key=lambda b, s=s: abs(b - s)) for s in mine]
                if any(abs(b - s) > limit for b, s in zip(partners, mine, strict=True)):
                    refused[ALONE] += 1
                    continue
                for partner in set(partners):
                    insort(members, (partner, 1, BACK))
            parts = [known[topic][s] for s, _, topic in sorted(members)]
            lies = any(kind == "lies" for _, kind in parts)
            points = np.vstack([world for world, _ in parts])
            found.append((stamp, None if lies or not len(points) else points))
        return found[::every], refused


def drive(seed, topics, deskew):
    """A drive none of whose scans is so near to a gap of the poses that its points' times decide."""
    for number in range(seed * 100, seed * 100 + 100):
        made = Drive(number, topics, deskew)
        stamps = np.array([s for scans in made.scans.values() for s, _, _ in scans])
        near = [np.abs(stamps - edge).min() for edge in MISSING]
        if min(near) > SECOND // 50:
            return made
    raise AssertionError("no such drive")


@pytest.mark.parametrize("window", WINDOWS, ids=str)
@pytest.mark.parametrize(
    ("seed", "topics", "deskew", "every"),
    [
        (1, (FRONT,), False, 1),
        (2, (FRONT, BACK), False, 1),
        (3, (FRONT, BACK), True, 1),
        (4, (FRONT,), True, 3),
    ],
)
def test_gathered_clouds_against_one_by_one(tmp_path, seed, topics, deskew, every, window):
    made = drive(seed, topics, deskew)
    path = made.write(tmp_path / "log")
    log = {"cloud_topics": topics, "accumulate": window, "deskew": deskew, "every": every, "max_tf_gap": GAP}
    recording = read_recording(path, LogSection.model_validate(log))
    expected, refused = made.clouds(window, every)
    told = Counter()
    left_out = [re.fullmatch(r"left out (\d+) scans: (.*)", notice) for notice in recording.notices]
    scans = [(found[2], int(found[1])) for found in left_out if found]
    for reason, count in (*recording.refused.items(), *scans):
        told["pose" if reason.startswith("no transform map<-") else reason] += count
    assert told == refused
    assert recording.scans.stamps.tolist() == [stamp for stamp, _ in expected]
    items = list(read_frames(recording, 0, recording.matched))
    for item, (stamp, world) in zip(items, expected, strict=True):
        assert item.stamp == stamp
        if world is None:
            assert isinstance(item, RefusedScan)
            continue
        assert isinstance(item, Frame)
        there = into_robot(world, np.full(len(world), stamp))
        np.testing.assert_allclose(item.points, there, atol=1e-3)
    assert any(world is not None for _, world in expected)
    # Any span, in any process, gives the same.
    copy = pickle.loads(pickle.dumps(recording))
    for first, last in SPANS:
        again = list(read_frames(copy, first, last))
        assert [_bytes(item) for item in again] == [_bytes(item) for item in items[first:last]]


def _bytes(item):
    if isinstance(item, RefusedScan):
        return item
    return item.digest, item.points.tobytes(), item.sensor, item.pose, item.others, item.quality, item.dropped


def test_the_time_of_each_point_is_part_of_what_was_decoded(tmp_path):
    """Two logs that differ in the times of points alone are not the same log, if these count."""
    made = [drive(4, (FRONT,), True) for _ in range(2)]
    deskewed = LogSection.model_validate({"deskew": True, "max_tf_gap": GAP})
    plain = LogSection.model_validate({"max_tf_gap": GAP})
    for number, record in enumerate(made[1].records):
        made[1].records[number] = Record(
            record.topic, record.type, record.time, _times_reversed(record.build)
        )
    paths = [each.write(tmp_path / f"log{number}") for number, each in enumerate(made)]
    for settings, is_same in ((plain, True), (deskewed, False)):
        one, other = (read_recording(path, settings) for path in paths)
        assert one.matched == other.matched > 5
        for a, b in zip(read_frames(one, 0, 5), read_frames(other, 0, 5), strict=True):
            assert type(a) is type(b)
            assert isinstance(a, RefusedScan) or (a.digest == b.digest) == is_same


def _times_reversed(build):
    def changed(store):
        message = build(store)
        rows = message.data.view("<f4").reshape(-1, 4)
        rows[:, 3] = rows[::-1, 3].copy()
        return message

    return changed
