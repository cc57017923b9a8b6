#!/usr/bin/env python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Decimates the same particles in lock-step and, as the paper does, each boundary on its own, and
puts the two side by side: the tables of docs/lockstep_and_sequential.md.

    scripts/compare_schedules.py --cvmesh build/release/bin/cvmesh --data DATA --out /tmp/schedules

Every volume (bunny, cleaver_spheres, tooth and cgal_liver of the folder, as .nii.gz) is meshed at
every epsilon with both schedules, surfaces only. Where the sequential schedule fails, which it may,
the next seed is tried, for both. The second table tells how many of the first seeds came through on
one volume. Writes OUT/schedules.md and, in OUT/runs, every report; a run whose report exists is not
repeated. Exits with 1 when lock-step fails. Needs nothing but Python 3.
"""

import argparse
import pathlib
import sys

from reproduce_paper import Runner, markdown, stem

SCHEDULES = ("lock-step", "sequential")


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cvmesh", required=True, type=pathlib.Path)
    parser.add_argument("--data", required=True, type=pathlib.Path)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--volumes", nargs="+",
                        default=["bunny", "cleaver_spheres", "tooth", "cgal_liver"])
    parser.add_argument("--epsilons", nargs="+", type=float, default=[1, 2, 4])
    parser.add_argument("--seeds", type=int, default=5, help="tried, and counted in the second table")
    parser.add_argument("--seeds-of", default="tooth", metavar="VOLUME",
                        help="volume of the second table")
    return parser.parse_args()


class Comparison:
    """Runs of one folder, by volume, epsilon, seed and schedule."""

    def __init__(self, arguments):
        self.data, self.seeds = arguments.data, arguments.seeds
        self.runner = Runner(arguments.cvmesh, arguments.out / "runs", ["--surface-only"])
        self.failed = set()

    def report(self, volume, epsilon, seed, schedule):
        key = volume, epsilon, seed, schedule
        if key in self.failed:
            return None
        settings = [f"epsilon={epsilon:g}", f"seed={seed}", f'schedule="{schedule}"']
        report, _ = self.runner.report(self.data / f"{volume}.nii.gz", settings)
        if report is None:
            self.failed.add(key)
        return report

    def seed_that_comes_through(self, volume, epsilon):
        """The first seed with which the sequential schedule ends; none where no seed does."""
        for seed in range(1, self.seeds + 1):
            if self.report(volume, epsilon, seed, "sequential"):
                return seed
        return None

    def has_failed_in_lock_step(self):
        return any(schedule == "lock-step" for *_, schedule in self.failed)


def seconds_of(report, *stages):
    return sum(s["seconds"] for s in report["timings"]["stages"] if s["stage"] in stages)


def row_of(report):
    results = report["results"]
    distance = results["distances"]["to_dense"]["voxels"]
    shape = results["quality"]["triangles"]["radius_ratio"]
    row = [f'{results["mesh"]["surface_vertices"]:,}',
           f'{distance["mean_symmetric"]:.4f} / {distance["hausdorff_lower_bound"]:.2f}',
           f'{shape["mean"]:.3f} / {shape["min"]:.2f}',
           f'{seconds_of(report, "decimation", "edge conformity"):.1f}']
    conformity = results["stages"].get("edge_conformity")
    if conformity is None:
        return row + [""] * 4
    return row + [f'{conformity["edges_differing"]:,} of {conformity["edges"]:,}',
                  f'{conformity["flips"]:,}', str(conformity["edges_given_up"]),
                  str(conformity["boundaries_repeated"])]


def figures(comparison, volumes, epsilons):
    rows = []
    for volume in volumes:
        for epsilon in epsilons:
            seed = comparison.seed_that_comes_through(volume, epsilon)
            name = f"{stem(pathlib.Path(volume))}, {epsilon:g}"
            if seed is not None and seed > 1:
                name += f", seed {seed}"
            for schedule in SCHEDULES:
                report = comparison.report(volume, epsilon, seed or 1, schedule)
                cells = row_of(report) if report else ["failed"] + [""] * 7
                rows.append([name if schedule == SCHEDULES[0] else "", schedule] + cells)
    return markdown(["volume, epsilon", "schedule", "vertices", "distance in voxels, mean / max",
                     "2r/R, mean / min", "decimation, s", "edges differing", "flips", "given up",
                     "repeated"], rows)


def successes(comparison, volume, epsilons):
    rows = []
    for epsilon in epsilons:
        counts = [sum(comparison.report(volume, epsilon, seed, schedule) is not None
                      for seed in range(1, comparison.seeds + 1)) for schedule in SCHEDULES]
        rows.append([f"{epsilon:g}"] + [f"{count} of {comparison.seeds}" for count in counts])
    return markdown([f"{volume}, epsilon"] + [f"{schedule} came through" for schedule in SCHEDULES],
                    rows)


def main():
    arguments = parse_arguments()
    arguments.out.mkdir(parents=True, exist_ok=True)
    comparison = Comparison(arguments)
    text = figures(comparison, arguments.volumes, arguments.epsilons)
    text += "\n" + successes(comparison, arguments.seeds_of, arguments.epsilons)
    (arguments.out / "schedules.md").write_text(text, encoding="utf-8")
    print(text)
    return 1 if comparison.has_failed_in_lock_step() else 0


if __name__ == "__main__":
    sys.exit(main())
