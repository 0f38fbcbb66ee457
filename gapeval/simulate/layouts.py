"""The scenes. A seed varies where things are and how large, never what the scene is about.

Lengths are metres in the fixed frame. A scene that closes in on the robot is laid out for the paper's, and
grows with the length of others.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from gapeval.config import Robot
from gapeval.frame import FloatArray
from gapeval.simulate.scene import (
    Ground,
    Hole,
    Scene,
    Solid,
    block,
    column,
    rectangle,
    roughness,
    turned,
)
from gapeval.simulate.sensors import Sensor

ROUGH = 0.01  # m, standard deviation of the ground
LEVEL = np.zeros((1, 2))
PAPERS_ROBOT = Robot().length
TRIES = 2000  # to place things at random

Build = Callable[[np.random.Generator, Sensor, int], Scene]


@dataclass(frozen=True, slots=True)
class Layout:
    """A kind of scene. frames: how many clouds are taken if nobody says."""

    about: str
    frames: int
    build: Build


def tunnel(random: np.random.Generator, sensor: Sensor, frames: int) -> Scene:
    """Section 4.1.1, first scenario: closed in by gaps on all sides."""
    scale = sensor.robot.length / PAPERS_ROBOT
    front = (0.85, random.uniform(0.6, 0.8), 1.0)
    holes = _around(random, scale, front)
    wreck = _wreck(random, scale)
    solids = (*_tunnel_walls(scale), *wreck, *_debris(random, scale, holes, wreck))
    return Scene(_ground(random, scale), holes, solids, _shuffled(random, frames, scale))


def barrel(random: np.random.Generator, sensor: Sensor, frames: int) -> Scene:
    """Section 4.1.1, second scenario: one small gap ahead can be crossed; a barrel shades ground."""
    scale = sensor.robot.length / PAPERS_ROBOT
    # As near as the robot has seen the ground on which it would stand before the gap.
    near = max(0.75 * scale, sensor.first_ground + 0.6 * sensor.robot.length) / scale
    holes = _around(random, scale, (near, random.uniform(0.24, 0.29), 0.9))
    place = scale * (np.array([near + 1.2, 0.6]) + random.uniform(-0.1, 0.1, 2))
    drum = column((float(place[0]), float(place[1])), 0.29 * scale, 0.88 * scale)
    solids = (*_tunnel_walls(scale), drum)
    return Scene(_ground(random, scale), holes, solids, _shuffled(random, frames, scale))


def street(random: np.random.Generator, sensor: Sensor, frames: int) -> Scene:
    """Section 4.1.2: gaps outdoors, seen from positions a to h around them; people pass before c and d."""
    shapes = {
        "trench": rectangle((0.0, 3.2), (5.0, 0.9), random.uniform(-0.15, 0.15)),
        "pit": rectangle((3.7, -0.6), (1.6, 1.2), random.uniform(-0.3, 0.3)),
        "drain": rectangle((-3.3, -1.0), (0.5, 2.4), random.uniform(-0.2, 0.2)),
        "corner": shapely.Polygon(
            np.array([[-0.8, -4.9], [1.5, -4.9], [1.5, -4.3], [-0.1, -4.3], [-0.1, -3.4], [-0.8, -3.4]])
            + random.uniform(-0.1, 0.1, 2)
        ),
    }
    holes = tuple(
        Hole(name, ragged(shape, random), random.uniform(0.5, 1.2)) for name, shape in shapes.items()
    )
    positions = np.array(
        [
            [0.0, 0.9, 90],
            [1.4, 0.4, -15],
            [-1.2, 0.0, 200],
            [0.0, -1.6, -95],
            [2.6, -3.1, 70],
            [-4.8, 3.2, -60],
            [0.0, 6.8, -90],
            [4.4, 4.2, 195],
        ]
    )
    there_and_back = 7 - np.abs(np.arange(frames) % 14 - 7)  # a ... h ... a
    stops = positions[there_and_back] * [1, 1, np.pi / 180]
    stops = stops + random.uniform(-1, 1, stops.shape) * [0.15, 0.15, 0.1]
    passing = tuple(
        _people(random, stop, holes) if place in (2, 3) else ()
        for place, stop in zip(there_and_back.tolist(), stops, strict=True)
    )
    posts = tuple(column((x, y), 0.08, 2.5) for x, y in ((-6.0, 5.0), (-2.0, 7.5), (6.5, 1.5), (5.0, -5.5)))
    house = block((0.0, 10.0), (24.0, 0.4), (0.0, 5.0))
    van = block((8.5, -3.0), (2.0, 4.8), (0.3, 2.2), random.uniform(-0.3, 0.3))
    ground = Ground(LEVEL, roughness(random, ROUGH), (-15.0, -15.0, 15.0, 15.0))
    return Scene(ground, holes, (house, van, *posts), stops, passing)


def approach(random: np.random.Generator, sensor: Sensor, frames: int) -> Scene:
    """The robot drives from 10 m towards trenches of three widths, side by side."""
    widths = random.permutation([0.27, 0.6, 1.2]) * random.uniform(0.92, 1.08, 3)
    holes = tuple(
        Hole(
            f"trench_{round(100 * width)}cm",
            ragged(shapely.box(10.0, y - 0.95, 10.0 + width, y + 0.95), random),
            random.uniform(0.5, 1.2),
        )
        for width, y in zip(widths.tolist(), (-2.2, 0.0, 2.2), strict=True)
    )
    end = 10.0 - 0.75 * sensor.robot.length
    stops = np.zeros((frames, 3))
    stops[:, 0] = np.linspace(0.0, end, frames)
    stops[:, 1:] = random.uniform(-0.03, 0.03, (frames, 2))
    ground = Ground(LEVEL, roughness(random, ROUGH), (-2.0, -8.0, 20.0, 8.0))
    return Scene(ground, holes, (), stops)


def plain(random: np.random.Generator, sensor: Sensor, frames: int) -> Scene:
    """Nothing but rough ground: every gap that is found is false."""
    stops = np.zeros((frames, 3))
    stops[:, 0] = 5.0 - np.abs(0.5 * np.arange(frames) % 10.0 - 5.0)  # to and fro
    stops[:, 1:] = random.uniform(-0.1, 0.1, (frames, 2))
    ground = Ground(LEVEL, roughness(random, ROUGH), (-6.0, -12.0, 17.0, 12.0))
    return Scene(ground, (), (), stops)


def slope(random: np.random.Generator, sensor: Sensor, frames: int) -> Scene:
    """Up a ramp, over its top and down again: no gap, but ground that falls out of sight like one."""
    profile = ramp(np.deg2rad(random.uniform(11, 15)))
    stops = np.zeros((frames, 3))
    stops[:, 0] = np.linspace(0.0, 14.0, frames) + random.uniform(-0.1, 0.1, frames)
    stops[:, 1:] = random.uniform(-0.05, 0.05, (frames, 2))
    ground = Ground(profile, roughness(random, ROUGH), (-6.0, -12.0, 26.0, 12.0))
    return Scene(ground, (), (), stops)


SCENES = {
    "tunnel": Layout("closed in by gaps on all sides; a wreck, walls and debris (paper, 4.1.1)", 8, tunnel),
    "barrel": Layout(
        "one small gap ahead that can be crossed; a barrel shades the ground (paper, 4.1.1)", 8, barrel
    ),
    "street": Layout(
        "outdoors: four gaps from eight positions, two people in the way (paper, 4.1.2)", 8, street
    ),
    "approach": Layout("drives from 10 m towards trenches of three widths", 20, approach),
    "plain": Layout("rough ground without any gap: false gaps only", 10, plain),
    "slope": Layout("up a ramp and down again: no gap, but a false cliff at its edges", 12, slope),
}


def ramp(angle: float) -> FloatArray:
    """Profile (4, 2) of a ramp up, a plateau and the ramp down [m]; angle: of the ramps [rad]."""
    top = 3.0 * np.tan(angle)
    return np.array([[3.0, 0.0], [6.0, top], [10.0, top], [13.0, 0.0]])


def ragged(shape: shapely.Polygon, random: np.random.Generator) -> shapely.Polygon:
    """A broken edge: vertices every 0.4 m or less, moved by up to 2 cm."""
    ring = shapely.get_coordinates(shapely.segmentize(shape, 0.4).exterior)[:-1]
    return shapely.Polygon(np.round(ring + random.uniform(-0.02, 0.02, ring.shape), 6))


def _around(random: np.random.Generator, scale: float, front: tuple[float, float, float]) -> tuple[Hole, ...]:
    """Gaps before, beside and behind the robot. front: distance, width across, half its length."""
    near, width, half = front
    left, right, rear = random.uniform(0.6, 0.8, 3)
    boxes = {
        "front": (near, -half, near + width, half),
        "left": (-1.0, 1.3, 2.2, 1.3 + left),
        "right": (-1.0, -1.3 - right, 2.0, -1.3),
        "rear": (-0.95 - rear, -1.05, -0.95, 1.05),
    }
    holes = []
    for name, box in boxes.items():
        dx, dy = random.uniform(-0.08, 0.08, 2)
        corners = scale * (np.array(box) + np.array([dx, dy, dx, dy]))
        holes.append(Hole(name, ragged(shapely.box(*corners), random), scale * random.uniform(0.4, 0.9)))
    return tuple(holes)


def _ground(random: np.random.Generator, scale: float) -> Ground:
    x0, y0, x1, y1 = np.array([-4.0, -4.0, 9.0, 4.0]) * scale
    return Ground(LEVEL, roughness(random, ROUGH), (float(x0), float(y0), float(x1), float(y1)))


def _tunnel_walls(scale: float) -> tuple[Solid, ...]:
    """Walls on both sides, a roof, and both ends."""
    return (
        block((4.0 * scale, 3.4 * scale), (30.0 * scale, 0.3), (-0.1, 3.0 * scale)),
        block((4.0 * scale, -3.4 * scale), (30.0 * scale, 0.3), (-0.1, 3.0 * scale)),
        block((4.0 * scale, 0.0), (30.0 * scale, 7.0 * scale), (3.0 * scale, 3.0 * scale + 0.3)),
        block((18.0 * scale, 0.0), (0.3, 7.0 * scale), (-0.1, 3.0 * scale)),
        block((-10.0 * scale, 0.0), (0.3, 7.0 * scale), (-0.1, 3.0 * scale)),
    )


def _wreck(random: np.random.Generator, scale: float) -> tuple[Solid, ...]:
    """A car across the tunnel: body, cabin and wheels; the laser sees the ground below it."""
    centre = scale * (np.array([4.6, -0.4]) + random.uniform(-0.2, 0.2, 2))
    yaw = random.uniform(0.9, 1.4)
    x, y = centre.tolist()
    wheels = turned(np.array([[-1.3, -0.7], [-1.3, 0.7], [1.3, -0.7], [1.3, 0.7]]), yaw) + centre
    return (
        block((x, y), (4.0, 1.7), (0.25, 0.85), yaw),
        block((x, y), (1.9, 1.5), (0.85, 1.4), yaw),
        *(block((wx, wy), (0.6, 0.2), (-0.1, 0.6), yaw) for wx, wy in wheels.tolist()),
    )


def _debris(
    random: np.random.Generator, scale: float, holes: tuple[Hole, ...], solids: tuple[Solid, ...]
) -> tuple[Solid, ...]:
    """Eight lumps that lie on the ground, clear of gaps, wreck, walls and robot."""

    def lump() -> Solid:
        x, y = scale * random.uniform([0.3, -2.8], [3.4, 2.8])
        size, height, yaw = random.uniform(0.1, 0.35, 2), random.uniform(0.05, 0.3), random.uniform(0, np.pi)
        return block((float(x), float(y)), (float(size[0]), float(size[1])), (-0.1, height), yaw)

    robot = shapely.Point(0, 0).buffer(0.8 * scale)
    taken = [*(hole.outline for hole in holes), *(solid.outline for solid in solids), robot]
    return _clear_of(shapely.union_all(taken), 8, lump)


def _people(random: np.random.Generator, stop: FloatArray, holes: tuple[Hole, ...]) -> tuple[Solid, ...]:
    """Two people in front of the robot, on firm ground."""

    def person() -> Solid:
        bearing, distance = stop[2] + random.uniform(-0.5, 0.5), random.uniform(1.05, 2.2)
        x, y = stop[0] + distance * np.cos(bearing), stop[1] + distance * np.sin(bearing)
        return column((float(x), float(y)), 0.22, 1.75)

    return _clear_of(shapely.union_all([hole.outline for hole in holes]), 2, person)


def _clear_of(taken: shapely.Geometry, count: int, draw: Callable[[], Solid]) -> tuple[Solid, ...]:
    """So many of what is drawn, 10 cm clear of what is there and of each other; fewer if there is no room."""
    placed: list[Solid] = []
    for _ in range(TRIES):
        thing = draw()
        if thing.outline.distance(taken) > 0.1:
            placed.append(thing)
            taken = shapely.union(taken, thing.outline)
        if len(placed) == count:
            break
    return tuple(placed)


def _shuffled(random: np.random.Generator, frames: int, scale: float) -> FloatArray:
    """Stops of a robot that cannot go anywhere: a few centimetres and degrees apart."""
    stops: FloatArray = random.uniform(-1, 1, (frames, 3)) * [0.05 * scale, 0.05 * scale, 0.12]
    return stops
