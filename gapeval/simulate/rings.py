"""The rings that a spinning sensor draws on level ground."""

import numpy as np

from gapeval.frame import FloatArray
from gapeval.simulate.sensors import Rolling, Sensor


def ring_radii(sensor: Sensor, x_min: float, r_max: float) -> FloatArray | None:
    """Where rings cross level ground straight ahead (R,), from x_min in the robot frame to r_max [m].

    From the sensor's foot, sorted. None for a sensor that has no rings.
    """
    if isinstance(sensor.pattern, Rolling):
        return None
    tilt = -np.arcsin(sensor.mount.matrix[2, 0])
    down = tilt - np.linspace(*sensor.pattern.elevations, sensor.pattern.rings)
    height = sensor.mount.translation[2] - sensor.robot.ground_z
    r = height / np.tan(down[(down > 0) & (down < np.pi / 2)])
    r = np.sort(r[(r + sensor.mount.translation[0] >= x_min) & (r < r_max)])
    return np.asarray(r, dtype=np.float64)


def ring_growth(sensor: Sensor, x_min: float, r_max: float) -> float | None:
    """How much wider each distance between rings is than the one before, straight ahead: the median.

    What delta_r is to the rows of the polar image (Section 4.2.1). None for a sensor that has no rings, and
    where fewer than three lie between x_min in the robot frame and r_max from the sensor's foot [m].
    """
    radii = ring_radii(sensor, x_min, r_max)
    if radii is None or len(radii) < 3:
        return None
    spacing = np.diff(radii)
    return float(np.median(spacing[1:] / spacing[:-1]))
