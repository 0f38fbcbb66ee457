"""What each colour means: for what is drawn and for the legends."""

import colorsys

from gapeval.report.pictures.found import OBSTACLE, SHADED, UNSEEN

# Cells: in the stages, one for each of CELL_NAMES; from above, under all else.
STAGES = ("#e8dfc8", "#d9772b", "#a8a2b4", "#f2f3f5", "#1f5fd6", "#a9c6f7")
FILLS = {OBSTACLE: "#f3cfa4", SHADED: "#e3dfe8", UNSEEN: "#edeff2"}

ON_PLANE, ABOVE, BELOW = "#858d98", "#c2570c", "#0a7d8c"
GAP_EDGE, GAP_FILL, LABEL_EDGE = "#003cff", "#9dbdff", "#b400b4"
YES, NO = "#08802f", "#d1112b"
ROBOT, SENSOR, BOX, GRID = "#22262c", "#ffd43b", "#5a616b", "#c3c8d0"
CONTOUR = "#14181f"


def gap_colours(count: int) -> list[tuple[float, float, float]]:
    """As many different colours; those of neighbouring numbers are far apart in hue."""
    golden = (5**0.5 - 1) / 2
    return [
        colorsys.hls_to_rgb((0.6 + index * golden) % 1, (0.62, 0.5, 0.72)[index % 3], 0.7)
        for index in range(count)
    ]
