#!/usr/bin/env python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Compares what `cvmesh metrics` and the independent evaluator say about the same meshes, ours and
those of CGAL's Mesh_3; a test (label "slow").

    compare_evaluators.py CVMESH SHARED TOOLS OUT

SHARED has data/ and tools/; where it is not there the test is skipped (status 77). TOOLS gets the
tools, built once, OUT the meshes and the results. Every check must hold:

counts, validity  identical: tets, triangles, tets per label, inverted and flat tets, faces in more
                  than two tets, repeated tets, pairs of intersecting triangles; per label: closed
                  manifold, Euler numbers of boundary and tets, components, topology of the voxels
quality, volumes  to 1e-6: radius ratios, dihedral angles, their percentiles, counts of poor tets
maxima            the evaluator samples, 64 points and the corners of each voxel face and one point
                  in each triangle of at most half a voxel: its maximum may not exceed our upper
                  bound, nor stay below ours by more than the farthest that a point can be from its
                  samples (0.09 and 0.29 voxel)
means             within 4 of our standard errors and 0.004 voxel for the evaluator's regular pattern
"""

import json
import pathlib
import subprocess
import sys

# Volume, epsilon of our mesh, and sizes in voxels of the peer's facets and cells.
CASES = [
    ("cgal_tiny_12323", 1, 1.0),
    ("cgal_tiny_420", 1, 1.0),
    ("cleaver_spheres", 2, 3.0),
    ("cleaver_mickey", 2, 3.0),
    ("tooth", 4, 4.0),
]
RELATIVE = 1e-6
SUB = 8  # points along each side of a voxel face
GAP = {"mesh_to_reference": 0.29, "reference_to_mesh": 0.09}
MEAN_SLACK_VOX = 0.004


def run(*command, **options):
    return subprocess.run([str(word) for word in command], check=True, **options)


class Comparison:
    """Collects what differs on one mesh."""

    def __init__(self):
        self.faults = []
        self.checks = 0

    def holds(self, condition, text):
        self.checks += 1
        if not condition:
            self.faults.append(text)

    def equal(self, what, ours, theirs):
        self.holds(ours == theirs, f"{what}: {ours}, evaluator {theirs}")

    def near(self, what, ours, theirs):
        close = abs(ours - theirs) <= RELATIVE * max(1, abs(ours))
        self.holds(close, f"{what}: {ours}, evaluator {theirs}")

    def distribution(self, what, ours, theirs):
        keys = {"mean": "mean", "standard_deviation": "stddev", "min": "min", "max": "max"}
        keys.update({p: p for p in ("p1", "p5", "p25", "p50", "p75", "p95", "p99")})
        self.equal(f"{what} count", ours["count"], theirs["n"])
        for key, other in keys.items():
            if other in theirs:
                self.near(f"{what} {key}", ours[key], theirs[other])

    def distances(self, what, ours, theirs):
        for side, prefix in (("mesh_to_reference", "mesh_to_voxel"), ("reference_to_mesh", "voxel_to_mesh")):
            mine, largest, mean = ours[side], theirs[f"{prefix}_max"], theirs[f"{prefix}_mean"]
            upper = mine["max"] + mine["max_error"]
            self.holds(
                largest <= upper + 1e-6 and mine["max"] <= largest + GAP[side],
                f"{what} {side} max: {mine['max']} to {upper}, evaluator sampled {largest}",
            )
            self.holds(
                abs(mine["mean"] - mean) <= 4 * mine["mean_standard_error"] + MEAN_SLACK_VOX,
                f"{what} {side} mean: {mine['mean']} +- {mine['mean_standard_error']}, evaluator {mean}",
            )


def compare_label(check, entry, theirs):
    label = str(entry["label"])
    name = f"label {label}"
    if label not in theirs["materials"]:  # the mesher lost it
        check.equal(f"{name} tets", entry["tets"], 0)
        return
    solid, boundary = theirs["materials"][label]["solid"], theirs["materials"][label]["boundary"]
    mesh = entry["topology"]["mesh"]
    is_manifold = boundary["closed"] and boundary["edge_manifold"] and boundary["vertex_manifold"]
    check.equal(f"{name} closed manifold", mesh["is_closed_manifold"], is_manifold)
    check.equal(f"{name} boundary Euler", mesh["boundary_euler"], boundary["euler"])
    check.equal(f"{name} boundary components", mesh["boundary_components"], boundary["components"])
    check.equal(f"{name} components", mesh["components"], solid["components_face"])
    check.equal(f"{name} Euler", mesh["euler"], solid["euler"])
    voxels = entry["topology"]["voxels"]
    lattice = theirs["materials"][label]["voxels"]
    check.equal(f"{name} voxels' components", voxels["components"], lattice["components14"])
    check.equal(f"{name} voxels' Euler", voxels["euler"], lattice["euler14"])
    check.equal(f"{name} tets", entry["tets"], theirs["counts"]["tets_per_label"][label])
    volume = theirs["volumes"][label]
    check.near(f"{name} volume", entry["volume"]["mesh_mm3"] / volume["mesh_mm3"], 1)
    check.near(f"{name} volume error", entry["volume"]["relative_error"], volume["relative_error"])
    check.distances(
        name, entry["distances"]["to_labels"]["voxels"], theirs["distance"]["voxels"][label]
    )


def compare(ours, theirs):
    check = Comparison()
    results = ours["results"]
    counts, conformity = theirs["counts"], theirs["conformity"]
    check.equal("tets", results["mesh"]["tets"], counts["tets"])
    check.equal("points", results["mesh"]["points"], counts["vertices"])
    check.equal("unused points", ours["judged_mesh"]["unused_points"], counts["unused_vertices"])
    check.equal("triangles", results["mesh"]["surface_triangles"], counts["interface_triangles"])
    check.equal("surface vertices", results["mesh"]["surface_vertices"], counts["interface_vertices"])
    faults = ours["judged_mesh"]["tet_faults"]
    check.equal("inverted tets", faults["inverted"], theirs["orientation"]["minority"])
    check.equal("flat tets", faults["flat"], theirs["orientation"]["degenerate"])
    check.equal("crowded faces", faults["crowded_faces"], conformity["faces_in_more_than_2_tets"])
    check.equal("repeated tets", faults["repeated_tets"], conformity["duplicate_tets"])
    check.equal(
        "intersections",
        results["checks"]["surface_intersections"],
        theirs["self_intersections"]["pairs"],
    )
    check.equal(
        "topology of the lattice",
        results["checks"]["topology_as_lattice14"],
        theirs["verdict"]["topology_as_lattice14"],
    )
    check.equal(
        "all manifold",
        all(entry["topology"]["mesh"]["is_closed_manifold"] for entry in results["labels"]),
        theirs["verdict"]["materials_manifold"],
    )
    quality, tets = theirs["quality"], results["quality"]["tets"]
    check.distribution("tets 3r/R", tets["radius_ratio"], quality["tet_radius_ratio"])
    check.distribution("smallest dihedral", tets["min_dihedral_deg"], quality["min_dihedral_per_tet"])
    check.distribution("largest dihedral", tets["max_dihedral_deg"], quality["max_dihedral_per_tet"])
    check.distribution(
        "triangles 2r/R",
        results["quality"]["triangles"]["radius_ratio"],
        quality["triangle_radius_ratio_interface"],
    )
    for key, other in (
        ("below_5_deg", "tets_min_dihedral_below_5"),
        ("below_10_deg", "tets_min_dihedral_below_10"),
        ("below_20_deg", "tets_min_dihedral_below_20"),
        ("above_165_deg", "tets_max_dihedral_above_165"),
        ("dihedral_histogram_10_deg", "dihedral_histogram_10deg"),
    ):
        check.equal(key, tets[key], quality[other])
    check.distances(
        "all", results["distances"]["to_labels"]["voxels"], theirs["distance"]["voxels"]["all"]
    )
    for entry in results["labels"]:
        compare_label(check, entry, theirs)
    return check


def make_meshes(cvmesh, tools, data, out):
    """Pairs of a mesh and its volume."""
    for name, epsilon, size in CASES:
        volume = data / f"{name}.nii.gz"
        own = out / f"{name}.mesh"
        run(cvmesh, "mesh", volume, "--out", out, "--set", f"epsilon={epsilon}", "--formats", "mesh", "-q", "--force")
        yield own, volume
        header = json.loads((out / f"{name}.metrics.json").read_text())["input"]["spacing_mm"]
        length = size * min(header)
        peer = out / f"{name}_mesh3.mesh"
        run(
            *(tools / "peer_cgal_mesh3_seq", volume, peer, "--facet-size", length, "--cell-size", length),
            *("--facet-distance", length / 4, "--opt-time", 3),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        yield peer, volume


def main():
    cvmesh, shared, tools, out = map(pathlib.Path, sys.argv[1:5])
    data, build = shared / "data", shared / "tools" / "build.sh"
    if not build.exists() or not data.is_dir():
        print(f"compare_evaluators: skipped, no evaluator or no data in {shared}")
        return 77
    out.mkdir(parents=True, exist_ok=True)
    run(build, "--peer", tools, stdout=subprocess.DEVNULL)
    failed = meshes = 0
    for mesh, volume in make_meshes(cvmesh, tools, data, out):
        report = mesh.with_suffix(".judged.json")
        run(cvmesh, "metrics", mesh, volume, "--out", report, stdout=subprocess.DEVNULL)
        found = run(tools / "evalmesh", mesh, volume, "--sub", SUB, capture_output=True, text=True)
        mesh.with_suffix(".evalmesh.json").write_text(found.stdout)
        check = compare(json.loads(report.read_text()), json.loads(found.stdout))
        meshes += 1
        failed += bool(check.faults)
        print(f"{mesh.name}: {check.checks} comparisons, {len(check.faults)} differ")
        for fault in check.faults:
            print(f"  {fault}")
    print(f"{meshes} meshes, {failed} with differences")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
