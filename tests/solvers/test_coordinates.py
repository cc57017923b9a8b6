#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Where the mesh lies, in every format that cvmesh writes: volumes of two labels that fill their box
are meshed to that box exactly, so its corners and the place of each label are known from where ITK,
and for NIfTI nibabel, has the voxels of the file. Oblique, anisotropic, asymmetric volumes, mirrored
ones among them, as NIfTI, MetaImage and NRRD. A test (label "slow").

    test_coordinates.py CVMESH CVMESH_ITK_PLACE OUT

Exits with 77 (skipped) where meshio or nibabel is not installed.
"""

import base64
import itertools
import pathlib
import re
import subprocess
import sys
import xml.etree.ElementTree as tree

SKIPPED = 77
try:
    import meshio
    import nibabel
    import numpy as np
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)

TOLERANCE_MM = 1e-4
DIMS = (13, 10, 8)
SPACING = (0.7, 1.1, 1.6)
ORIGIN = (-31.25, 57.5, 12.75)
LPS = np.diag([-1.0, -1.0, 1.0])
FORMATS = ["vtu", "mesh", "inp", "msh", "msh22", "feb", "stl", "ply", "vtp"]


def rotation():
    """Turns about all three axes, by angles that are no fractions of a right angle."""
    matrix = np.eye(3)
    for axis, angle in enumerate((0.31, -0.52, 0.83)):
        turn = np.eye(3)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        turn[a, a] = turn[b, b] = np.cos(angle)
        turn[a, b], turn[b, a] = -np.sin(angle), np.sin(angle)
        matrix = matrix @ turn
    return matrix


def volume():
    """Label 2 in one corner, at none of the box's symmetries; label 1 elsewhere."""
    labels = np.ones(DIMS, np.uint8)
    labels[:8, :4, :3] = 2
    return labels


def write_nifti(path, labels, affine):
    image = nibabel.Nifti1Image(labels, affine)
    image.set_sform(affine, 1)
    nibabel.save(image, path)


def write_meta(path, labels, affine):
    """MetaImage says it in LPS: TransformMatrix has the direction of each axis in a row."""
    lps = LPS @ affine[:3, :3]
    spacing = np.linalg.norm(lps, axis=0)
    fields = {"ObjectType": "Image", "NDims": 3, "BinaryData": True, "BinaryDataByteOrderMSB": False,
              "TransformMatrix": " ".join(repr(float(x)) for x in (lps / spacing).T.ravel()),
              "Offset": " ".join(repr(float(x)) for x in LPS @ affine[:3, 3]),
              "ElementSpacing": " ".join(repr(float(x)) for x in spacing),
              "DimSize": " ".join(map(str, DIMS)), "ElementType": "MET_UCHAR",
              "ElementDataFile": "LOCAL"}
    text = "".join(f"{key} = {value}\n" for key, value in fields.items())
    path.write_bytes(text.encode() + labels.tobytes(order="F"))


def write_nrrd(path, labels, affine):
    columns = " ".join("(" + ",".join(repr(float(x)) for x in column) + ")"
                       for column in affine[:3, :3].T)
    origin = ",".join(repr(float(x)) for x in affine[:3, 3])
    head = ("NRRD0004\ntype: unsigned char\ndimension: 3\nspace: right-anterior-superior\n"
            f"sizes: {' '.join(map(str, DIMS))}\nspace directions: {columns}\n"
            f"space origin: ({origin})\nkinds: domain domain domain\nencoding: raw\n\n")
    path.write_bytes(head.encode() + labels.tobytes(order="F"))


# ---- where other programs have the voxels: from index to RAS ---------------------------------------

def affine_of_itk(itk_place, path):
    indices = np.vstack([np.zeros(3), np.eye(3)])
    done = subprocess.run([itk_place, path], check=True, text=True, stdout=subprocess.PIPE,
                          input="\n".join(" ".join(map(str, row)) for row in indices))
    points = np.array([line.split() for line in done.stdout.splitlines()], float) @ LPS
    affine = np.eye(4)
    affine[:3, :3] = (points[1:] - points[0]).T
    affine[:3, 3] = points[0]
    return affine


def affines_of(itk_place, path):
    """Name of the program, its affine, and to what relative error that keeps volumes."""
    if path.name.endswith(".nii.gz"):
        # ITK takes the spacing apart from the axes, and both in single precision.
        return [("ITK", affine_of_itk(itk_place, path), 1e-7),
                ("nibabel", nibabel.load(path).affine, 1e-9)]
    return [("ITK", affine_of_itk(itk_place, path), 1e-9)]


