"""Section 3.1 of the paper, spelled out: loops over plain floats, nothing shared with gapeval.detection.

Radii are formed as Eq. (5) is printed, in decimals, which do not overflow where floats do. The image has no
bounds: rows go on outwards further than any opening reaches, columns go on around the full circle.
"""

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache

import numpy as np
import shapely

from gapeval.config import BodyBox, Detector, FieldOfView

Place = tuple[float, float]
Point = tuple[float, float, float]
Cell = tuple[int, int]  # row, column
Image = list[list[bool]]

SMALLEST_ROW = 1e-6  # m
TOO_CLOSE = 1e-9
TOO_CLOSE_IN_BINS = 1e-6
# The box in z is compared in the points' own precision, which is float32.
TOO_CLOSE_IN_Z = 1e-6


class DoubtfulError(Exception):
    """Rounding decides what is hidden from another viewpoint."""


@dataclass(frozen=True)
class Mount:
    """robot<-sensor: translation [m] and unit quaternion x, y, z, w."""

    translation: Point
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True)
class Scene:
    """All that decides which cell is what, but the points. lowest: elevation of the lowest ray [rad]."""

    params: Detector
    plane: tuple[float, float, float, float]
    mount: Mount
    lowest: float = -math.pi / 2
    fov: FieldOfView | None = None
    body: BodyBox | None = None
    others: tuple[tuple[Mount, float], ...] = ()  # other viewpoints, with their lowest rays

    @property
    def pole(self) -> Place:
        return (0.0, 0.0) if self.params.origin == "robot" else self.mount.translation[:2]

    @property
    def rows(self) -> int:
        """Rows in the box: what Eq. (3) reaches only at r = R is no row of it."""
        return self.params.height - 1

    @property
    def theta_int(self) -> float:
        return math.pi / self.params.width


@dataclass(frozen=True)
class Marks:
    """Algorithm 1's image, (rows in the box, columns in front), and the gaps as sets of cells."""

    ground: Image
    obstacle: Image
    shaded: Image
    seen: Image
    gap: Image
    regions: list[set[Cell]]


def detect(scene: Scene, points: Iterable[Point]) -> Marks:
    """Algorithm 1 for points without doubtful ones; see `is_doubtful`."""
    rows, columns = scene.rows + margin(scene), 2 * scene.params.width
    ground, obstacle = blank(rows, columns), blank(rows, columns)
    edges = radii(scene, rows)
    for point in points:
        if not in_height(scene, point) or is_of_body(scene.body, point):
            continue
        row, column = cell_of(scene, edges, point)
        if row >= rows:
            continue
        t = distance(scene, point)
        if abs(t) <= scene.params.pl_th:
            ground[row][column] = True
        elif t > scene.params.pl_th:
            obstacle[row][column] = True
    shaded = shade(obstacle)
    if scene.others:
        shaded = shade_from_all(scene, ground, obstacle, shaded)
    seen = cells_seen(scene)
    unmarked = [
        [not (ground[row][column] or shaded[row][column]) for column in range(columns)] for row in range(rows)
    ]
    if scene.params.edge == "zero":
        unmarked = [
            [value and is_set(seen, r, c) for c, value in enumerate(unmarked[r])] for r in range(rows)
        ]
    opened = opening(unmarked, scene.params.n_o, scene.params.kernel)
    gap = [[opened[r][c] and seen[r][c] for c in range(scene.params.width)] for r in range(scene.rows)]
    return Marks(box(scene, ground), box(scene, obstacle), box(scene, shaded), seen, gap, regions(gap))


def margin(scene: Scene) -> int:
    """Rows beyond the box: more than an opening can reach."""
    return 3 * scene.params.n_o + 2


def blank(rows: int, columns: int) -> Image:
    return [[False] * columns for _ in range(rows)]


def is_set(image: Image, row: int, column: int) -> bool:
    return row < len(image) and column < len(image[row]) and image[row][column]


def box(scene: Scene, image: Image) -> Image:
    return [row[: scene.params.width] for row in image[: scene.rows]]


def radii(scene: Scene, rows: int) -> tuple[float, ...]:
    """Edges of the rows [m]."""
    return edges_of_rows(scene.params.height, scene.params.delta_r, scene.params.r_max, rows)


