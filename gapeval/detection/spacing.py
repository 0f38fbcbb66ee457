"""How far apart echoes lie on the ground, and how well the rows of a grid match that (Section 4.2.1, Fig. 9).

For frames of ground without gaps, such as those of the simulated scene `plain`.
"""

from dataclasses import dataclass

import numpy as np

from gapeval.config import Configuration
from gapeval.detection import detect, pole, shape
from gapeval.detection.grid import polar_grid, row_edges
from gapeval.detection.plane import supporting_plane
from gapeval.frame import FloatArray, Frame, sensor_angles
from gapeval.ragged import IndexArray
from gapeval.visibility import in_box, without_body

SECTOR = np.deg2rad(0.5)  # of azimuth, where echoes do not come in columns
SAME_COLUMN = 1e-5  # rad; float32 moves an echo by less than this about the sensor, at arm's length
COLUMN = 3  # echoes that a column has where the sensor has columns
# Distances on each side that one is held against: more than echoes of one ring that share a sector.
NEIGHBOURS = 5
TOO_FAR = 5.0  # times the distances beside it; no sensor's rings grow as fast
ROUNDING = 1e-9  # of a row's length


@dataclass(frozen=True, slots=True)
class Match:
    """How well a grid's rows match the echoes.

    filled: share of the cells that are seen, and not shaded, that hold an echo of the ground. ratio: of a
    row's width to the distance between echoes at its radius, median over rows. NaN where there are none.
    """

    filled: float
    ratio: float


def bin_match(frame: Frame, configuration: Configuration) -> Match:
    """A ratio of about 1 fills most cells; a larger one fills more and resolves less (Section 4.2.1)."""
    surface = detect(frame, configuration).surface
    visible = surface.seen.cells & ~surface.shaded
    filled = float(surface.ground[visible].mean()) if visible.any() else np.nan
    return Match(filled, _ratio(frame, configuration))


def radial_spacing(frame: Frame, configuration: Configuration) -> tuple[FloatArray, FloatArray]:
    """Distances [m] between echoes of the ground that follow each other outwards in a column of rays.

    Returns r (M,), the radius of the middle of each from the grid's origin, and spacing (M,). Echoes are
    those within pl_th of the plane in the sensory box. A distance of more than 5 times those beside it in
    its column (of up to 5 on each side, the one in which half of their length lies) is left out, as one
    across ground without data; so is one that has none beside it.
    """
    azimuth, r = _ground_echoes(frame, configuration)
    column = _columns(azimuth)
    order = np.lexsort((r, column))
    column, r = column[order], r[order]
    follows = column[1:] == column[:-1]
    spacing, middle = np.diff(r)[follows], ((r[1:] + r[:-1]) / 2)[follows]
    usual = _usual(spacing, column[1:][follows])
    with np.errstate(invalid="ignore"):
        kept = spacing <= TOO_FAR * usual
    return middle[kept], spacing[kept]


def _ground_echoes(frame: Frame, configuration: Configuration) -> tuple[FloatArray, FloatArray]:
    """Of the ground's echoes (N,): azimuth in the sensor frame [rad], radius from the grid's origin [m]."""
    params, robot = configuration.detector, configuration.robot
    fit = supporting_plane(frame, params.plane, params.patch, params.x_min, robot.ground_z, robot.body)
    points = without_body(frame.points, robot.body).astype(np.float64)
    origin = pole(frame, params.origin)
    z = points[:, 2]
    on_plane = (np.abs(fit.plane.distance(points)) <= params.pl_th) & (z >= -params.z_min)
    on_plane &= (z <= params.z_max) & in_box(points[:, :2], params.x_min, origin, params.r_max)
    points = points[on_plane]
    r = np.hypot(points[:, 0] - origin[0], points[:, 1] - origin[1])
    return sensor_angles(frame.sensor, points)[0], r


def _columns(azimuth: FloatArray) -> IndexArray:
    """The column (N,) of each echo, by its azimuth in the sensor frame [rad].

    A spinning sensor has columns of rays with one azimuth; several of them in one sector would shuffle
    their echoes, and halve what is measured. Where no such columns are, a column is a sector of 0.5 degrees.
    """
    if not len(azimuth):
        return np.empty(0, dtype=np.intp)
    order = np.argsort(azimuth, kind="stable")
    step = np.diff(azimuth[order], prepend=-np.inf) > SAME_COLUMN
    column = np.empty(len(azimuth), dtype=np.intp)
    column[order] = np.cumsum(step) - 1
    members = np.bincount(column)[column]
    if np.median(members) >= COLUMN:
        return column
    sector: IndexArray = np.floor(azimuth / SECTOR).astype(np.intp)
    return sector


def _usual(spacing: FloatArray, column: IndexArray) -> FloatArray:
    """What the distances (M,) beside each in its column are like: NaN where there are none.

    The median by length, since echoes of one ring that happen to share a sector are only noise apart.
    """
    count = len(spacing)
    shifts = [shift for shift in range(-NEIGHBOURS, NEIGHBOURS + 1) if shift]
    beside = np.arange(count)[:, None] + shifts
    inside = (beside >= 0) & (beside < count)
    beside = np.clip(beside, 0, max(count - 1, 0))
    inside &= column[beside] == column[:, None]
    values = np.sort(np.where(inside, spacing[beside], 0.0), axis=1)
    length = np.cumsum(values, axis=1)
    half = np.argmax(length >= length[:, -1:] / 2, axis=1)
    usual: FloatArray = np.where(inside.any(axis=1), values[np.arange(count), half], np.nan)
    return usual


def _ratio(frame: Frame, configuration: Configuration) -> float:
    """The median over rows of their width by the distance between echoes in the row."""
    grid = polar_grid(*shape(frame, configuration.detector))
    edges = row_edges(grid, grid.rows)
    ratios = np.diff(edges) / _in_rows(edges, *radial_spacing(frame, configuration))
    known = np.isfinite(ratios)
    return float(np.median(ratios[known])) if known.any() else np.nan


def _in_rows(edges: FloatArray, r: FloatArray, spacing: FloatArray) -> FloatArray:
    """Of each row (L,) between edges (L + 1,), the distances that lie in it: their median by length.

    Half of the row is ground between echoes that are no farther apart; so a ring that several echoes of a
    sector share counts by the ground beside it. NaN where there is none.
    """
    low, high = r - spacing / 2, r + spacing / 2
    rows = len(edges) - 1
    first = np.maximum(np.searchsorted(edges, low, side="right") - 1, 0)
    last = np.minimum(np.searchsorted(edges, high, side="left"), rows)
    counts = np.maximum(last - first, 0)
    which = np.repeat(np.arange(len(r)), counts)
    row = np.repeat(first - (np.cumsum(counts) - counts), counts) + np.arange(len(which))
    length = np.minimum(high[which], edges[row + 1]) - np.maximum(low[which], edges[row])
    order = np.lexsort((spacing[which], row))
    row, length, distance = row[order], length[order], spacing[which][order]
    in_row = np.bincount(row, weights=length, minlength=rows)
    before = (np.cumsum(in_row) - in_row)[row]
    enough = in_row[row] * (0.5 - ROUNDING)  # of two that cover a row alike, the lesser
    half = np.flatnonzero(np.cumsum(length) - before >= enough)
    found, at = np.unique(row[half], return_index=True)
    medians = np.full(rows, np.nan)
    medians[found] = distance[half[at]]
    return medians