# ---- what a file holds: points, tets, label of each tet, space -----------------------------------

def tets_of(mesh, key):
    blocks = [(b.data, t) for b, t in zip(mesh.cells, mesh.cell_data[key]) if b.type == "tetra"]
    return np.concatenate([b for b, _ in blocks]), np.concatenate([t for _, t in blocks])


def space_in(path):
    return re.search(rb"SPACE=(\w+)", path.read_bytes()).group(1).decode()


def read_vtu(path):
    mesh = meshio.read(path)
    return (mesh.points, *tets_of(mesh, "labels"),
            bytes(mesh.field_data["SPACE"]).decode().rstrip("\0"))


def read_medit(path):
    mesh = meshio.read(path)
    return (mesh.points, *tets_of(mesh, "medit:ref"), space_in(path))


def read_gmsh(path):
    mesh = meshio.read(path)
    return (mesh.points, *tets_of(mesh, "gmsh:physical"), space_in(path))


def read_inp(path):
    mesh = meshio.read(path)
    label_of = {name: int(label) for name, label in
                re.findall(r"ELSET (\w+): label (-?\d+) ", path.read_text())}
    points, tets, labels = mesh.points, [], []
    for name, label in label_of.items():
        for block, rows in zip(mesh.cells, mesh.cell_sets[name]):
            if rows is None or block.type != "tetra":
                continue
            tets.append(block.data[rows])
            labels += [label] * len(rows)
    return points, np.concatenate(tets), np.array(labels), space_in(path)


def read_feb(path):
    text = path.read_text()
    label_of = {name: int(label) for name, label in
                re.findall(r"<!-- (\w+): label (-?\d+) ", text)}
    mesh = tree.fromstring(text).find("Mesh")
    points = np.array([[float(x) for x in node.text.split(",")] for node in mesh.find("Nodes")])
    tets, labels = [], []
    for part in mesh.findall("Elements"):
        for elem in part:
            tets.append([int(n) - 1 for n in elem.text.split(",")])
            labels.append(label_of[part.attrib["name"]])
    return points, np.array(tets), np.array(labels), space_in(path)


READERS = {".vtu": read_vtu, ".mesh": read_medit, ".inp": read_inp, ".msh": read_gmsh,
           ".v22.msh": read_gmsh, ".feb": read_feb}


def read_vtp_points(path):
    """The array "Points" of one of our files."""
    head = path.read_bytes()
    data = base64.b64decode(re.search(rb'Name="Points"[^>]*format="binary">([^<]*)<', head).group(1))
    assert int.from_bytes(data[:8], "little") == len(data) - 8
    codes = re.search(rb'Name="SPACE"[^>]*>([^<]*)<', head).group(1).split()
    space = bytes(int(code) for code in codes if int(code)).decode()
    return np.frombuffer(data[8:]).reshape(-1, 3), space


def read_surface_points(path):
    if path.suffix == ".vtp":
        return read_vtp_points(path)
    return meshio.read(path).points, space_in(path)


# ---- checks ------------------------------------------------------------------------------------------

def farthest_corner(points, affine):
    """How far the box's corners, half a voxel outside the outer voxel centres, are from a point."""
    worst = 0
    for corner in itertools.product(*((-0.5, n - 0.5) for n in DIMS)):
        place = affine[:3, :3] @ corner + affine[:3, 3]
        worst = max(worst, np.linalg.norm(points - place, axis=1).min())
    return worst


