"""How lines look. Each differs by colour, marker and dashes, so that it reads without colour vision.

The colours here are those of the light page; in an SVG each stands for a variable of the style sheet.
"""

from dataclasses import dataclass
from typing import Any

INK, SOFT, RULE = "#1a1d22", "#565e69", "#d3d8de"  # words, less important words, lines of the grid

# Okabe and Ito's palette, darkened to a contrast of 3 : 1 with white; names as in style.css.
COLOURS = ("#0071b1", "#cf5b00", "#00805f", "#a23c82", "#876300", "#41474f", "#6a58c2")
VARIABLES = {INK: "--ink", SOFT: "--soft", RULE: "--rule"} | {
    colour: f"--line-{index}" for index, colour in enumerate(COLOURS)
}
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.6)),
    (0, (1.2, 1.4)),
    (0, (6, 1.6, 1.2, 1.6)),
    (0, (3, 1.2)),
    (0, (8, 2, 1.2, 2, 1.2, 2)),
    (0, (2, 2.4)),
)


@dataclass(frozen=True, slots=True)
class Look:
    """Of one line. faint: it stands behind others, and has no markers. joined: not markers alone."""

    number: int = 0
    faint: bool = False
    joined: bool = True

    @property
    def colour(self) -> str:
        return SOFT if self.faint else COLOURS[self.number % len(COLOURS)]

    @property
    def dashes(self) -> Any:
        """Of more lines than there are markers, those with equal markers differ in their dashes."""
        return DASHES[(self.number + self.number // len(MARKERS)) % len(DASHES)]

    def artist(self) -> dict[str, Any]:
        """As matplotlib's lines take it."""
        if self.faint:
            return {"color": SOFT, "ls": (0, (2.2, 1.8)), "lw": 1.0, "zorder": 2.5}
        number = self.number
        return {
            "color": self.colour,
            "ls": self.dashes if self.joined else "",
            "marker": MARKERS[number % len(MARKERS)],
            "ms": 4.6,
            "mew": 0,
            "lw": 1.5,
            "zorder": 3 + 0.01 * number,
        }
