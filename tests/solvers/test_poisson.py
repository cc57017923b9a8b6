#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Has GetFEM solve Poisson's equation -div(k grad u) = 1 on a ball of two materials, meshed by cvmesh
as Gmsh 2.2, whose answer is known, and checks that the error falls as the mesh gets finer. A test
(label "slow").

    test_poisson.py CVMESH OUT

Exits with 77 (skipped) where GetFEM or nibabel is not installed.
"""

import json
import pathlib
import subprocess
import sys

SKIPPED = 77
try:
    import getfem
    import nibabel
    import numpy as np
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)

INNER_MM, OUTER_MM = 9.0, 16.0
CONDUCTIVITY = {1: 0.25, 2: 1.0}  # of the inner and the outer material
TARGETS = (250, 1000, 4000)       # surface vertices
# Linear elements would let the error fall by 4 from one mesh to the next. Measured are 0.059, 0.023 and
# 0.016: the smoothed surface of the voxels is not quite a sphere, a part that no mesh takes away.
LEAST_FALL = (2, 1.3)
WALL = 1000  # a region of our own
MOST_ERROR = 0.018  # relative, L2, of the finest mesh


def make_volume(path):
    n = int(2 * OUTER_MM) + 9
    middle = (n - 1) / 2
    x = np.arange(n) - middle
    r = np.sqrt(x[:, None, None] ** 2 + x[None, :, None] ** 2 + x[None, None, :] ** 2)
    labels = np.where(r < INNER_MM, 1, np.where(r < OUTER_MM, 2, 0)).astype(np.uint8)
    affine = np.eye(4)
    affine[:3, 3] = -middle
    nibabel.save(nibabel.Nifti1Image(labels, affine), path)


def exact(p):
    """u of the points (3 x n): 0 on the outer sphere, flux continuous on the inner one."""
    r2 = (p ** 2).sum(axis=0)
    at_inner = (OUTER_MM ** 2 - INNER_MM ** 2) / (6 * CONDUCTIVITY[2])
    return np.where(r2 < INNER_MM ** 2,
                    (INNER_MM ** 2 - r2) / (6 * CONDUCTIVITY[1]) + at_inner,
                    (OUTER_MM ** 2 - r2) / (6 * CONDUCTIVITY[2]))


def tags_of(path):
    """Physical tags by name, as the file states them."""
    lines = path.read_text().splitlines()
    begin = lines.index("$PhysicalNames")
    rows = [line.split(" ", 2) for line in lines[begin + 2:lines.index("$EndPhysicalNames")]]
    return {name.strip('"'): int(tag) for _, tag, name in rows}


def solve(path):
    """The relative L2 error of the finite elements' answer."""
    tags = tags_of(path)
    mesh = getfem.Mesh("import", "gmsh", str(path))
    outer = mesh.outer_faces()
    mesh.set_region(WALL, outer)
    getfem.util("trace level", 0)
    u = getfem.MeshFem(mesh, 1)
    u.set_classical_fem(1)
    rule = getfem.MeshIm(mesh, getfem.Integ("IM_TETRAHEDRON(5)"))
    model = getfem.Model("real")
    model.add_fem_variable("u", u)
    for label, name in ((1, "inner"), (2, "outer")):
        model.add_initialized_data(f"k{label}", CONDUCTIVITY[label])
        model.add_linear_term(rule, f"k{label}*Grad_u.Grad_Test_u", tags[name])
    model.add_initialized_data("f", 1.0)
    model.add_source_term_brick(rule, "u", "f")
    # On the mesh's own boundary, near the sphere, u is what it is there.
    model.add_initialized_fem_data("wall", u, exact(u.basic_dof_nodes()))
    model.add_Dirichlet_condition_with_simplification("u", WALL, "wall")
    model.solve()
    values = model.variable("u")
    fine = getfem.MeshFem(mesh, 1)
    fine.set_classical_fem(3)
    truth = exact(fine.basic_dof_nodes())
    difference = getfem.compute_interpolate_on(u, values, fine) - truth
    norm = getfem.compute_L2_norm(fine, truth, rule)
    return getfem.compute_L2_norm(fine, difference, rule) / norm


def main():
    cvmesh, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    out.mkdir(parents=True, exist_ok=True)
    make_volume(out / "ball.nii.gz")
    errors = []
    for target in TARGETS:
        folder = out / str(target)
        subprocess.run([cvmesh, "mesh", out / "ball.nii.gz", "--out", folder, "--quiet", "--force",
                        "--formats", "msh22", "--set", f"target_vertices={target}",
                        "--set", "labels.1.name=inner", "--set", "labels.2.name=outer"], check=True)
        tets = json.loads((folder / "ball.metrics.json").read_text())["results"]["mesh"]["tets"]
        errors.append(solve(folder / "ball.v22.msh"))
        print(f"{target} surface vertices, {tets} tets: relative error {errors[-1]:.5f}", flush=True)
    well = errors[-1] < MOST_ERROR
    for coarse, fine, least in zip(errors, errors[1:], LEAST_FALL):
        well &= coarse / fine > least
    print("ok" if well else f"FAILED: errors {errors}")
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
