#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Measures local feature size, sizing and particles, and writes the tables as Markdown.

    scripts/bench_particles.py --bench build/release/bin/bench_particles \\
        --data ../shared/data --out /tmp/particles

Shapes with a known feature size; how evenly particles are spread on three volumes; the bunny at
growing epsilon; its time at growing numbers of particles, fitted by a power of that number and
drawn as growth.svg; and the energy after each sweep from both kinds of seeds. Times are those of
one run. Needs nothing but Python 3.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

SPREAD = [("bunny", 15361), ("tooth", 3981), ("femur_phantom", 21393)]  # volume, vertices
EPSILONS = [0.5, 1, 5]
GROWTH = [2000, 8000, 32000, 125000, 500000]  # vertices of the bunny
GROWTH_SWEEPS = 20  # at most, on one thread: times of equal work
HISTORY = [("bunny", 5000), ("tooth", 3981)]
HISTORY_SWEEPS = [1, 2, 3, 4, 6, 9, 12, 15, 18]


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bench", required=True, type=Path, help="bench_particles")
    parser.add_argument("--data", required=True, type=Path, help="folder of *.nii.gz volumes")
    parser.add_argument("--out", required=True, type=Path, help="folder for tables and picture")
    parser.add_argument("--threads", type=int, default=0, help="0: all; growth always uses one")
    return parser.parse_args()


def run(command):
    result = subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)
    if result.returncode != 0:
        sys.exit(
            f"bench_particles.py: {command[0]} ended with {result.returncode}: {result.stderr}"
        )
    return result.stdout


def measure(arguments, name, *options, threads=None):
    """The row of one volume."""
    command = [arguments.bench, "volume", arguments.data / f"{name}.nii.gz", *options]
    command += ["--threads", arguments.threads if threads is None else threads]
    return json.loads(run(command))


def table_head(*columns):
    return "| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|"


def add(lines, line):
    lines.append(line)
    print(line, flush=True)


def measure_spread(arguments, lines):
    spread = table_head(
        "volume", "particles", "edge/h mean", "sd", "min", "max", "nearest/h mean",
        "six neighbours", "guards", "loop guards", "on dense facet", "2r/R mean", "sd", "1 %",
        "min", "vertices kept",
    )
    times = table_head(
        "volume", "medial axis, s", "feature size, s", "sizing, s", "sheets, s", "seeds, s",
        "particles, s", "sweeps",
    )
    time_lines = []
    lines += ["## Spread", "", spread]
    for name, vertices in SPREAD:
        row = measure(arguments, name, "--vertices", vertices, "--sparse")
        shape = row["shape"]
        add(
            lines,
            f"| {name} | {row['particles']} | {row['edge_over_h_mean']:.3f} "
            f"| {row['edge_over_h_sd']:.3f} | {row['edge_over_h_min']:.3f} "
            f"| {row['edge_over_h_max']:.2f} | {row['nearest_over_h_mean']:.3f} "
            f"| {100 * row['six_neighbour_share']:.0f} % | {row['guards']} "
            f"| {row['loop_guards']} | {row['on_dense_facet']} | {shape['mean']:.3f} "
            f"| {shape['sd']:.3f} | {shape['p1']:.3f} | {shape['min']:.4f} | {row['kept']} |",
        )
        time_lines.append(
            f"| {name} | {row['medial_axis_s']:.2f} | {row['feature_size_s']:.2f} "
            f"| {row['sizing_s']:.2f} | {row['sheets_s']:.2f} | {row['seeds_s']:.2f} "
            f"| {row['particles_s']:.2f} | {row['sweeps']} |"
        )
    lines += ["", times, *time_lines, ""]


def measure_epsilons(arguments, lines):
    head = table_head(
        "bunny, epsilon", "particles", "edge/h mean", "sd", "six neighbours", "guards",
        "loop guards", "2r/R mean", "sd", "min", "vertices kept",
    )
    lines += ["## Epsilon", "", head]
    for epsilon in EPSILONS:
        row = measure(arguments, "bunny", "--epsilon", epsilon, "--sparse")
        shape = row["shape"]
        add(
            lines,
            f"| {epsilon:g} | {row['particles']} | {row['edge_over_h_mean']:.3f} "
            f"| {row['edge_over_h_sd']:.3f} | {100 * row['six_neighbour_share']:.0f} % "
            f"| {row['guards']} | {row['loop_guards']} | {shape['mean']:.3f} "
            f"| {shape['sd']:.3f} | {shape['min']:.3f} | {row['kept']} |",
        )
    lines.append("")


def fit_power(xs, ys):
    """Slope and value at x = 1 of the line through (log x, log y), least squares."""
    lx, ly = [math.log(x) for x in xs], [math.log(y) for y in ys]
    mx, my = sum(lx) / len(lx), sum(ly) / len(ly)
    slope = sum((a - mx) * (b - my) for a, b in zip(lx, ly)) / sum((a - mx) ** 2 for a in lx)
    return slope, math.exp(my - slope * mx)