@lru_cache
def edges_of_rows(height: int, delta_r: float, r_max: float, rows: int) -> tuple[float, ...]:
    """Eq. (3) solved for r, with Eq. (5) as printed."""
    with localcontext() as context:
        context.prec = 60
        growth = Decimal(delta_r)
        r_d = Decimal(r_max) / (growth ** (height - 1) - 1)
        return tuple(float(r_d * (growth**row - 1)) for row in range(rows + 1))


def polar(scene: Scene, point: Sequence[float]) -> tuple[float, float]:
    """Eq. (4), and the azimuth counted from -y over +x, 0 <= theta < 2 pi, around the grid's pole."""
    x, y = point[0] - scene.pole[0], point[1] - scene.pole[1]
    return math.sqrt(x * x + y * y), (math.atan2(y, x) + math.pi / 2) % (2 * math.pi)


def cell_of(scene: Scene, edges: Sequence[float], point: Sequence[float]) -> Cell:
    """Eqs. (2) and (3); len(edges) - 1 or more is a row beyond the image."""
    r, theta = polar(scene, point)
    return bisect_right(edges, r) - 1, math.floor(theta / scene.theta_int) % (2 * scene.params.width)


def distance(scene: Scene, point: Sequence[float]) -> float:
    """Eq. (1)."""
    a, b, c, d = scene.plane
    return (a * point[0] + b * point[1] + c * point[2] + d) / math.sqrt(a * a + b * b + c * c)


def in_height(scene: Scene, point: Sequence[float]) -> bool:
    return -scene.params.z_min <= point[2] <= scene.params.z_max


def is_of_body(body: BodyBox | None, point: Sequence[float]) -> bool:
    if body is None:
        return False
    return all(low <= value <= high for value, (low, high) in zip(point, sides(body), strict=True))


def sides(body: BodyBox) -> list[tuple[float, float]]:
    return [body.x, body.y, body.z]


def shade(obstacle: Image) -> Image:
    """From each obstacle outwards: "all pixels behind (occluded) positive obstacle"."""
    shaded = blank(len(obstacle), len(obstacle[0]))
    for row in range(len(obstacle)):
        for column in range(len(obstacle[0])):
            if obstacle[row][column]:
                for behind in range(row, len(obstacle)):
                    shaded[behind][column] = True
    return shaded


def shade_from_all(scene: Scene, ground: Image, obstacle: Image, shaded: Image) -> Image:
    """A cell in which neither an obstacle nor ground was seen is shaded if an obstacle stands before it for
    each viewpoint that looks there. What nobody looks at stays as it is.
    """
    rows, columns = len(shaded), len(shaded[0])
    edges = radii(scene, rows)
    away = [math.dist(mount.translation[:2], scene.pole) for mount, _ in scene.others]
    known = bisect_right(edges, max(scene.params.r_max, *away))
    standing = [
        shapely.Polygon(quadrilateral(scene, (row, column)))
        for row in range(min(known, rows))
        for column in range(columns)
        if obstacle[row][column]
    ]
    empty = [
        (row, column)
        for row in range(rows)
        for column in range(columns)
        if not (ground[row][column] or obstacle[row][column])
    ]
    hidden: dict[Cell, list[bool]] = {cell: [] for cell in empty}
    for row, column in empty:
        if looks_at(scene, scene.mount, scene.lowest, midpoint(scene, edges, (row, column))):
            hidden[row, column].append(shaded[row][column])
    for mount, lowest in scene.others:
        places = {cell: midpoint(scene, edges, cell) for cell in empty}
        seen = [cell for cell in empty if looks_at(scene, mount, lowest, places[cell])]
        if distance(scene, mount.translation) > 0 and seen:
            behind = stands_before(scene, mount.translation[:2], [places[cell] for cell in seen], standing)
            for cell, value in zip(seen, behind, strict=True):
                hidden[cell].append(value)
    marks = [list(row) for row in shaded]
    for (row, column), values in hidden.items():
        if values:
            marks[row][column] = all(values)
    return marks


