#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Has VTK's own readers open what cvmesh writes, .vtu, .vtp, .stl and .ply, and VTK's own filters
measure it: counts, labels, names, space, volumes, shapes, closedness, sampled arrays, pairs of
contact, second order. A test (label "slow").

    test_vtk.py CVMESH OUT

Exits with 77 (skipped) where VTK's Python or nibabel is not installed.
"""

import json
import pathlib
import subprocess
import sys
import xml.etree.ElementTree

SKIPPED = 77
try:
    import nibabel
    import numpy as np
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkFileOutputWindow, vtkOutputWindow
    from vtkmodules.vtkCommonDataModel import VTK_QUADRATIC_TETRA, VTK_TETRA
    from vtkmodules.vtkFiltersCore import vtkFeatureEdges, vtkMassProperties
    from vtkmodules.vtkFiltersVerdict import vtkMeshQuality
    from vtkmodules.vtkIOGeometry import vtkSTLReader
    from vtkmodules.vtkIOPLY import vtkPLYReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLReader, vtkXMLUnstructuredGridReader
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(SKIPPED)

DIMS, SPACING = (26, 24, 22), (1.0, 1.2, 0.9)
# Of the two halves of an ellipsoid, by label; the second one has to survive XML.
NAMES = {1: "soft tissue", 2: '</DataArray> & "Knochen" \u00e4'}
# The sampled image: BASE + GRADIENT . x, in the world's mm.
BASE, GRADIENT = 1000.0, np.array([3.0, -2.0, 5.0])
RELATIVE = 1e-9     # both sides compute with doubles
SINGLE = 1e-5       # .stl and .ply have floats, as has the sampled image


class Checks:
    """Prints what holds and remembers what does not."""

    def __init__(self):
        self.faults = 0

    def holds(self, what, is_true):
        print(("ok:     " if is_true else "FAILED: ") + what, flush=True)
        self.faults += not is_true

    def equal(self, what, found, wanted):
        is_equal = found == wanted
        self.holds(what if is_equal else f"{what}: {found} instead of {wanted}", is_equal)

    def near(self, what, found, wanted, relative=RELATIVE):
        error = np.max(np.abs(np.asarray(found) - wanted)) / np.max(np.abs(wanted))
        self.holds(f"{what}: relative difference {error:.2g}", error <= relative)


# ---- the meshes -----------------------------------------------------------------------------------

def make_images(out):
    x = np.indices(DIMS).transpose(1, 2, 3, 0)
    is_inside = (((x - (np.array(DIMS) - 1) / 2) / (9, 8, 7.5)) ** 2).sum(axis=3) < 1
    labels = is_inside * np.where(x[..., 0] > 13.8, 2, 1)
    affine = np.diag([*SPACING, 1.0])
    affine[:3, 3] = (-40, 25, 7.5)
    nibabel.save(nibabel.Nifti1Image(labels.astype(np.uint8), affine), out / "halves.nii.gz")
    # Coarser, and beginning outside of the volume.
    coarse = np.diag([2.0, 2.0, 2.0, 1.0])
    coarse[:3, 3] = affine[:3, 3] - 5
    places = np.indices((20, 22, 18)).transpose(1, 2, 3, 0) * 2.0 + coarse[:3, 3]
    values = (BASE + places @ GRADIENT).astype(np.float32)
    nibabel.save(nibabel.Nifti1Image(values, coarse), out / "image.nii.gz")


def make_mesh(cvmesh, out, name, settings, options):
    """The folder of the results, and what the report says of them."""
    folder = out / name
    command = [cvmesh, "mesh", out / "halves.nii.gz", "--out", folder, "--quiet", "--force"] + options
    names = [f"labels.{label}.name={json.dumps(name)}" for label, name in NAMES.items()]
    for setting in ["epsilon=1", *names, *settings]:
        command += ["--set", setting]
    subprocess.run(command, check=True)
    return folder, json.loads((folder / "halves.metrics.json").read_text())["results"]


# ---- what VTK says --------------------------------------------------------------------------------

def read(reader, path):
    if isinstance(reader, vtkXMLReader):
        # Raw data at the end of a file are no XML. Whether VTK finds them depends on its expat; so
        # this must hold where VTK would not mind, too.
        xml.etree.ElementTree.parse(path)
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def cell_array(data, name):
    return vtk_to_numpy(data.GetCellData().GetArray(name))


def quality(grid, measure):
    """One number per tet, by Verdict."""
    judge = vtkMeshQuality()
    judge.SetInputData(grid)
    getattr(judge, f"SetTetQualityMeasureTo{measure}")()
    judge.Update()
    return cell_array(judge.GetOutput(), "Quality")


def texts(data, name):
    """Strings of the field data: an array of strings, or of bytes with a 0 after each string."""
    array = data.GetFieldData().GetAbstractArray(name)
    if array.IsA("vtkStringArray"):
        return [array.GetValue(i) for i in range(array.GetNumberOfValues())]
    return bytes(vtk_to_numpy(array)).decode().split("\0")[:-1]


def check_fields(checks, what, data):
    checks.equal(f"{what}: SPACE", texts(data, "SPACE"), ["RAS"])
    checks.equal(f"{what}: values of the labels",
                 vtk_to_numpy(data.GetFieldData().GetArray("label_values")).tolist(), [1, 2])
    checks.equal(f"{what}: names of the labels", texts(data, "label_names"), list(NAMES.values()))


def check_tets(checks, grid, results):
    tets = results["mesh"]["tets"]
    checks.equal("tets", grid.GetNumberOfCells(), tets)
    checks.equal("all of them VTK's", set(vtk_to_numpy(grid.GetCellTypesArray())), {VTK_TETRA})
    labels, volumes = cell_array(grid, "labels"), quality(grid, "Volume")
    checks.equal("labels", set(labels), set(NAMES))
    checks.holds("all volumes positive", volumes.min() > 0)
    for entry in results["labels"]:
        is_mine = labels == entry["label"]
        checks.equal(f"tets of label {entry['label']}", is_mine.sum(), entry["tets"])
        checks.near(f"volume of label {entry['label']}", volumes[is_mine].sum(),
                    entry["volume"]["mesh_mm3"])
    shapes = results["quality"]["tets"]
    # Verdict's radius ratio is R / 3r. Its MinAngle passes over some of the six dihedral angles.
    for key, values in (("radius_ratio", 1 / quality(grid, "RadiusRatio")),
                        ("scaled_jacobian", quality(grid, "ScaledJacobian"))):
        found = [values.min(), values.max(), values.mean(), values.std()]
        wanted = [shapes[key][part] for part in ("min", "max", "mean", "standard_deviation")]
        checks.near(f"{key}: least, largest, mean, deviation", found, wanted, 1e-6)


def corners_of(grid):
    """Rows of four points: their indices and their places."""
    rows = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(grid.GetNumberOfCells(), -1)
    return rows[:, :4], vtk_to_numpy(grid.GetPoints().GetData())


def check_samples(checks, grid):
    tets, points = corners_of(grid)
    wanted = BASE + points[tets].mean(axis=1) @ GRADIENT
    checks.near("mean of a linear image: its value at the centre", cell_array(grid, "sample_mean"),
                wanted, SINGLE)
    checks.near("its median: near to that", cell_array(grid, "sample_median"), wanted, 0.02)
    # Of label 2 alone.
    is_mine = cell_array(grid, "labels") == 2
    density = cell_array(grid, "density_g_cm3")
    checks.near("density", density[is_mine], wanted[is_mine] / 1000, SINGLE)
    checks.near("modulus", cell_array(grid, "modulus_mpa")[is_mine], 7000 * density[is_mine] ** 1.5)
    checks.holds("no density in the other label", not density[~is_mine].any())


def check_contact(checks, grid, results):
    tets, points = corners_of(grid)
    labels = cell_array(grid, "labels")
    original = vtk_to_numpy(grid.GetPointData().GetArray("original_point"))
    is_copy = original != np.arange(len(original))
    checks.equal("points: those of the report and the copies",
                 len(points), results["mesh"]["points"] + is_copy.sum())
    checks.holds(f"{is_copy.sum()} copies lie where their originals do",
                 is_copy.any() and (points[original] == points).all())
    sides = [np.unique(tets[labels == label]) for label in NAMES]
    shared = np.intersect1d(*sides)
    joined = np.intersect1d(*(original[side] for side in sides))
    # The rim, too, is cut: there is no third label at it.
    checks.equal("points that both labels have, before the cut and after it",
                 (len(joined), len(shared)), (is_copy.sum(), 0))
    cut = results["stages"]["contacts"]
    checks.equal("copies: as reported", is_copy.sum(), cut["nodes_added"])


def check_closed(checks, what, surface, volume, relative):
    """Closed, manifold, and around this volume."""
    edges = vtkFeatureEdges()
    edges.SetInputData(surface)
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.Update()
    checks.equal(f"{what}: open or crowded edges", edges.GetOutput().GetNumberOfCells(), 0)
    mass = vtkMassProperties()
    mass.SetInputData(surface)
    mass.Update()
    checks.near(f"{what}: volume", mass.GetVolume(), volume, relative)


def check_surfaces(checks, folder, results):
    all_of_it = read(vtkXMLPolyDataReader(), folder / "halves.surface.vtp")
    check_fields(checks, "surface.vtp", all_of_it)
    # What was cut has a triangle on each side.
    checks.equal("surface.vtp: triangles", all_of_it.GetNumberOfPolys(),
                 results["mesh"]["surface_triangles"] + results["stages"]["contacts"]["facets_cut"])
    names = texts(all_of_it, "interface_names")
    checks.equal("surface.vtp: interfaces", set(cell_array(all_of_it, "interface")),
                 set(range(1, len(names) + 1)))
    for entry in results["labels"]:
        label, volume = entry["label"], entry["volume"]["mesh_mm3"]
        for suffix, reader, relative in ((".vtp", vtkXMLPolyDataReader(), RELATIVE),
                                         (".ply", vtkPLYReader(), SINGLE),
                                         (".stl", vtkSTLReader(), SINGLE)):
            what = f"label_{label}{suffix}"
            part = read(reader, folder / f"halves.{what}")
            checks.equal(f"{what}: triangles", part.GetNumberOfPolys(), entry["surface_triangles"])
            check_closed(checks, what, part, volume, relative)
        part = read(vtkXMLPolyDataReader(), folder / f"halves.label_{label}.vtp")
        checks.equal(f"label_{label}.vtp: SPACE", texts(part, "SPACE"), ["RAS"])


def check_stages(checks, folder):
    paths = sorted((folder / "halves.stages").glob("*.vtp"))
    checks.holds(f"{len(paths)} stages", len(paths) > 2)
    for path in paths:
        data = read(vtkXMLPolyDataReader(), path)
        at_points = data.GetPointData()
        arrays = [at_points.GetArray(i) for i in range(at_points.GetNumberOfArrays())]
        counts = data.GetNumberOfPoints(), data.GetNumberOfCells(), len(arrays)
        checks.equal(f"{path.name}: SPACE", texts(data, "SPACE"), ["RAS"])
        checks.holds("{}: {} points in {} cells, {} finite arrays".format(path.name, *counts),
                     min(counts) > 0 and
                     all(np.isfinite(vtk_to_numpy(array)).all() for array in arrays))


def check_second_order(checks, grid, results):
    checks.equal("second order: all of VTK's quadratic tets",
                 set(vtk_to_numpy(grid.GetCellTypesArray())), {VTK_QUADRATIC_TETRA})
    checks.equal("second order: tets", grid.GetNumberOfCells(), results["mesh"]["tets"])
    corners, points = corners_of(grid)
    rows = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 10)
    # VTK itself says which node lies on which edge.
    tet = grid.GetCell(0)
    nodes = tet.GetPointIds()
    edges = [[nodes.IsId(tet.GetEdge(k).GetPointId(i)) for i in range(3)] for k in range(6)]
    off = max(np.abs(points[rows[:, [a, b]]].mean(axis=1) - points[rows[:, middle]]).max()
              for a, b, middle in edges)
    checks.holds(f"second order: nodes {off:.1g} mm off the middles of VTK's edges", off < 1e-12)
    a, b, c, d = (points[corners[:, k]] for k in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)
    checks.holds("second order: corners in VTK's order", volumes.min() > 0)


def main():
    cvmesh, out = (pathlib.Path(word).absolute() for word in sys.argv[1:])
    out.mkdir(parents=True, exist_ok=True)
    make_images(out)
    complaints = out / "vtk.txt"
    complaints.unlink(missing_ok=True)
    window = vtkFileOutputWindow()
    window.SetFileName(str(complaints))
    window.SetFlush(True)
    vtkOutputWindow.SetInstance(window)

    laws = {"labels": [2], "density_slope": 0.001, "modulus_factor": 7000, "modulus_exponent": 1.5}
    checks = Checks()
    folder, results = make_mesh(
        cvmesh, out, "first_order", ["contact=[[1, 2]]", "sample=" + json.dumps(laws)],
        ["--formats", "vtu,vtp,stl,ply", "--sample", out / "image.nii.gz", "--keep-stages"])
    grid = read(vtkXMLUnstructuredGridReader(), folder / "halves.vtu")
    check_fields(checks, "vtu", grid)
    check_tets(checks, grid, results)
    check_samples(checks, grid)
    check_contact(checks, grid, results)
    check_surfaces(checks, folder, results)
    check_stages(checks, folder)
    folder, results = make_mesh(cvmesh, out, "second_order", ["element_order=2"], ["--formats", "vtu"])
    check_second_order(checks, read(vtkXMLUnstructuredGridReader(), folder / "halves.vtu"), results)
    said = complaints.read_text() if complaints.exists() else ""
    checks.equal("VTK's warnings and errors", said, "")
    return 1 if checks.faults else 0


if __name__ == "__main__":
    sys.exit(main())
