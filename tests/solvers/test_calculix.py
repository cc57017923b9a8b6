#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Has CalculiX solve on a mesh of the example femur, as cvmesh wrote it with --formats inp, and
checks the forces: a press from above, and a pressure on an interface. A test (label "slow").

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
# With these the test takes less than half a minute.
SIZE, EPSILON = "small", "4"
# MPa by label; mm and MPa make forces N.
ELASTICITY = {1: 110000, 2: 2500, 3: 2, 4: 500, 5: 17000, 6: 10}
POISSON = 0.3
LOAD_N = 1000
PRESSURE_MPA = 1
ENDS_MM = 1.5  # how near to the lowest and highest z nodes are held and pressed
# No set name may come from this as it is.
HOSTILE = '"a\\"b<script>\\n*NODE"'
# The faces of a tet as the manual numbers them, from 0, seen from outside counter-clockwise.
FACES = {"S1": (0, 2, 1), "S2": (0, 1, 3), "S3": (1, 2, 3), "S4": (2, 0, 3)}


def run(command, **options):
    done = subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, **options)
    if done.returncode != 0:
        sys.exit(f"{done.stdout}\n{command[0]} ended with {done.returncode}")
    return done.stdout


def make_mesh(cvmesh, phantom, parameters, out):
    image = out / "femur.nii.gz"
    run([phantom, "femur", "--size", SIZE, "--out", image])
    run([cvmesh, "mesh", image, "--params", parameters, "--set", f"epsilon={EPSILON}", "--set",
         f"labels.6.name={HOSTILE}", "--formats", "inp", "--out", out, "--quiet"])
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
    results = ["*NODE PRINT, NSET=FIXED, TOTALS=ONLY", "RF", "*NODE PRINT, NSET=NALL", "U",
               "*END STEP"]
    lines += ["*STEP", "*STATIC", "*CLOAD", f"PRESSED, 3, {-LOAD_N / len(pressed)!r}"] + results
    lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW", "*DSLOAD", f"{surface}, P, {PRESSURE_MPA}"]
    return "\n".join(lines + results) + "\n"


def read_results(path):
    """Per step the total reaction and the displacements, a row per node."""
    forces, displacements = [], []
    rows = None
    for line in path.read_text().splitlines():
        words = line.split()
        if "total force" in line:
            rows = forces
        elif "displacements" in line:
            displacements.append([])
            rows = displacements[-1]
        elif words:
            rows.append([float(word) for word in words[-3:]])
    return np.array(forces), [np.array(rows) for rows in displacements]


def area_vector(nodes, elements, faces):
    """Sum of area times outward normal."""
    total = np.zeros(3)
    for element, face in faces:
        a, b, c = (nodes[elements[element][corner]] for corner in FACES[face])
        total += 0.5 * np.cross(b - a, c - a)
    return total


def check(what, is_true):
    print(("ok:     " if is_true else "FAILED: ") + what)
    return is_true


def main():
    cvmesh, phantom, parameters, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    if shutil.which("ccx") is None:
        print("skipped: no ccx here; it is in Debian's package calculix-ccx")
        return SKIPPED
    out.mkdir(parents=True, exist_ok=True)
    mesh = make_mesh(cvmesh, phantom, parameters, out)
    nodes, elements, label_of, surfaces = read_deck(mesh)
    print(f"{len(nodes)} nodes, {len(elements)} elements, sets {label_of}")
    z = {number: position[2] for number, position in nodes.items()}
    fixed = [number for number in z if z[number] < min(z.values()) + ENDS_MM]
    pressed = [number for number in z if z[number] > max(z.values()) - ENDS_MM]
    # Of stem and cement, which are far from the nodes that are held.
    name_of = {label: name[2:] for name, label in label_of.items()}
    surface = f"S_{name_of[2]}_{name_of[1]}"
    (out / "job.inp").write_text(job_deck(mesh, label_of, fixed, pressed, surface))

    threads = {**os.environ, "OMP_NUM_THREADS": "2"}
    log = run(["ccx", "-i", "job"], cwd=out, env=threads)
    forces, displacements = read_results(out / "job.dat")
    results = [check("all six labels have elements", sorted(label_of.values()) == [1, 2, 3, 4, 5, 6]),
               check("no *ERROR in CalculiX's output", "*ERROR" not in log),
               check("two steps", len(forces) == 2 and len(displacements) == 2)]
    if not all(results):
        print(log)
        return 1
    largest = [np.abs(rows).max() for rows in displacements]
    push = PRESSURE_MPA * area_vector(nodes, elements, surfaces[surface])
    print(f"largest displacements {largest} mm, reactions {forces.tolist()} N, pressure {push} N")
    results += [
        check("all displacements finite, one per node",
              all(rows.shape == (len(nodes), 3) and np.isfinite(rows).all()
                  for rows in displacements)),
        # The head is about 15 mm beside the shaft, a tube of radius 5 and 1 mm thick that is 60 mm
        # long: 1000 N x 15 mm / (17 GPa x pi x 5^3 mm4) bends it by 4 mm at its end.
        check("the press moves it by 0.4 to 40 mm", 0.4 < largest[0] < 40),
        check("the highest nodes go down", displacements[0][np.array(pressed) - 1, 2].max() < 0),
        check("reactions balance the press",
              np.abs(forces[0] - [0, 0, LOAD_N]).max() < 1e-3 * LOAD_N),
        # A pressure pushes the elements of the surface inwards, so the reaction points outwards.
        check("the pressure is no small force", np.linalg.norm(push) > 1),
        check("reactions balance the pressure on the interface",
              np.linalg.norm(forces[1] - push) < 1e-3 * np.linalg.norm(push)),
    ]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
