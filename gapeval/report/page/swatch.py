"""A short piece of a line, for a legend beside words."""

import math

from gapeval.report.curves.style import MARKERS, VARIABLES, Look

MIDDLE, HALF = (17.0, 7.0), 4.0  # of a swatch of 34 x 14


def swatch(look: Look) -> str:
    """An inline SVG; decoration beside its words."""
    colour = f"var({VARIABLES[look.colour]})"
    dashes = (0, (2.2, 1.8)) if look.faint else look.dashes
    width = 1.2 if look.faint else 2.0
    pattern = "" if dashes == "-" else f' stroke-dasharray="{" ".join(f"{width * d:g}" for d in dashes[1])}"'
    line = (
        f'<path d="M1 7H33" fill="none" stroke="{colour}" stroke-width="{width:g}"{pattern}/>'
        if look.joined
        else ""
    )
    marker = (
        "" if look.faint else f'<path d="{_outline(MARKERS[look.number % len(MARKERS)])}" fill="{colour}"/>'
    )
    return f'<svg class="swatch" viewBox="0 0 34 14" aria-hidden="true">{line}{marker}</svg>'


def _outline(marker: str) -> str:
    """The path of a marker of matplotlib's name."""
    corners = {
        "s": (4, 45.0, 1.2),
        "D": (4, 0.0, 1.25),
        "^": (3, 90.0, 1.3),
        "v": (3, -90.0, 1.3),
        "P": (4, 45.0, 1.0),
        "X": (4, 0.0, 1.0),
    }
    x, y = MIDDLE
    if marker == "o":
        half = f"a{HALF:g} {HALF:g} 0 1 0"
        return f"M{x - HALF:g} {y:g}{half} {2 * HALF:g} 0{half} {-2 * HALF:g} 0z"
    count, first, size = corners[marker]
    if marker in "PX":
        turn = 45.0 if marker == "X" else 0.0
        places = [
            (HALF * 1.15 * a, HALF * 1.15 * b)
            for a, b in (
                (0.33, 1), (0.33, 0.33), (1, 0.33), (1, -0.33), (0.33, -0.33), (0.33, -1),
                (-0.33, -1), (-0.33, -0.33), (-1, -0.33), (-1, 0.33), (-0.33, 0.33), (-0.33, 1),
            )
        ]  # fmt: skip
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        places = [(c * a - s * b, s * a + c * b) for a, b in places]
    else:
        angles = [math.radians(first + 360.0 * i / count) for i in range(count)]
        places = [(HALF * size * math.cos(angle), HALF * size * math.sin(angle)) for angle in angles]
    return "M" + "L".join(f"{x + a:.2f} {y - b:.2f}" for a, b in places) + "z"