def stands_before(
    scene: Scene, origin: Place, places: Sequence[Place], standing: Sequence[shapely.Polygon]
) -> list[bool]:
    """Of each place: whether a cell that reaches into its bin has its nearest point nearer than the place.

    Raises DoubtfulError.
    """
    view = shapely.Point(origin)
    if any(shapely.distance(cell.boundary, view) < TOO_CLOSE for cell in standing):
        raise DoubtfulError
    outside = np.array([cell for cell in standing if not shapely.contains(cell, view)], dtype=object)
    step = 2 * math.pi / max(720, 4 * scene.params.width)
    directions = [math.atan2(y - origin[1], x - origin[0]) / step for x, y in places]
    if any(abs(direction - round(direction)) < TOO_CLOSE_IN_BINS for direction in directions):
        raise DoubtfulError
    sides = [(math.floor(direction) * step, math.ceil(direction) * step) for direction in directions]
    ends = [[(origin[0] + 99 * math.cos(a), origin[1] + 99 * math.sin(a)) for a in pair] for pair in sides]
    bins = np.array([shapely.Polygon([origin, *pair]) for pair in ends], dtype=object)
    behind = [False] * len(places)
    for place, cell in shapely.STRtree(outside).query(bins, "dwithin", TOO_CLOSE).T.tolist():
        if shapely.area(shapely.intersection(bins[place], outside[cell])) < 1e-12:
            raise DoubtfulError
        ahead = math.dist(origin, places[place]) - shapely.distance(outside[cell], view)
        if abs(ahead) < TOO_CLOSE:
            raise DoubtfulError
        behind[place] = behind[place] or ahead > 0
    return behind


def looks_at(scene: Scene, mount: Mount, lowest: float, place: Place) -> bool:
    """Whether a sensor there looks at the plane at a place."""
    elevation, azimuth = looking(scene, mount, place)
    if elevation < lowest:
        return False
    if scene.fov is None:
        return True
    low, high = scene.fov.elevation
    left, right = scene.fov.azimuth
    return low <= elevation <= high and left <= azimuth <= right


def opening(image: Image, n_o: int, kernel: str) -> Image:
    for _ in range(n_o):
        image = filtered(image, kernel, keep_if=all)
    for _ in range(n_o):
        image = filtered(image, kernel, keep_if=any)
    return image


def filtered(image: Image, kernel: str, keep_if) -> Image:  # type: ignore[no-untyped-def]
    """One erosion (all) or dilation (any); nothing lies on the near side of row 0."""
    steps = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if kernel == "rect" or i * j == 0]
    rows, columns = len(image), len(image[0])
    return [
        [
            keep_if(image[row + i][(column + j) % columns] for i, j in steps if 0 <= row + i < rows)
            for column in range(columns)
        ]
        for row in range(rows)
    ]


def midpoint(scene: Scene, edges: Sequence[float], cell: Cell) -> Place:
    r = (edges[cell[0]] + edges[cell[0] + 1]) / 2
    theta = (cell[1] + 0.5) * scene.theta_int - math.pi / 2
    return scene.pole[0] + r * math.cos(theta), scene.pole[1] + r * math.sin(theta)


def quadrilateral(scene: Scene, cell: Cell) -> list[Place]:
    """The cell's four corners [m]."""
    edges = radii(scene, max(scene.rows, cell[0] + 1))
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    outline = [
        (edges[cell[0] + i], (cell[1] + j) * math.pi / scene.params.width - math.pi / 2) for i, j in corners
    ]
    return [(scene.pole[0] + r * math.cos(a), scene.pole[1] + r * math.sin(a)) for r, a in outline]


def cells_seen(scene: Scene) -> Image:
    edges = radii(scene, scene.rows)
    return [
        [
            edges[row + 1] - edges[row] >= SMALLEST_ROW
            and is_seen(scene, midpoint(scene, edges, (row, column)))
            for column in range(scene.params.width)
        ]
        for row in range(scene.rows)
    ]


def is_seen(scene: Scene, place: Place) -> bool:
    """In the box, and not outside of what the sensor looks at."""
    if place[0] < scene.params.x_min:
        return False
    above = [view for view in scene.others if distance(scene, view[0].translation) > 0]
    return any(looks_at(scene, *view, place) for view in [(scene.mount, scene.lowest), *above])


