"""A log from above: the picture on which labels are drawn."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.config import Robot
from gapeval.detections import Detections
from gapeval.errors import GapevalError
from gapeval.files import write_whole
from gapeval.frame import FloatArray, Frame, Plane, Transform, robot_plane
from gapeval.labels import Labels, place
from gapeval.logs.read import Recording, read_frames
from gapeval.visibility import without_body

LOW, HIGH = -1.0, 1.0  # m above the ground: the ends of the colour scale
CEILING = 2.0  # m above the ground; what is higher would hide the ground
LARGEST = 200_000_000  # pixels


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A bird's-eye picture in a fixed frame, y up.

    pixels: (height, width, 4) uint8, blue, green, red, opacity. origin: x, y of the outer corner of the
    lower left pixel [m]. resolution: of a pixel [m].
    """

    pixels: NDArray[np.uint8]
    origin: tuple[float, float]
    resolution: float
    frame_id: str
    frames: int

    def write(self, folder: Path, name: str) -> tuple[Path, Path, Path]:
        """PNG, world file and sidecar. Raises GapevalError if they cannot be written."""
        picture, world, sidecar = (folder / f"{name}.{suffix}" for suffix in ("png", "pgw", "json"))
        height, width = self.pixels.shape[:2]
        left, top = self.origin[0], self.origin[1] + height * self.resolution
        half = self.resolution / 2  # a world file gives the centre of the upper left pixel
        numbers = (self.resolution, 0.0, 0.0, -self.resolution, left + half, top - half)
        about = {
            "image": picture.name,
            "frame_id": self.frame_id,
            "resolution": self.resolution,
            "origin": list(self.origin),
            "width": width,
            "height": height,
            "frames": self.frames,
            "colour": {"of": "lowest height above the ground [m]", "blue": LOW, "red": HIGH},
        }
        _, encoded = cv2.imencode(".png", self.pixels)
        for path, content in (
            (world, "".join(f"{number!r}\n" for number in numbers).encode()),
            (sidecar, (json.dumps(about, indent=2) + "\n").encode()),
            (picture, encoded.tobytes()),
        ):
            write_whole(path, content)
        return picture, world, sidecar


LABEL_COLOUR = (180, 0, 180, 255)
GAP_COLOUR = (255, 60, 0, 255)


def draw_outlines(
    picture: Picture, outlines: Iterable[BaseGeometry], colour: tuple[int, int, int, int]
) -> None:
    """Draw (Multi)Polygons of the fixed frame into a picture."""
    for ring in shapely.get_rings(shapely.get_parts(list(outlines))).tolist():
        places = (shapely.get_coordinates(ring) - picture.origin) / picture.resolution
        places[:, 1] = picture.pixels.shape[0] - places[:, 1]
        shifted = np.round((places - 0.5) * 16).astype(np.int32)  # pixel centres are whole numbers to OpenCV
        cv2.polylines(picture.pixels, [shifted.reshape(-1, 1, 2)], True, colour, 2, cv2.LINE_8, 4)


def label_outlines(labels: Labels, fixed_frame: str) -> list[BaseGeometry]:
    """The labels that were drawn in the fixed frame; those of the robot frame have no one place in it."""
    drawn = [label for label in labels.labels if label.frame_id == fixed_frame]
    return [place(label, Transform.identity(), robot_plane(0.0), "") for label in drawn]


def gap_outlines(detections: Detections) -> list[BaseGeometry]:
    """The gaps of all frames that have a pose, in the fixed frame."""
    return [
        shapely.transform(polygon, partial(_in_fixed_frame, frame.pose, frame.gap_plane))
        for frame in detections.frames
        if frame.pose is not None
        for polygon in frame.polygons
    ]


def _in_fixed_frame(pose: Transform, plane: Plane, places: FloatArray) -> FloatArray:
    return pose.apply(np.column_stack([places, plane.height(places)]))[:, :2]


def draw_log(
    recording: Recording, robot: Robot, resolution: float, reach: float, advance: Callable[[], object]
) -> Picture:
    """The lowest height above the ground in each pixel, of points within `reach` of the robot [m].

    Raises GapevalError for a log without a fixed frame, or one too large for this resolution.
    """
    poses = recording.scans.pose
    if poses is None or recording.fixed_frame is None:
        raise GapevalError(f"{recording.path}: no fixed frame to draw in; see `gapeval info`")
    low = np.floor((poses.translation[:, :2].min(axis=0) - reach) / resolution).astype(int)
    high = np.ceil((poses.translation[:, :2].max(axis=0) + reach) / resolution).astype(int)
    width, height = (high - low).tolist()
    if width * height > LARGEST:
        raise GapevalError(
            f"{recording.path}: {width} x {height} pixels are too many; use a larger --resolution "
            "or a smaller --range"
        )
    lowest = np.full(height * width, np.inf, dtype=np.float32)
    way, frames = [], 0
    for frame in read_frames(recording, 0, len(recording.scans)):
        advance()
        if isinstance(frame, Frame) and frame.pose is not None:
            places, heights = _ground_points(frame, frame.pose, robot, reach)
            column, row = (np.floor(places / resolution).astype(int) - low).T
            np.minimum.at(lowest, (height - 1 - row) * width + column, heights)
            way.append((frame.pose.translation[:2] / resolution - low).tolist())
            frames += 1
    if frames == 0:
        raise GapevalError(f"{recording.path}: no cloud could be used; see `gapeval info`")
    pixels = _colours(lowest.reshape(height, width))
    _draw_way(pixels, np.array(way))
    x, y = (low * resolution).tolist()
    return Picture(pixels, (x, y), resolution, recording.fixed_frame, frames)


def _ground_points(
    frame: Frame, pose: Transform, robot: Robot, reach: float
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Places (N, 2) in the fixed frame [m], and heights (N,) above the robot's plane [m]."""
    points = without_body(frame.points, robot.body)
    height = points[:, 2] - np.float32(robot.ground_z)
    near = (points[:, 0] ** 2 + points[:, 1] ** 2 < reach**2) & (height < CEILING)
    return pose.apply(points[near].astype(np.float64))[:, :2], height[near]


def _colours(lowest: NDArray[np.float32]) -> NDArray[np.uint8]:
    seen = np.isfinite(lowest)
    scaled = np.where(seen, (np.clip(lowest, LOW, HIGH) - LOW) / (HIGH - LOW) * 255, 0).astype(np.uint8)
    coloured = cv2.cvtColor(cv2.applyColorMap(scaled, cv2.COLORMAP_TURBO), cv2.COLOR_BGR2BGRA)
    coloured[~seen] = 0
    return np.asarray(coloured, dtype=np.uint8)


def _draw_way(pixels: NDArray[np.uint8], way: FloatArray) -> None:
    """The robot's way, with a dot where each cloud was taken; in pixels from the lower left corner."""
    down = np.column_stack([way[:, 0], pixels.shape[0] - way[:, 1]]).astype(np.int32)
    black = (0, 0, 0, 255)
    cv2.polylines(pixels, [down.reshape(-1, 1, 2)], False, black, 1)
    for x, y in down.tolist():
        cv2.circle(pixels, (x, y), 2, black, -1)
