"""Scoring against a naive reference: DESIGN.md's section word by word, on sets of cells and on polygons.

The reference knows only `&`, `|`, `-` and an area. Python's frozensets of unit cells have them, where every
area is an exact integer and ties and thresholds are met exactly; so have shapely's polygons.
"""

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scenes import NOTHING, ignore, label, scored

from gapeval.config import MinVisible, Scoring

COUNTED = [
    "asked",
    "hits",
    "pairs",
    "pairs_on_hits",
    "paired_gaps",
    "tp",
    "fp",
    "fn",
    "false_gaps",
    "ignored",
    "not_counted",
    "scored_frames",
    "empty_frames",
    "shadowed_gaps",
    "gaps",
    "frames",
]
MEASURED = ("iou_sum", "label_area", "covered_area", "over_area_sum", "paired_over_area_sum")
SIDE = 8
RANDOM = settings(
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow],
)


@dataclass
class World:
    """domain and shadow, gap labels by id, ignore regions and detections; regions with &, | and -."""

    domain: object
    shadow: object
    labels: dict
    ignores: list
    gaps: list


@dataclass
class Verdict:
    sums: dict
    rows: dict
    close: list = field(default_factory=list)  # how far the decisions are from their thresholds


def naive(world, rules, area, empty, sliver=0.0):
    """What DESIGN.md says, with loops. Areas up to `sliver` are none."""
    close = []

    def some(region):
        if 0 < area(region) < 1e-8:
            close.append(area(region))
        return area(region) > sliver

    def at_least(value, threshold):
        close.append(abs(value - threshold))
        return value >= threshold

    def together(regions):
        whole = empty
        for region in regions:
            whole = whole | region
        return whole

    sight = world.domain - world.shadow
    seen = {name: g & sight for name, g in world.labels.items()}
    states = {}
    for name, g in world.labels.items():
        enough = min(rules.min_visible.share * area(g), rules.min_visible.area)
        if some(seen[name]) and at_least(area(seen[name]), enough):
            states[name] = "visible" if at_least(area(seen[name]), 0.99 * area(g)) else "partly"
        elif some(g & world.domain) and at_least(area(g & world.domain), enough):
            states[name] = "shadowed"
        else:
            states[name] = "out_of_view"
    asked = [name for name in world.labels if states[name] in ("visible", "partly")]

    parts = [d & sight for d in world.gaps]
    belongs, iou = {}, {}
    for d, part in enumerate(parts):
        for name in asked:
            both = part & seen[name]
            if some(both):
                iou[d, name] = area(both) / area(part | seen[name])
                if at_least(area(both), rules.belongs * min(area(part), area(seen[name]))):
                    belongs[d, name] = True

    covered = {name: area(seen[name] & together(parts)) for name in asked}
    hits = [name for name in asked if at_least(covered[name], rules.hit_coverage * area(seen[name]))]

    allowed = {pair: value for pair, value in iou.items() if at_least(value, rules.iou)}
    matched = best_assignment(allowed, sorted(asked), len(parts))

    false, ignored, not_counted = [], [], []
    everything_ignored = together(world.ignores)
    for d, part in enumerate(parts):
        if d in matched.values():
            continue
        paired = any((d, name) in belongs for name in asked)
        touched = [name for name, g in world.labels.items() if some(world.gaps[d] & g)]
        if not some(part):  # outside the domain, or wholly in shadow
            outside = not some(world.gaps[d] & world.domain)
            no_count, judged = outside or bool(touched), world.gaps[d]
        else:
            no_count, judged = bool(touched) and not set(touched) & set(asked), part
        mostly_ignored = not at_least(0.5 * area(judged), area(judged & everything_ignored))
        if no_count and not paired:
            not_counted.append(d)
        elif mostly_ignored:
            ignored.append(d)
        elif not paired:
            false.append(d)

    everything = together([*world.labels.values(), *world.ignores])
    outside_labels = together(parts) - everything
    paired_parts = [part for d, part in enumerate(parts) if any((d, name) in belongs for name in asked)]
    shadowed = [d for d in false if not at_least(area(parts[d]), area(world.gaps[d] & world.domain) / 2)]
    sums = {
        "frames": 1,
        "gaps": len(parts),
        "scored_frames": 1,
        "empty_frames": int(not asked),
        "asked": len(asked),
        "hits": len(hits),
        "pairs": len(belongs),
        "pairs_on_hits": sum(name in hits for _, name in belongs),
        "paired_gaps": len({d for d, _ in belongs}),
        "tp": len(matched),
        "fp": len(parts) - len(ignored) - len(not_counted) - len(matched),
        "fn": len(asked) - len(matched),
        "false_gaps": len(false),
        "ignored": len(ignored),
        "not_counted": len(not_counted),
        "iou_sum": sum(iou[d, name] for name, d in matched.items()),
        "label_area": sum(area(seen[name]) for name in asked),
        "covered_area": sum(covered.values()),
        "over_area_sum": area(outside_labels),
        "paired_over_area_sum": area(together(paired_parts) - everything),
        "shadowed_gaps": len(shadowed),
    }
    rows = {
        name: {
            "state": states[name],
            "visible_area": area(seen[name]),
            "covered_area": covered.get(name),
            "iou": max((v for (_, n), v in iou.items() if n == name), default=0.0) if name in asked else None,
            "hit": name in hits if name in asked else None,
            "gaps": sum(n == name for _, n in belongs) if name in asked else None,
        }
        for name in world.labels
    }
    return Verdict(sums, rows, close)


