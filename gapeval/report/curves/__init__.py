"""Curves, heat maps and scatter plots: SVG for a page, in colours that the page decides, and PNG."""