def check_tets(name, points, tets, labels, affine, volume_tolerance):
    image = volume()
    p = points[tets]
    volumes = np.linalg.det(p[:, 1:] - p[:, :1]) / 6
    box = abs(np.linalg.det(affine[:3, :3])) * np.prod(DIMS)
    centres = np.rint(np.linalg.solve(affine[:3, :3], (p.mean(axis=1) - affine[:3, 3]).T).T)
    wrong = volumes[image[tuple(centres.astype(int).T)] != labels].sum() / box
    corner = farthest_corner(points, affine)
    outside = np.abs(np.linalg.solve(affine[:3, :3], (points - affine[:3, 3]).T).T
                     - (np.array(DIMS) - 1) / 2) - np.array(DIMS) / 2
    faults = []
    if corner > TOLERANCE_MM:
        faults.append(f"a corner of the box is {corner} mm from any node")
    if outside.max() * max(SPACING) > TOLERANCE_MM:
        faults.append(f"a node lies {outside.max()} voxels outside")
    if volumes.min() <= 0:
        faults.append(f"{(volumes <= 0).sum()} tets are not positive")
    if abs(volumes.sum() / box - 1) > volume_tolerance:
        faults.append(f"the volume is {volumes.sum()} instead of {box} mm3")
    # Tets across the smoothed wall between the labels; a mirrored or shifted mesh has far more.
    if wrong > 0.05:
        faults.append(f"{wrong:.1%} of the volume lies in voxels of the other label")
    for fault in faults:
        print(f"FAILED {name}: {fault}")
    return not faults


def check_space(name, space, wanted):
    if space == wanted:
        return True
    print(f"FAILED {name}: states the space {space} instead of {wanted}")
    return False


def mesh_in_spaces(cvmesh, path, native, out):
    """Meshes an image in its own space, `native`, and in all others; pairs of folder and space."""
    for option, space in (("input", native), ("ras", "RAS"), ("lps", "LPS"), ("grid", "grid")):
        folder = out / option
        subprocess.run([cvmesh, "mesh", path, "--out", folder, "--space", option, "--quiet", "--force",
                        "--set", "epsilon=2", "--formats", ",".join(FORMATS)], check=True)
        yield folder, space


def check_files(folder, stem, space, world, volume_tolerance, what):
    """All formats; `world` is the affine from indices to the space."""
    all_well = True
    for suffix, reader in READERS.items():
        name = f"{what}, {suffix}"
        points, tets, labels, stated = reader(folder / (stem + suffix))
        all_well &= check_space(name, stated, space)
        all_well &= check_tets(name, points, tets, labels, world, volume_tolerance)
    for suffix in (".stl", ".ply", ".vtp"):
        points, stated = read_surface_points(folder / f"{stem}.label_1{suffix}")
        name = f"{what}, label_1{suffix}"
        all_well &= check_space(name, stated, space)
        # Label 2 has one corner of the box for itself.
        others = read_surface_points(folder / f"{stem}.label_2{suffix}")[0]
        corner = farthest_corner(np.concatenate([points, others]), world)
        if corner > TOLERANCE_MM:
            print(f"FAILED {name}: a corner of the box is {corner} mm from any vertex")
            all_well = False
    return all_well


def world_of(space, affine):
    """From indices to a space; `affine` goes to RAS."""
    world = np.eye(4)
    if space == "grid":
        # Along the voxels' own axes, from the first voxel's centre.
        world[:3, :3] = np.diag(np.linalg.norm(affine[:3, :3], axis=0))
    else:
        world[:3] = (LPS if space == "LPS" else np.eye(3)) @ affine[:3]
    return world


def check_volume(cvmesh, itk_place, path, native, out):
    all_well = True
    affines = affines_of(itk_place, path)
    for folder, space in mesh_in_spaces(cvmesh, path, native, out):
        for program, affine, volume_tolerance in affines:
            what = f"{path.name}, {folder.name}, by {program}"
            all_well &= check_files(folder, path.name.split(".")[0], space,
                                    world_of(space, affine), volume_tolerance, what)
    return all_well


def main():
    cvmesh, itk_place, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    all_well = True
    for is_mirrored in (False, True):
        affine = np.eye(4)
        affine[:3, :3] = rotation() @ np.diag(SPACING)
        if is_mirrored:
            affine[:3, 0] *= -1
        affine[:3, 3] = ORIGIN
        folder = out / ("mirrored" if is_mirrored else "upright")
        folder.mkdir(parents=True, exist_ok=True)
        write_nifti(folder / "nifti.nii.gz", volume(), affine)
        write_meta(folder / "meta.mha", volume(), affine)
        write_nrrd(folder / "nrrd.nrrd", volume(), affine)
        for name, native in (("nifti.nii.gz", "RAS"), ("meta.mha", "LPS"), ("nrrd.nrrd", "RAS")):
            well = check_volume(cvmesh, itk_place, folder / name, native,
                                folder / name.split(".")[0])
            print(("ok     " if well else "FAILED ") + f"{folder.name} {name}", flush=True)
            all_well &= well
    return 0 if all_well else 1


if __name__ == "__main__":
    sys.exit(main())