def best_assignment(allowed, names, count):
    """Label -> gap: of all one-to-one assignments the one of largest total; ties by label, then gap."""
    best, best_key = {}, (0.0, ())
    choices = [[*(d for d in range(count) if (d, name) in allowed), None] for name in names]
    for choice in itertools.product(*choices):
        taken = [d for d in choice if d is not None]
        if len(set(taken)) < len(taken):
            continue
        total = sum(allowed[d, name] for d, name in zip(choice, names, strict=True) if d is not None)
        order = tuple(-d if d is not None else -math.inf for d in choice)
        key = (round(total, 11), order)
        if not best_key[1] or key > best_key:
            best_key = key
            best = {name: d for name, d in zip(names, choice, strict=True) if d is not None}
    return best


def assert_same(found, verdict):
    for name in COUNTED:
        assert found.sums[name] == verdict.sums[name], name
    for name in MEASURED:
        assert found.sums[name] == pytest.approx(verdict.sums[name], abs=1e-9), name
    assert {row.label for row in found.labels} == set(verdict.rows)
    for row in found.labels:
        expected = verdict.rows[row.label]
        assert (row.state, row.hit, row.gaps) == (expected["state"], expected["hit"], expected["gaps"])
        for name in ("visible_area", "covered_area", "iou"):
            value = getattr(row, name)
            assert value == (None if expected[name] is None else pytest.approx(expected[name], abs=1e-9))


def score_world(world, rules, polygon):
    """gapeval's verdict on a world, whose regions `polygon` turns into polygons."""
    labels = [label(name, polygon(g)) for name, g in world.labels.items()]
    labels += [ignore(f"i{index}", polygon(region)) for index, region in enumerate(world.ignores)]
    gaps = [polygon(d) for d in world.gaps]
    return scored(polygon(world.domain), labels, gaps, polygon(world.shadow), rules)


# --- worlds of cells ---------------------------------------------------------------------------------

CORNER = st.integers(0, SIDE)


@st.composite
def rectangles(draw):
    x, y = sorted((draw(CORNER), draw(CORNER))), sorted((draw(CORNER), draw(CORNER)))
    return frozenset(itertools.product(range(*x), range(*y)))


def regions():
    """Up to two rectangles, perhaps less a third: with holes, and in several parts."""
    return st.builds(lambda a, b, c: (a | b) - c, rectangles(), rectangles(), rectangles())


def some_regions(most):
    return st.lists(regions().filter(bool), max_size=most)


@st.composite
def cell_worlds(draw):
    labels, taken = {}, frozenset()
    for name in draw(st.permutations(["10", "2", "a"])):
        region = draw(regions()) - taken
        if region:
            labels[name] = region
            taken |= region
    inner = frozenset(itertools.product(range(1, SIDE - 1), range(SIDE)))
    domain = draw(st.sampled_from([inner, inner - draw(rectangles())]))
    return World(domain, draw(regions()), labels, draw(some_regions(2)), draw(some_regions(4)))


def rules_of_scoring():
    return st.builds(
        Scoring,
        iou=st.sampled_from([0.5, 0.25, 0.75]),
        hit_coverage=st.sampled_from([0.5, 0.75, 1.0]),
        belongs=st.sampled_from([0.1, 0.25, 0.5]),
        min_visible=st.builds(
            MinVisible, share=st.sampled_from([0.5, 0.25, 1.0]), area=st.sampled_from([0.5, 3.0, 100.0])
        ),
    )


def cells_polygon(cells):
    boxes = [shapely.box(x, y, x + 1, y + 1) for x, y in sorted(cells)]
    return shapely.union_all(boxes) if boxes else NOTHING


@settings(RANDOM, max_examples=400)
@given(cell_worlds(), rules_of_scoring())
def test_sums_equal_the_naive_reference_on_sets_of_cells(world, rules):
    verdict = naive(world, rules, len, frozenset())
    assert_same(score_world(world, rules, cells_polygon), verdict)