def looking(scene: Scene, mount: Mount, place: Place) -> tuple[float, float]:
    """Elevation and azimuth [rad] of the plane at a place, in the sensor frame; for a sensor that hangs
    upside down, elevation is nevertheless positive upwards."""
    a, b, c, d = scene.plane
    ground = (place[0], place[1], -(a * place[0] + b * place[1] + d) / c)
    offset = [g - t for g, t in zip(ground, mount.translation, strict=True)]
    x, y, z = rotated_back(mount.quaternion, offset)
    qx, qy = mount.quaternion[:2]
    hangs = qx * qx + qy * qy > 0.5  # 1 - 2 (qx qx + qy qy) is how far the sensor's z axis points up
    return math.atan2(-z if hangs else z, math.sqrt(x * x + y * y)), math.atan2(y, x)


def rotated_back(quaternion: Sequence[float], v: Sequence[float]) -> list[float]:
    """A vector under the inverse rotation: v + 2 w (u x v) + 2 u x (u x v), with u turned around."""
    w = quaternion[3]
    u = [-value for value in quaternion[:3]]
    once = crossed(u, v)
    twice = crossed(u, once)
    return [v[i] + 2 * w * once[i] + 2 * twice[i] for i in range(3)]


def crossed(u: Sequence[float], v: Sequence[float]) -> list[float]:
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]


def regions(image: Image) -> list[set[Cell]]:
    """Sets of cells that touch at an edge or a corner, in raster order of their first cell."""
    left = {(r, c) for r, row in enumerate(image) for c, value in enumerate(row) if value}
    found = []
    for seed in sorted(left):
        if seed not in left:
            continue
        region, pending = set(), [seed]
        left.remove(seed)
        while pending:
            row, column = pending.pop()
            region.add((row, column))
            for cell in [(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]:
                if cell in left:
                    left.remove(cell)
                    pending.append(cell)
        found.append(region)
    return found


def is_doubtful(scene: Scene, edges: Sequence[float], point: Point) -> bool:
    """Whether a point lies so near to an edge or a threshold that rounding decides about it."""
    r, theta = polar(scene, point)
    row = bisect_right(edges, r)
    nearest = min(abs(r - edge) for edge in edges[max(row - 1, 0) : row + 1])
    # Where edges crowd, r_d (delta_r**l - 1) and r_d are of one size: the distance counts against both.
    if r == 0.0 or nearest < TOO_CLOSE * (r + edges[1]):
        return True
    column = theta / scene.theta_int
    if abs(column - round(column)) < TOO_CLOSE:
        return True
    t = distance(scene, point)
    if abs(abs(t) - scene.params.pl_th) < TOO_CLOSE:
        return True
    params = scene.params
    if min(abs(point[2] + params.z_min), abs(point[2] - params.z_max)) < TOO_CLOSE_IN_Z:
        return True
    if scene.body is None:
        return False
    return any(
        abs(value - side) < TOO_CLOSE_IN_Z
        for value, pair in zip(point, sides(scene.body), strict=True)
        for side in pair
    )


def has_doubtful_cells(scene: Scene) -> bool:
    """Whether rounding decides about the midpoint of any cell."""
    rows, columns = scene.rows, scene.params.width
    if scene.others:  # who looks where decides about cells beyond the box, too
        rows, columns = rows + margin(scene), 2 * columns
    edges = radii(scene, rows)
    return any(
        is_doubtful_place(scene, midpoint(scene, edges, (row, column)))
        for row in range(rows)
        for column in range(columns)
    )


def is_doubtful_place(scene: Scene, place: Place) -> bool:
    # A pole at x_min exactly is no matter of rounding: all cells are in front of it.
    if scene.pole[0] != scene.params.x_min and abs(place[0] - scene.params.x_min) < TOO_CLOSE:
        return True
    return any(is_doubtful_view(scene, *view, place) for view in [(scene.mount, scene.lowest), *scene.others])


def is_doubtful_view(scene: Scene, mount: Mount, lowest: float, place: Place) -> bool:
    elevation, azimuth = looking(scene, mount, place)
    limits = [] if lowest <= -math.pi / 2 else [lowest]
    if any(abs(elevation - limit) < TOO_CLOSE for limit in limits):
        return True
    if scene.fov is None:
        return False
    if any(abs(elevation - limit) < TOO_CLOSE for limit in scene.fov.elevation):
        return True
    straight_down = math.cos(elevation) < 1e-6
    return straight_down or any(abs(azimuth - limit) < TOO_CLOSE for limit in scene.fov.azimuth)