def draw_growth(path, xs, ys, slope, factor):
    """Seconds over particles on logarithmic axes, as SVG, with the fitted power."""
    width, height, left, right, top, bottom = 580, 360, 64, 40, 20, 52
    x_range = [math.floor(math.log10(min(xs))), math.ceil(math.log10(max(xs)))]
    y_range = [math.floor(math.log10(min(ys))), math.ceil(math.log10(max(ys)))]

    def place(value, limits, start, length):
        return start + length * (math.log10(value) - limits[0]) / (limits[1] - limits[0])

    def x_of(value):
        return place(value, x_range, left, width - left - right)

    def y_of(value):
        return place(value, y_range, height - bottom, top + bottom - height)

    svg = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for power in range(x_range[0], x_range[1] + 1):
        x = x_of(10**power)
        svg.append(f'<path d="M{x:.1f} {top}V{height - bottom}" stroke="#ddd"/>')
        y = height - bottom + 18
        svg.append(f'<text x="{x:.1f}" y="{y}" text-anchor="middle">{10**power:,}</text>')
    for power in range(y_range[0], y_range[1] + 1):
        y = y_of(10**power)
        svg.append(f'<path d="M{left} {y:.1f}H{width - right}" stroke="#ddd"/>')
        svg.append(f'<text x="{left - 8}" y="{y + 4:.1f}" text-anchor="end">{10.0**power:g}</text>')
    fitted = [(x_of(x), y_of(factor * x**slope)) for x in (xs[0], xs[-1])]
    svg.append(
        f'<path d="M{fitted[0][0]:.1f} {fitted[0][1]:.1f}L{fitted[1][0]:.1f} {fitted[1][1]:.1f}" '
        'stroke="#888" stroke-dasharray="5 4"/>'
    )
    svg += [
        f'<circle cx="{x_of(x):.1f}" cy="{y_of(y):.1f}" r="4.5" fill="#1f5fa8"/>'
        for x, y in zip(xs, ys)
    ]
    svg += [
        f'<text x="{left + 14}" y="{top + 24}">dashed: particles to the power {slope:.2f}</text>',
        f'<text x="{(left + width - right) / 2}" y="{height - 10}" text-anchor="middle">'
        "particles</text>",
        f'<text transform="translate(16 {(top + height - bottom) / 2}) rotate(-90)" '
        'text-anchor="middle">seeds and relaxation, s</text>',
        "</svg>",
    ]
    path.write_text("\n".join(svg) + "\n")


def measure_growth(arguments, lines):
    head = table_head(
        "particles", "seeds, s", "particles, s", "both per 1000 particles, s", "sweeps",
        "edge/h sd", "six neighbours",
    )
    lines += [f"## Growth: bunny, one thread, {GROWTH_SWEEPS} sweeps at most", "", head]
    particles, seconds = [], []
    for vertices in GROWTH:
        options = ["--vertices", vertices, "--sweeps", GROWTH_SWEEPS]
        row = measure(arguments, "bunny", *options, threads=1)
        particles.append(row["particles"])
        seconds.append(row["seeds_s"] + row["particles_s"])
        add(
            lines,
            f"| {row['particles']} | {row['seeds_s']:.2f} | {row['particles_s']:.2f} "
            f"| {1000 * seconds[-1] / particles[-1]:.3f} | {row['sweeps']} "
            f"| {row['edge_over_h_sd']:.3f} | {100 * row['six_neighbour_share']:.0f} % |",
        )
    slope, factor = fit_power(particles, seconds)
    lines += ["", f"Exponent of seconds over particles: {slope:.2f}.", ""]
    draw_growth(arguments.out / "growth.svg", particles, seconds, slope, factor)


def measure_history(arguments, lines):
    for name, vertices in HISTORY:
        rows = {
            seeding: measure(arguments, name, "--vertices", vertices, "--seeding", seeding)
            for seeding in ("front", "dense")
        }
        lines += [f"## Energy: {name}, {vertices} vertices", "", table_head("", *rows)]
        values = {
            "seeds": lambda row: f"{row['seeds']}",
            "particles at the end": lambda row: f"{row['particles']}",
            "sweeps": lambda row: f"{row['sweeps']}",
            "edge/h sd": lambda row: f"{row['edge_over_h_sd']:.3f}",
            "six neighbours": lambda row: f"{100 * row['six_neighbour_share']:.0f} %",
            "seeds, s": lambda row: f"{row['seeds_s']:.2f}",
            "thinning and sweeps, s": lambda row: f"{row['particles_s']:.2f}",
        }
        for n in HISTORY_SWEEPS:
            values[f"energy after sweep {n}"] = lambda row, n=n: (
                f"{row['energy'][n - 1]:.0f}" if n <= len(row["energy"]) else ""
            )
        values["energy at the end"] = lambda row: f"{row['energy'][-1]:.0f}"
        for title, value in values.items():
            add(lines, f"| {title} | " + " | ".join(value(row) for row in rows.values()) + " |")
        lines.append("")


def main():
    arguments = parse_arguments()
    arguments.out.mkdir(parents=True, exist_ok=True)
    lines = ["## Shapes", "", run([arguments.bench, "shapes"])]
    print(lines[-1], flush=True)
    measure_spread(arguments, lines)
    measure_epsilons(arguments, lines)
    measure_history(arguments, lines)
    measure_growth(arguments, lines)
    (arguments.out / "particles.md").write_text("\n".join(lines))
    print(f"wrote {arguments.out / 'particles.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
