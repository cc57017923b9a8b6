#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Has CalculiX solve on meshes of the example femur, of first and of second order, as cvmesh wrote
them with --formats inp, and checks the forces: a press from above, and a pressure on an interface.
A test (label "slow").

    test_calculix.py CVMESH CVMESH_PHANTOM PARAMETERS OUT

Exits with 77 (skipped) where CalculiX is not installed.
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np

SKIPPED = 77
# With these the test takes about half a minute.
SIZE, EPSILON = "small", "4"
ORDERS = {"first order": ["element_order=1"],
          "second order, curved": ["element_order=2", "curved_elements=true"]}
# MPa by label; mm and MPa make forces N.
ELASTICITY = {1: 110000, 2: 2500, 3: 2, 4: 500, 5: 17000, 6: 10}
POISSON = 0.3
LOAD_N = 1000
PRESSURE_MPA = 10
ENDS_MM = 1.5  # how near to the lowest and highest z nodes are held and pressed
# No set name may come from this as it is.
HOSTILE = '"a\\"b<script>\\n*NODE"'
# The faces of a tet as the manual numbers them, from 0, seen from outside counter-clockwise, and
# the place of the node between two corners.
FACES = {"S1": (0, 2, 1), "S2": (0, 1, 3), "S3": (1, 2, 3), "S4": (2, 0, 3)}
MIDDLE = {(0, 1): 4, (1, 2): 5, (0, 2): 6, (0, 3): 7, (1, 3): 8, (2, 3): 9}


def run(command, **options):
    done = subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, **options)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\n{command[0]} ended with {done.returncode}")
    return done.stdout


def make_mesh(cvmesh, image, parameters, settings, out):
    command = [cvmesh, "mesh", image, "--params", parameters, "--formats", "inp", "--out", out, "--force",
               "--quiet", "--force"]
    for setting in [f"epsilon={EPSILON}", f"labels.6.name={HOSTILE}"] + settings:
        command += ["--set", setting]
    run(command)
    return out / "femur.inp"


def read_deck(path):
    """Nodes (number -> position), elements, the label of each ELSET, and the surfaces."""
    nodes, elements, surfaces, label_of = {}, {}, {}, {}
    keyword = []
    for line in path.read_text().splitlines():
        comment = re.match(r"\*\* ELSET (\S+): label (-?\d+) ", line)
        if comment:
            label_of[comment.group(1)] = int(comment.group(2))
        if line.startswith("**"):
            continue
        words = line.split(", ")
        if line.startswith("*"):
            keyword = words
        elif keyword[0] == "*NODE":
            nodes[int(words[0])] = np.array([float(word) for word in words[1:]])
        elif keyword[0] == "*ELEMENT":
            elements[int(words[0])] = [int(word) for word in words[1:]]
        elif keyword[0] == "*SURFACE":
            name = keyword[1].split("=")[1]
            surfaces.setdefault(name, []).append((int(words[0]), words[1]))
    return nodes, elements, label_of, surfaces


def set_lines(name, numbers):
    rows = [numbers[i:i + 16] for i in range(0, len(numbers), 16)]
    return [f"*NSET, NSET={name}"] + [", ".join(map(str, row)) for row in rows]


def job_deck(mesh, label_of, fixed, pressed, surface):
    lines = [f"*INCLUDE, INPUT={mesh.name}"]
    lines += set_lines("FIXED", fixed) + set_lines("PRESSED", pressed)
    for name, label in label_of.items():
        lines += [f"*MATERIAL, NAME=M{label}", "*ELASTIC", f"{ELASTICITY[label]}, {POISSON}",
                  f"*SOLID SECTION, ELSET={name}, MATERIAL=M{label}"]
    lines += ["*BOUNDARY", "FIXED, 1, 3"]
    lines += ["*STEP", "*STATIC", "*CLOAD", f"PRESSED, 3, {-LOAD_N / len(pressed)!r}",
              "*DSLOAD", f"{surface}, P, {PRESSURE_MPA}",
              "*NODE PRINT, NSET=FIXED, TOTALS=ONLY", "RF", "*NODE PRINT, NSET=NALL", "U",
              "*END STEP"]
    return "\n".join(lines) + "\n"


