#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""A box of two labels under tension whose modulus comes from an image that rises along it: cvmesh
samples the image, bins the modulus into materials, and CalculiX finds the elongation, which is known.
A test (label "slow").

    test_sampled_elasticity.py CVMESH OUT

Exits with 77 (skipped) where CalculiX or nibabel is not installed.
"""

import json
import math
import pathlib
import re
import shutil
import subprocess
import sys

SKIPPED = 77
try:
    import nibabel
    import numpy as np
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)

DIMS, SPACING_MM = (10, 10, 24), 1.0
# The image: 2 mm voxels in a frame of its own, value = 200 + 40 z; density in g/cm3 = value / 1000.
IMAGE_SPACING_MM, BASE, SLOPE = 2.0, 200.0, 40.0
FACTOR_MPA, BINS = 5000.0, 60
TENSION_MPA = 1.0


def make_images(out):
    labels = np.ones(DIMS, np.uint8)
    labels[:4] = 2
    nibabel.save(nibabel.Nifti1Image(labels, np.diag([SPACING_MM] * 3 + [1])), out / "bar.nii.gz")
    # Its axes run the other way, and it begins well outside of the bar.
    affine = np.diag([-IMAGE_SPACING_MM, IMAGE_SPACING_MM, -IMAGE_SPACING_MM, 1])
    affine[:3, 3] = (15, -5, 30)
    z = affine[2, 3] + affine[2, 2] * np.arange(20)
    values = np.broadcast_to(BASE + SLOPE * z, (12, 12, 20)).astype(np.float32)
    nibabel.save(nibabel.Nifti1Image(values, affine), out / "ct.nii.gz")


def make_deck(path):
    """Every node can move along z only, and the modulus has no cross strain: a bar."""
    text = path.read_text()
    low = re.findall(r"\*NSET, NSET=(N_\w+_EXTERIOR_ZMIN)\n", text)
    high = re.findall(r"\*SURFACE, NAME=(S_\w+_EXTERIOR_ZMAX),", text)
    nodes = re.findall(r"\*NSET, NSET=(N_\w+_EXTERIOR_ZMAX)\n", text)
    assert len(low) == len(high) == len(nodes) == 2, (low, high, nodes)
    lines = [f"*INCLUDE, INPUT={path.name}", "*BOUNDARY", "NALL, 1, 2"]
    lines += [f"{name}, 3, 3" for name in low]
    lines += ["*STEP", "*STATIC", "*DSLOAD"] + [f"{name}, P, {-TENSION_MPA}" for name in high]
    for name in nodes:
        lines += [f"*NODE PRINT, NSET={name}", "U"]
    (path.parent / "job.inp").write_text("\n".join(lines + ["*END STEP"]) + "\n")


def elongation():
    """The integral of tension / modulus along the bar, from half a voxel below to half above."""
    low, high = -0.5 * SPACING_MM, (DIMS[2] - 0.5) * SPACING_MM
    per_mm = FACTOR_MPA * SLOPE / 1000
    modulus = [FACTOR_MPA * (BASE + SLOPE * z) / 1000 for z in (low, high)]
    return TENSION_MPA / per_mm * math.log(modulus[1] / modulus[0])


def main():
    cvmesh, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    if shutil.which("ccx") is None:
        print("skipped: no ccx here; it is in Debian's package calculix-ccx")
        return SKIPPED
    out.mkdir(parents=True, exist_ok=True)
    make_images(out)
    laws = {"density_slope": 0.001, "modulus_factor": FACTOR_MPA, "bins": BINS, "poisson_ratio": 0}
    subprocess.run([cvmesh, "mesh", out / "bar.nii.gz", "--out", out, "--quiet", "--force", "--formats", "inp",
                    "--sample", out / "ct.nii.gz", "--set", "max_edge_mm=1.5",
                    "--set", "sample=" + json.dumps(laws)], check=True)
    make_deck(out / "bar.inp")
    done = subprocess.run(["ccx", "-i", "job"], cwd=out, text=True, stdout=subprocess.PIPE)
    if done.returncode != 0 or "*ERROR" in done.stdout:
        print(done.stdout)
        return 1
    rows = [line.split() for line in (out / "job.dat").read_text().splitlines()]
    found = np.mean([float(row[3]) for row in rows if len(row) == 4 and row[0].isdigit()])
    print(f"elongation {found:.6f} mm, by hand {elongation():.6f} mm")
    # Constant modulus in each of 60 bins and in tets of up to 1.5 mm: both well below a percent.
    well = abs(found / elongation() - 1) < 0.01
    print("ok" if well else "FAILED")
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
