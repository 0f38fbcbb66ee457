"""A sweep's evaluation, where configurations share their work, against each configuration on its own."""

import itertools
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scenes import ROBOT, label_file

from gapeval.config import (
    BlindBelow,
    BodyBox,
    Config,
    Configuration,
    CrossingRules,
    Detector,
    Domain,
    FieldOfView,
    MinVisible,
    Patch,
    Robot,
    Scoring,
    Sensor,
    limits,
)
from gapeval.detection import detect_each
from gapeval.detection.grid import cell_polygons, cells, corners
from gapeval.detections import METHODS
from gapeval.frame import Frame, Transform, Viewpoint
from gapeval.labels import Label
from gapeval.scoring.metrics import SUMS
from gapeval.scoring.scene import common_domain
from gapeval.share import Share
from gapeval.sweep.evaluation import Question, batches, evaluate, joined
from gapeval.sweep.grid import configurations
from gapeval.traversability import assess_each

RANDOM = settings(
    max_examples=80,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
STAMP = 5
REASONS = ("", "too_long", "gap", "obstacle", "own_gap", "clipped", "unobserved")
VALUES = {
    "detector.k": [6, 5, 4],
    "detector.i_height": [None, 20, 50],
    "detector.i_width": [None, 30, 80],
    "detector.delta_r": [1.05, 1.02, 1.1, 1.5],
    "detector.n_o": [1, 0, 2],
    "detector.pl_th": [0.1, 0.05, 0.3],
    "detector.x_min": [0.6, 0.0, 1.0],
    "detector.r_max": [3.0, 2.5, 4.5],
    "detector.z_min": [math.inf, 0.4],
    "detector.z_max": [2.0, 0.3],
    "detector.origin": ["sensor", "robot"],
    "detector.plane": ["robot", "patch", "gravity"],
    "detector.edge": ["data", "zero"],
    "detector.kernel": ["rect", "cross"],
    "crossing.d_r": [2.0, None, 0.8],
    "crossing.eta": [None, 0.3, 0.8],
    "crossing.standoff": [0.1, None, 0.4],
    "crossing.clearance": [0.05, None, 0.15, 0.0],
    "crossing.uniform": ["area", "kdtree"],
    "crossing.rules": ["all", "paper"],
    "crossing.min_observed": [0.8, 0.5, 1.0],
}


def turned(roll, pitch, yaw):
    """Quaternion x, y, z, w of small pitch and any roll, then yaw [rad]."""
    sr, cr, sp, cp, sy, cy = (f(a / 2) for a in (roll, pitch, yaw) for f in (math.sin, math.cos))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def one_of(rng, *values):
    return values[rng.integers(len(values))]


def grid_of(rng):
    """The distinct configurations of a random grid over any of the parameters, in random order."""
    parameters = {}
    for name, values in VALUES.items():
        section, _, key = name.partition(".")
        parameters.setdefault(section, {})[key] = values[0] if rng.random() < 0.6 else one_of(rng, *values)
    varied = rng.permutation(list(VALUES))[: rng.integers(2, 4)].tolist()
    if rng.random() < 0.7:  # images that differ, on one grid
        varied[0] = f"detector.{one_of(rng, 'n_o', 'n_o', 'pl_th', 'z_max', 'edge', 'kernel')}"
    config = Config(
        grid={name: [VALUES[name][place] for place in some_places(rng, VALUES[name])] for name in varied},
        detector=Detector(**parameters["detector"], patch=Patch(min_points=one_of(rng, 50, 9999, 9999))),
        crossing=CrossingRules(**parameters["crossing"]),
        robot=Robot(
            length=one_of(rng, 0.3, 0.68),
            width=one_of(rng, 0.2, 0.5),
            body=one_of(rng, None, BodyBox(x=(-0.4, 0.4), y=(-0.3, 0.3), z=(-0.2, 0.9))),
        ),
        sensor=Sensor(
            blind_zone=one_of(rng, "auto", "none", BlindBelow(below=-1.0)),
            fov=one_of(
                rng,
                None,
                None,
                FieldOfView(azimuth=(-1.3, 1.0)),
                FieldOfView(azimuth=(-2.0, 2.0), elevation=(-1.2, 0.3)),
            ),
        ),
    )
    found = configurations(config)
    return [found[place] for place in rng.permutation(len(found))]


def viewpoints(rng, frame):
    """None, or up to three of other places, also beyond the box."""
    moved = rng.uniform((-4, -4, 0), (4, 4, 0), (one_of(rng, 0, 0, 1, 3), 3))
    return tuple(
        Viewpoint(
            Transform.of(frame.sensor.translation + offset, frame.sensor.quaternion),
            float(rng.choice([-math.pi / 2, -1.2, -0.9])),
        )
        for offset in moved
    )


def some_places(rng, values):
    return rng.permutation(len(values))[:2].tolist()


def rectangle(low, high):
    return shapely.box(*low, *high)


def world_of(seed):
    """A frame with holes and posts, labels of some holes and of other places, a grid, and rules."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-4.0, 4.0, (6000, 2))
    z = rng.normal(0, 0.02, len(xy)) + one_of(rng, 0.0, 0.03, 0.0) * xy[:, 0]
    regions, hidden, walls = [], [], []
    for right in np.arange(-2.5, 2.5, 1.25)[rng.random(4) < 0.75]:  # strips of ground, a hole in each
        low = np.array([rng.uniform(0.4, 2.2), right + rng.uniform(0.0, 0.4)])
        size = rng.uniform([0.2, 0.3], [1.2, 0.8])
        if rng.random() < 0.4:  # bent: own_gap
            size = np.array([rng.uniform(0.7, 1.2), 0.8])
            island = rectangle(low + size * (0.0, 0.3), low + size * (0.7, 0.7))
            regions.append(rectangle(low, low + size) - island)
        else:
            regions.append(rectangle(low, low + size))
        inside = shapely.contains_xy(regions[-1], xy)
        z[inside] -= 0.7 if rng.random() < 0.5 else 5.0
        if rng.random() < 0.5:  # something behind or before it
            distance = rng.choice([-0.3, rng.uniform(0.15, 0.3)])
            post = low + size * (distance > 0, 0.5) + (distance, 0.0)
            z[np.hypot(*(xy - post).T) < rng.choice([0.12, 0.25])] += rng.uniform(0.3, 1.2)
            if distance > 0 and rng.random() < 0.5:
                side = rng.normal(0, 0.08, (150, 2)) * (0.2, 1.0)
                walls.append(np.column_stack([post + side, rng.uniform(0.2, 1.0, 150)]))
                hidden.append(rectangle(np.add(post, (0.1, -0.05)), np.add(post, (0.3, 0.05))))
    for _ in range(rng.integers(0, 3)):
        z[np.hypot(*(xy - rng.uniform([0.8, -2.0], [3.5, 2.0])).T) < 0.12] += rng.uniform(0.3, 1.2)
    points = np.vstack([np.column_stack([xy, z]), *walls]).astype(np.float32)

    roll, pitch, yaw = rng.normal(0, 0.06, 3)
    roll, yaw = roll + rng.integers(2) * math.pi, yaw + rng.choice([0.0, 0.0, 0.5])
    place = (rng.choice([0.0, 0.2]), rng.choice([0.0, 0.1]), rng.uniform(0.4, 1.0))
    pose = Transform.of((*rng.uniform(-20, 20, 2), 0.3), turned(*rng.normal(0, 0.01, 2), rng.uniform(-3, 3)))
    lowest = float(rng.choice([-math.pi / 2, -1.2, -0.9]))
    frame = Frame(STAMP, points, Transform.of(place, turned(roll, pitch, yaw)), lowest, pose)
    frame = replace(frame, others=viewpoints(rng, frame), up=one_of(rng, None, (0.05, -0.1, 0.9937303457)))

    labels = []
    for index, region in enumerate(regions):
        if rng.random() < 0.75:
            labels.append(drawn(rng, f"hole {index}", "gap", [region], pose))
    for index, region in enumerate(hidden):
        labels.append(drawn(rng, f"hidden {index}", "gap", [region], pose))
    if rng.random() < 0.3:  # far behind, and beside a hole, in two parts of which one has a hole
        far = rectangle((-3.0, -3.0), (-2.0, -2.5))
        part = rectangle((1.6, 2.55), (2.4, 3.2)) - rectangle((1.8, 2.7), (2.2, 3.0))
        labels.append(drawn(rng, "parts", "gap", [far, part], pose))
    if rng.random() < 0.2:
        labels.append(drawn(rng, "away", "gap", [rectangle((5.0, 0.0), (6.0, 1.0))], pose))
    for index in range(rng.integers(0, 3)):
        low = rng.uniform([0.0, -3.0], [2.5, 2.5])
        size = rng.uniform(0.3, 1.5, 2)
        whole = rectangle(low, low + size)
        if rng.random() < 0.5:
            whole -= rectangle(low + 0.3 * size, low + 0.6 * size)
        others = [rectangle((-2.0, 0.0), (-1.0, 1.0))] if rng.random() < 0.5 else []
        labels.append(drawn(rng, f"ignore {index}", "ignore", [whole, *others], pose))
    stamps = frozenset({STAMP + 1}) if rng.random() < 0.05 else None
    known = None if rng.random() < 0.05 else label_file(*labels, stamps=stamps)

    scoring = Scoring(
        iou=one_of(rng, 0.5, 0.2),
        domain=one_of(rng, None, None, Domain(x_min=1.0, r_max=2.2)),
        hit_coverage=one_of(rng, 0.5, 0.2),
        belongs=one_of(rng, 0.1, 0.5),
        min_visible=MinVisible(area=one_of(rng, 0.5, 0.05)),
    )
    return frame, grid_of(rng), known, scoring


worlds = st.integers(0, 2**32 - 1).map(world_of)


def drawn(rng, name, kind, parts, pose):
    """A label of polygons in the robot frame, drawn in it or in the map."""
    in_map = rng.random() < 0.5

    def vertices(ring):
        places = np.column_stack([ring.coords, np.zeros(len(ring.coords))])
        if in_map:
            return pose.apply(places)
        places[:, 2] = math.nan
        return places

    rings = tuple(tuple(map(vertices, (part.exterior, *part.interiors))) for part in parts)
    known = {}
    if kind == "gap":
        known = {
            "traversable": [None, True, False][rng.integers(3)],
            "length": None if rng.random() < 0.3 else float(rng.uniform(0.2, 1.5)),
            "crossing_yaw": None if rng.random() < 0.3 else float(rng.uniform(-3, 3)),
        }
    return Label(name, kind, "map" if in_map else ROBOT, rings, start=STAMP, end=STAMP, **known)


def answers(world, chosen):
    """All that is known of each of the chosen configurations, evaluated together, to the last bit."""
    frame, grid, labels, scoring = world
    domain, origin = common_domain(grid, scoring)
    question = Question(tuple(chosen), scoring, domain, origin, keep_gaps=True)
    found, _ = evaluate(frame, question, labels, ROBOT)
    assert len(found.sums) == len(found.labels) == len(found.fallbacks) == len(found.gaps) == len(chosen)
    return [
        (sums.tobytes(), repr(rows), fallback, repr(gaps))
        for sums, rows, fallback, gaps in zip(
            found.sums, found.labels, found.fallbacks, found.gaps, strict=True
        )
    ], found


def what_is_met(found):
    """How often an answer has each of the things that must be shared right."""
    met = Counter({name: int(found.sums[:, column].sum()) for column, name in enumerate(SUMS)})
    met["configurations"] = len(found.sums)
    met["fallbacks"] = sum(fallback != "" for fallback in found.fallbacks)
    met.update(f"label {row.state}" for rows in found.labels for row in rows)
    for gap in itertools.chain(*found.gaps):
        met.update(f"reason {gap.crossings[method].reason}" for method in METHODS)
    counts = found.sums[:, list(SUMS).index("gaps")]
    met["no gap beside some"] = int(counts.max() > 0 and counts.min() == 0)
    met["different sums"] = int(len(np.unique(found.sums, axis=0)) > 1)
    return met


def test_together_is_the_same_as_each_alone():
    met = Counter()

    @RANDOM
    @given(worlds, st.randoms(use_true_random=False))
    def same(world, random):
        grid = world[1]
        together, found = answers(world, grid)
        assert together == [answers(world, [configuration])[0][0] for configuration in grid]
        for method in METHODS:
            counted = [sum(gap.crossings[method].traversable for gap in gaps) for gaps in found.gaps]
            assert found.sums[:, list(SUMS).index(f"traversable_{method}")].tolist() == counted
        order = random.sample(range(len(grid)), len(grid))
        again, _ = answers(world, [grid[index] for index in order])
        assert again == [together[index] for index in order]
        met.update(what_is_met(found))

    same()
    # The worlds must have what could go wrong in them.
    few = {name: met[f"reason {name}"] for name in REASONS if met[f"reason {name}"] < 50}
    assert not few, "reasons that the worlds are short of"
    for name in ("gaps", "hits", "tp", "false_gaps", "ignored", "not_counted", "pairs"):
        assert met[name] > 5, name
    for name in ("npca_judged", "pca_lengths", "npca_yaws", "traversable_npca", "traversable_pca"):
        assert met[name] > 5, name
    assert met["plane_fallbacks"] > 0
    for state in ("visible", "partly", "shadowed", "out_of_view"):
        assert met[f"label {state}"] > 0, state
    assert met["no gap beside some"] > 0
    assert met["different sums"] > 20


def test_equal_configurations_have_equal_answers():
    """A grid holds each once, but nothing must depend on that."""

    @settings(RANDOM, max_examples=5)
    @given(worlds)
    def same(world):
        chosen = [*world[1][:2], *world[1][:2]]
        first, second, third, fourth = answers(world, chosen)[0]
        assert (first, second) == (third, fourth)

    same()


# --- reasons -----------------------------------------------------------------------------------------


def plain_reason(detection, crossing, robot, rules):
    """The first reason against one crossing, looked for on its own; and how close it is."""
    grid, polygons, surface = detection.surface.grid, detection.gaps.polygons, detection.surface
    least = limits(rules, robot)
    ends = [shapely.Point(crossing.start[:2]), shapely.Point(crossing.end[:2])]
    margins = []

    def within(shapes, distance):
        nearest = min((shape.distance(end) for shape in shapes for end in ends), default=math.inf)
        margins.append(abs(nearest - distance))
        return nearest <= distance

    margins.append(abs(crossing.length - least.d_r))
    if crossing.length > least.d_r:
        return "too_long", min(margins)
    if within([*polygons[: crossing.gap], *polygons[crossing.gap + 1 :]], least.clearance):
        return "gap", min(margins)
    if within(cell_polygons(grid, *np.nonzero(surface.obstacle)), least.clearance):
        return "obstacle", min(margins)
    if within([polygons[crossing.gap]], least.clearance):
        return "own_gap", min(margins)
    if rules.rules == "paper":
        return "", min(margins)
    along = np.array([math.cos(crossing.yaw), math.sin(crossing.yaw)])
    sideways = np.array([-along[1], along[0]])
    own = detection.gaps.labels == crossing.gap + 1
    places = corners(grid)
    for row, column in np.argwhere(own).tolist():
        for down, left, one, other in (
            (-1, 0, (0, 0), (0, 1)),
            (1, 0, (1, 0), (1, 1)),
            (0, -1, (0, 0), (1, 0)),
            (0, 1, (0, 1), (1, 1)),
        ):
            beside = (row + down, column + left)
            if 0 <= beside[0] < grid.rows and 0 <= beside[1] < grid.width:
                known = surface.seen.cells[beside] and (not surface.shaded[beside] or surface.ground[beside])
                if known or surface.gap.cells[beside]:
                    continue
            edge = shapely.LineString([places[row + i, column + j] for i, j in (one, other)])
            offsets = [float((np.array(place) - crossing.centre[:2]) @ sideways) for place in edge.coords]
            nearest = 0.0 if min(offsets) < 0 <= max(offsets) else min(map(abs, offsets))
            margins.append(abs(nearest - robot.width / 2))
            if nearest <= robot.width / 2:
                return "clipped", min(margins)
    shares = []
    for end in ends:
        good = 0
        samples = itertools.product(
            np.linspace(-0.5, 0.5, 9) * robot.length, np.linspace(-0.5, 0.5, 7) * robot.width
        )
        for ahead, aside in samples:
            x, y = np.array(end.coords[0]) + ahead * along + aside * sideways
            (row,), (column,) = cells(grid, np.array([x - grid.origin[0]]), np.array([y - grid.origin[1]]))
            here = abs(x) <= robot.length / 2 and abs(y) <= robot.width / 2
            in_grid = row < grid.rows and column < grid.width
            good += here or (in_grid and surface.ground[row, column] and not surface.gap.cells[row, column])
        shares.append(good / 63)
    return ("unobserved" if min(shares) < rules.min_observed else ""), min(margins)


def some_rules(rng):
    """Rules that all have something to say."""

    def some(low, high):
        return float(rng.uniform(low, high))

    return CrossingRules(
        d_r=some(0.2, 1.5),
        standoff=some(0.02, 0.5),
        eta=some(0.2, 0.9) if rng.random() < 0.2 else None,
        clearance=some(0.0, 0.15),
        uniform="area" if rng.random() < 0.9 else "kdtree",
        rules="all" if rng.random() < 0.9 else "paper",
        min_observed=int(rng.integers(30, 64)) / 63,  # of 63 samples: met exactly at times
    )


def test_each_reason_is_the_plain_one():
    """Crossings of many configurations at once, by both methods, against the rules one by one."""
    met = Counter()

    @settings(RANDOM, max_examples=60)
    @given(worlds, st.integers(0, 2**32 - 1))
    def same(world, seed):
        rng = np.random.default_rng(seed)
        share = Share()
        detections = detect_each(world[0], world[1][:4], share)
        robot = Robot(length=float(rng.uniform(0.3, 0.7)), width=float(rng.uniform(0.1, 0.5)))
        rules = [some_rules(rng) for _ in range(3)]
        asked = [(detection, robot, one) for one in rules for detection in detections]
        crossings = assess_each(asked, share)
        for index, (detection, _, one) in enumerate(asked):
            found = crossings.of(index)
            for row in rng.permutation(len(found))[:12].tolist():
                reason, margin = plain_reason(detection, found[row], robot, one)
                assert margin < 1e-9 or found[row].reason == reason
                met[reason] += margin >= 1e-9

    same()
    assert min(met[reason] for reason in REASONS) > 20, met


@given(st.lists(st.tuples(st.integers(2, 40), st.integers(2, 40)), max_size=12), st.integers(1, 4000))
@settings(deadline=None, derandomize=True)
def test_batches_are_the_configurations_in_order_and_bounded(sizes, most):
    found = [Configuration(detector=Detector(i_height=high, i_width=wide)) for high, wide in sizes]
    parts = list(batches(found, most))
    assert [one for part in parts for one in part] == found
    cells = [[one.detector.height * one.detector.width for one in part] for part in parts]
    assert all(sum(part) <= most or len(part) == 1 for part in cells)
    assert all(sum(part) + following[0] > most for part, following in itertools.pairwise(cells))


def test_batches_joined_are_the_whole():
    frame, grid, labels, scoring = world_of(3)
    domain, origin = common_domain(grid, scoring)
    question = Question(tuple(grid), scoring, domain, origin, keep_gaps=True)
    whole, _ = evaluate(frame, question, labels, ROBOT)
    parts = joined(
        [evaluate(frame, replace(question, configurations=(one,)), labels, ROBOT)[0] for one in grid]
    )
    assert len(grid) > 2
    assert parts.sums.tobytes() == whole.sums.tobytes()
    assert repr((parts.labels, parts.fallbacks, parts.gaps)) == repr(
        (whole.labels, whole.fallbacks, whole.gaps)
    )
