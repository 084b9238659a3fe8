"""Lines with bands over logarithmic axes as SVG, as the program's own plots look."""

import math

WIDTH, HEIGHT = 640, 420
LEFT, RIGHT, TOP, BOTTOM = 84, 625, 14, 365
# Distinguishable with red-green blindness (Okabe and Ito 2008), as in src/report/plot.rs.
COLORS = ["#505050", "#E69F00", "#0072B2", "#009E73", "#CC79A7", "#D55E00"]


class Axis:
    """From values to pixels; `ticks` are values and their words."""

    def __init__(self, low, high, ticks, begin, end, logarithmic=True):
        self.scale = math.log10 if logarithmic else float
        self.low, self.high = self.scale(low), self.scale(high)
        self.ticks, self.begin, self.end = ticks, begin, end

    def __call__(self, value):
        part = (self.scale(value) - self.low) / (self.high - self.low)
        return self.begin + min(max(part, 0), 1) * (self.end - self.begin)


def text(x, y, words, anchor, more=""):
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" font-family="sans-serif" font-size="10" {more}>{words}</text>'


def line(points, color, width=1, more=""):
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline fill="none" stroke="{color}" stroke-width="{width}" points="{places}" {more}/>'


def frame(x, y, x_name, y_name):
    """Background, grid, axes and their words."""
    yield f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#FFFFFF"/>'
    middle = (TOP + BOTTOM) / 2
    yield text(20, middle, y_name, "middle", f'transform="rotate(270, 20, {middle:g})"')
    yield text((LEFT + RIGHT) / 2, 403, x_name, "middle")
    for value, words in x.ticks:
        yield line([(x(value), TOP), (x(value), BOTTOM)], "#000000", more='opacity="0.15"')
        yield text(x(value), BOTTOM + 16, words, "middle")
    for value, words in y.ticks:
        yield line([(LEFT, y(value)), (RIGHT, y(value))], "#000000", more='opacity="0.15"')
        yield text(LEFT - 8, y(value) + 3, words, "end")
    yield line([(LEFT, TOP), (LEFT, BOTTOM), (RIGHT, BOTTOM)], "#000000")


def plot(series, x_axis, y_axis, legend_at_top=True):
    """The SVG of `series`, (name, [(x, low, middle, high)]) each; axes are (name, low, high, ticks, logarithmic)."""
    x = Axis(*x_axis[1:4], LEFT, RIGHT, x_axis[4])
    y = Axis(*y_axis[1:4], BOTTOM, TOP, y_axis[4])
    parts = list(frame(x, y, x_axis[0], y_axis[0]))
    for index, (name, points) in enumerate(series):
        color = COLORS[index % len(COLORS)]
        band = [(x(at), y(high)) for at, _, _, high in points] + [(x(at), y(low)) for at, low, _, _ in reversed(points)]
        parts.append(f'<polygon fill="{color}" opacity="0.18" points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in band)}"/>')
        parts.append(line([(x(at), y(middle)) for at, _, middle, _ in points], color, 2))
        top = (TOP + 14 if legend_at_top else BOTTOM - 14 * len(series)) + 14 * index
        left = RIGHT - 170 if legend_at_top else LEFT + 12
        parts.append(line([(left, top), (left + 18, top)], color, 2))
        parts.append(text(left + 24, top + 3, name, "start"))
    body = "\n".join(parts)
    return f'<svg width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}" xmlns="http://www.w3.org/2000/svg">\n{body}\n</svg>\n'
