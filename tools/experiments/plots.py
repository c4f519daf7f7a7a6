"""Pictures of the experiments as SVG. The same numbers give the same bytes."""

import importlib

from session import Failed

HASH_SALT = "clerestory"
# Boxes and bars are drawn in pixels: thousands of paths are no picture.
PIXELS_PER_INCH = 110
WIDTH_IN = 7.2
# Times of one plot that want a logarithmic axis.
FAR_APART = 10
COLOURS = ["#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#7f7f7f"]


def pyplot():
    try:
        matplotlib = importlib.import_module("matplotlib")
    except ImportError:
        raise Failed("matplotlib is not installed for this Python", "run `python3 -m pip install matplotlib`") from None
    matplotlib.use("svg")
    matplotlib.rcParams.update(
        {
            "svg.hashsalt": HASH_SALT,
            "svg.fonttype": "path",
            "font.size": 9,
            "axes.grid": True,
            "grid.alpha": 0.3,
            "axes.spines.top": False,
            "axes.spines.right": False,
        }
    )
    return importlib.import_module("matplotlib.pyplot")


def save(plt, figure, path):
    figure.savefig(path, format="svg", dpi=PIXELS_PER_INCH, metadata={"Date": None, "Creator": None})
    plt.close(figure)


def curves(path, series, x_label, y_label):
    """Lines with circles: (label, points, circles) each."""
    plt = pyplot()
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 3.8), layout="constrained")
    ends = [points[-1][0] for _, points, _ in series]
    # Those that end early are no line on the scale of one that ends late.
    is_log = max(ends) > FAR_APART * min(ends) > 0
    for (label, points, circles), colour in zip(series, COLOURS * 3):
        points = [point for point in points if point[0] > 0] if is_log else points
        axes.plot(*zip(*points), color=colour, label=label, linewidth=1.4)
        axes.plot(*zip(*circles), "o", color=colour, markersize=4, markerfacecolor="white")
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    if is_log:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(plt.FuncFormatter(lambda value, _: f"{value:,.4g}"))
    else:
        axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside upper center", ncols=2 if len(series) <= 4 else 3, frameon=False)
    save(plt, figure, path)


def scaling(path, series, x_label, y_label, is_log=True, ideal=None):
    """Points joined by lines over a logarithmic x: (label, points) each. `ideal`: label and points of a dashed line."""
    plt = pyplot()
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 4.0), layout="constrained")
    if ideal:
        axes.plot(*zip(*ideal[1]), "--", color="#999999", label=ideal[0], linewidth=1)
    for (label, points), colour, mark in zip(series, COLOURS, "os^vDPX*"):
        axes.plot(*zip(*points), marker=mark, color=colour, label=label, markersize=4, linewidth=1.2)
    axes.set_xscale("log", base=2)
    if is_log:
        axes.set_yscale("log", base=2)
    for axis in (axes.xaxis, axes.yaxis) if is_log else (axes.xaxis,):
        axis.set_major_formatter(plt.FuncFormatter(lambda value, _: f"{value:,.4g}"))
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    save(plt, figure, path)


def growth(path, panels, x_label):
    """Panels side by side over a logarithmic x, y from 0: (y label, series of (label, points)) each."""
    plt = pyplot()
    figure, every = plt.subplots(1, len(panels), figsize=(WIDTH_IN, 3.4), layout="constrained", squeeze=False)
    for axes, (y_label, series) in zip(every[0], panels):
        for (label, points), colour, mark in zip(series, COLOURS, "os^v"):
            axes.plot(*zip(*points), marker=mark, color=colour, label=label, markersize=4, linewidth=1.2)
        axes.set_xscale("log")
        sizes = [x for x, _ in series[0][1]]
        axes.set_xticks(sizes, [f"{x / 1000:,.{0 if x >= 1e5 else 1}f}" for x in sizes])
        axes.minorticks_off()
        axes.set_xlabel(x_label)
        axes.set_ylabel(y_label)
        axes.set_ylim(0, 1.08 * max(y for _, points in series for _, y in points))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    save(plt, figure, path)


def plans(path, panels):
    """Boxes from above by colour: (title, boxes) each, boxes as `catalogue.boxes` gives them."""
    plt = pyplot()
    collections = importlib.import_module("matplotlib.collections")
    columns = 2 if len(panels) % 3 else 3
    lines = -(-len(panels) // columns)
    across, up = (max(box[i + 2] for box in panels[0][1]) - min(box[i] for box in panels[0][1]) for i in (0, 1))
    # Titles and labels besides the plan itself.
    height_in = min(6.0, 0.85 * WIDTH_IN / columns * up / across) + 0.5
    figure, every = plt.subplots(
        lines, columns, figsize=(WIDTH_IN, height_in * lines), layout="constrained", squeeze=False
    )
    # Those of timelines where they are enough; else neighbouring numbers get colours far apart.
    is_few = max(number for _, boxes in panels for *_, number in boxes) < len(COLOURS)
    many = plt.colormaps["tab20"]
    colour = lambda number: COLOURS[number] if is_few else many((7 * number) % 20)
    for axes in every.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, (title, boxes) in zip(every.flat, panels):
        # Walls from above are lines: the edge shows them.
        shapes = [[(a, b), (c, b), (c, d), (a, d)] for a, b, c, d, _ in boxes]
        paint = [colour(number) for *_, number in boxes]
        drawn = collections.PolyCollection(
            # Few colours, and no shades between them: a small picture.
            shapes,
            facecolors=paint,
            edgecolors=paint,
            linewidths=0.8,
            antialiaseds=False,
            rasterized=True,
        )
        axes.add_collection(drawn)
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.grid(False)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
    save(plt, figure, path)


def timelines(path, panels, x_label):
    """Bars of visits by worker: (title, bars, ends of iterations) each; a bar is (lane, begin s, end s)."""
    plt = pyplot()
    # Lanes are as high as a line of text.
    most = max(len({lane for lane, *_ in bars}) for _, bars, _ in panels)
    # What is shorter than a pixel is drawn as one: it would not be seen.
    least_s = max(end for _, bars, _ in panels for *_, end in bars) / (WIDTH_IN * PIXELS_PER_INCH)
    height_in = max(1.3, 0.5 + 0.16 * most) * len(panels) + 0.6
    figure, every = plt.subplots(
        len(panels), 1, figsize=(WIDTH_IN, height_in), layout="constrained", squeeze=False, sharex=True
    )
    for axes, (title, bars, ends) in zip(every[:, 0], panels):
        lanes = sorted({lane for lane, *_ in bars})
        for lane in lanes:
            own = sorted((begin, end) for at, begin, end in bars if at == lane)
            spans = [(begin, max(least_s, end - begin)) for begin, end in own]
            paint = [COLOURS[lane % len(COLOURS)] if i % 2 else "#b0c4de" for i in range(len(spans))]
            axes.broken_barh(spans, (lane - 0.4, 0.8), facecolors=paint, linewidth=0, rasterized=True)
        for end in ends:
            axes.axvline(end, color="black", linewidth=0.8, linestyle=":")
        axes.set_yticks(lanes, [f"worker {lane + 1}" for lane in lanes])
        axes.set_title(title, fontsize=9, loc="left")
        axes.grid(False)
    every[-1, 0].set_xlim(left=0)
    every[-1, 0].set_xlabel(x_label)
    save(plt, figure, path)