def read_results(path):
    """The total reaction, one row, and the displacements, a row per node."""
    forces, displacements = [], []
    rows = None
    for line in path.read_text().splitlines():
        words = line.split()
        if "total force" in line:
            rows = forces
        elif "displacements" in line:
            rows = displacements
        elif words:
            rows.append([float(word) for word in words[-3:]])
    return np.array(forces), np.array(displacements)


def area_vector(nodes, elements, faces):
    """Integral of the outward normal: half that of x cross dx around each face, whose edges are
    parabolas, or straight where there are no nodes on them."""
    total = np.zeros(3)
    for element, face in faces:
        corners = FACES[face]
        at = [nodes[node] for node in elements[element]]
        for i, j in zip(corners, corners[1:] + corners[:1]):
            middle = at[MIDDLE[min(i, j), max(i, j)]] if len(at) == 10 else 0.5 * (at[i] + at[j])
            total += (np.cross(at[i], middle) + np.cross(middle, at[j])) * 2 / 3
            total -= np.cross(at[i], at[j]) / 6
    return total


def check(what, is_true):
    print(("ok:     " if is_true else "FAILED: ") + what)
    return is_true


def solve(mesh, nodes_per_element):
    """Solves on one mesh; whether all is as it should be."""
    nodes, elements, label_of, surfaces = read_deck(mesh)
    print(f"{len(nodes)} nodes, {len(elements)} elements, sets {label_of}")
    z = {number: position[2] for number, position in nodes.items()}
    lowest, highest = min(z.values()), max(z.values())
    fixed = [number for number in z if z[number] < lowest + ENDS_MM]
    pressed = [number for number in z if z[number] > highest - ENDS_MM]
    # Of stem and cement, which are far from the nodes that are held.
    name_of = {label: name[2:] for name, label in label_of.items()}
    surface = f"S_{name_of[2]}_{name_of[1]}"
    (mesh.parent / "job.inp").write_text(job_deck(mesh, label_of, fixed, pressed, surface))

    log = run(["ccx", "-i", "job"], cwd=mesh.parent, env={**os.environ, "OMP_NUM_THREADS": "2"})
    forces, displacements = read_results(mesh.parent / "job.dat")
    results = [check("all six labels have sets", sorted(label_of.values()) == sorted(ELASTICITY)),
               check("elements of the order that was asked for",
                     {len(element) for element in elements.values()} == {nodes_per_element}),
               check("no *ERROR in CalculiX's output", "*ERROR" not in log),
               check("one total of reactions, one displacement per node",
                     forces.shape == (1, 3) and displacements.shape == (len(nodes), 3))]
    if not all(results):
        print(log)
        return False
    largest = np.abs(displacements).max()
    push = PRESSURE_MPA * area_vector(nodes, elements, surfaces[surface])
    print(f"displacements up to {largest} mm, reactions {forces[0]} N, of the pressure {push} N")
    results += [
        check("all displacements finite", np.isfinite(displacements).all()),
        # The head is about 15 mm beside the shaft, a tube of radius 5 and 1 mm thick that is 60 mm
        # long: 1000 N x 15 mm / (17 GPa x pi x 5^3 mm4) bends it by 4 mm at its end.
        check("the loads move it by 0.4 to 40 mm", 0.4 < largest < 40),
        check("the highest nodes go down", displacements[np.array(pressed) - 1, 2].max() < 0),
        # A pressure pushes the elements of the surface inwards, so the reaction points outwards.
        check("the pressure is no small force", np.linalg.norm(push) > 10),
        check("reactions balance the loads, to a thousandth of the smaller one",
              np.linalg.norm(forces[0] - push - [0, 0, LOAD_N]) < 1e-3 * np.linalg.norm(push)),
    ]
    return all(results)


def main():
    cvmesh, phantom, parameters, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    if shutil.which("ccx") is None:
        print("skipped: no ccx here; it is in Debian's package calculix-ccx")
        return SKIPPED
    out.mkdir(parents=True, exist_ok=True)
    image = out / "femur.nii.gz"
    run([phantom, "femur", "--size", SIZE, "--out", image])
    all_well = True
    for number, (order, settings) in enumerate(ORDERS.items(), 1):
        print(f"{order}:", flush=True)
        mesh = make_mesh(cvmesh, image, parameters, settings, out / f"order_{number}")
        all_well &= solve(mesh, {1: 4, 2: 10}[number])
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
