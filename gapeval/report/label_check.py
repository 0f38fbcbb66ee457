"""Labels held against the log that they were drawn for."""

import numpy as np
import shapely

from gapeval.config import Config
from gapeval.errors import LabelError
from gapeval.frame import robot_plane
from gapeval.labels import Label, Labels, Problem, place, require_frames
from gapeval.logs.read import Recording
from gapeval.scoring.scene import common_domain
from gapeval.sweep.grid import configurations


def problems_in_log(labels: Labels, recording: Recording, config: Config) -> list[Problem]:
    """Labels in frames or at times that the log does not have, or that the robot never comes near."""
    problems = []
    stamps = recording.scans.stamps
    reach = common_domain(configurations(config), config.scoring)[0].r_max
    for label in labels.labels:
        where = f"label {label.id}"
        try:
            alone = Labels(labels.path, labels.sha256, (label,), labels.stamps)
            require_frames(alone, recording.robot_frame, recording.fixed_frame)
        except LabelError as error:
            problems.append(Problem(where, str(error).removeprefix(f"{labels.path}: label {label.id} ")))
            continue
        held = [index for index, stamp in enumerate(stamps.tolist()) if label.holds_at(stamp)]
        if not held:
            problems.append(Problem(where, f"holds at no cloud of {recording.path.name}"))
        elif (nearest := _nearest(label, recording, config, held)) > reach:
            problems.append(
                Problem(
                    where,
                    f"is never nearer than {nearest:.1f} m to the robot, and r_max is {reach:g} m; "
                    "set detector.r_max with --config or -p",
                )
            )
    missing = sorted((labels.stamps or frozenset()) - set(stamps.tolist()))
    problems += [Problem("file", f"stamp {stamp} is no cloud of {recording.path.name}") for stamp in missing]
    return problems


def _nearest(label: Label, recording: Recording, config: Config, held: list[int]) -> float:
    """Smallest distance [m] between the robot and the label over the clouds at which it holds."""
    plane, poses = robot_plane(config.robot.ground_z), recording.scans.pose
    distances = []
    for index in held:
        pose = None if poses is None else poses.at(index)
        shape = place(label, pose, plane, recording.robot_frame)
        distances.append(float(shapely.distance(shape, shapely.Point(0.0, 0.0))))
    return float(np.min(distances))