def place(cells, rotation, shift):
    """The polygon of some cells, rotated by Pythagorean triples and moved."""
    c, s = rotation
    turned = np.array([[c, -s], [s, c]])
    return shapely.transform(cells_polygon(cells), lambda p: p @ turned.T + shift)


@settings(RANDOM, max_examples=60)
@given(cell_worlds(), st.randoms(use_true_random=False))
def test_neither_order_nor_mirror_nor_rotation_nor_translation_changes_the_sums(world, chance):
    rules = Scoring(belongs=0.123, hit_coverage=0.517, iou=0.513)  # no area of cells is at a threshold
    assume(min(naive(world, rules, len, frozenset()).close, default=1) > 1e-6)
    found = score_world(world, rules, cells_polygon)
    shuffled = World(
        world.domain, world.shadow, world.labels, world.ignores, chance.sample(world.gaps, len(world.gaps))
    )
    mirrored = World(*(mirror(region) for region in vars(world).values()))
    versions = {
        "order": score_world(shuffled, rules, cells_polygon),
        "mirror": score_world(mirrored, rules, cells_polygon),
        "rotation": score_world(world, rules, lambda cells: place(cells, (0.6, 0.8), (0.0, 0.0))),
        "translation": score_world(world, rules, lambda cells: place(cells, (1.0, 0.0), (1024.0, -7.5))),
    }
    for version, other in versions.items():
        for name in COUNTED:
            assert other.sums[name] == found.sums[name], (version, name)
        for name in MEASURED:
            assert other.sums[name] == pytest.approx(found.sums[name], abs=1e-9), (version, name)


def mirror(regions):
    if isinstance(regions, dict):
        return {name: mirror(region) for name, region in regions.items()}
    if isinstance(regions, list):
        return [mirror(region) for region in regions]
    return frozenset((SIDE - 1 - x, y) for x, y in regions)


# --- worlds of polygons ------------------------------------------------------------------------------


def fractions(low, high):
    """Numbers between low and high in steps of 1/64, which shrink well."""
    return st.integers(round(low * 64), round(high * 64)).map(lambda n: n / 64)


@st.composite
def stars(draw):
    """A star-shaped polygon around a random place."""
    count = draw(st.integers(3, 7))
    radii = draw(st.lists(fractions(0.2, 2.5), min_size=count, max_size=count))
    turn = draw(fractions(0, 6))
    theta = turn + np.arange(count) * 2 * np.pi / count
    x, y = draw(fractions(-3, 3)), draw(fractions(-3, 3))
    return shapely.Polygon(np.column_stack([x + radii * np.cos(theta), y + radii * np.sin(theta)]))


class Ground:
    """A shapely polygon as a region: what has no area is dropped."""

    def __init__(self, polygon):
        self.polygon = polygon

    def __and__(self, other):
        return Ground(only_areas(self.polygon & other.polygon, 0.0))

    def __or__(self, other):
        return Ground(only_areas(self.polygon | other.polygon, 0.0))

    def __sub__(self, other):
        return Ground(only_areas(self.polygon - other.polygon, 0.0))


def only_areas(geometry, least=1e-3):
    parts = [
        part for part in shapely.get_parts(geometry) if part.geom_type == "Polygon" and part.area > least
    ]
    return shapely.MultiPolygon(parts)


def shapes():
    """Stars, pairs of stars and stars with a bite."""
    return st.one_of(
        stars(),
        st.builds(lambda a, b: a | b, stars(), stars()),
        st.builds(lambda a, b: only_areas(a - b), stars(), stars()).filter(lambda shape: not shape.is_empty),
    )


@st.composite
def polygon_worlds(draw):
    labels, taken = {}, NOTHING
    for name in draw(st.permutations(["10", "2", "a"])):
        shape = only_areas(draw(shapes()) - taken.buffer(1e-3))
        if not shape.is_empty and shape.is_valid:
            labels[name] = shape
            taken = taken | shape
    shadow = draw(st.one_of(st.just(NOTHING), shapes()))
    return World(
        Ground(shapely.box(-3.1, -2.3, 3.7, 2.9)),
        Ground(shadow),
        {name: Ground(shape) for name, shape in labels.items()},
        draw(st.lists(shapes().map(Ground), max_size=2)),
        draw(st.lists(shapes().map(Ground), max_size=4)),
    )


@settings(RANDOM, max_examples=250)
@given(polygon_worlds(), rules_of_scoring())
def test_sums_equal_the_naive_reference_on_polygons(world, rules):
    verdict = naive(world, rules, lambda region: region.polygon.area, Ground(NOTHING), sliver=1e-9)
    assume(min(verdict.close, default=1) > 1e-9)
    assert_same(score_world(world, rules, lambda region: region.polygon), verdict)
