#!/usr/bin/python3
# SPDX-License-Identifier: AGPL-3.0-or-later
"""Draws a tetrahedral mesh, cut open, as a PNG.

Whole tetrahedra on one side of a plane are shown (a "crinkle" cut), coloured by label, with their
edges. Needs python3-vtk9 and, where there is no display, xvfb with xauth:
scripts/install_dependencies.sh --rendering
"""

import argparse
import math
import os
import shutil
import sys

# Distinct hues of like brightness; label values pick them in ascending order and start again.
PALETTE = [
    (0.36, 0.49, 0.85), (0.95, 0.77, 0.31), (0.80, 0.33, 0.31), (0.97, 0.86, 0.72),
    (0.87, 0.87, 0.85), (0.42, 0.71, 0.52), (0.60, 0.44, 0.71), (0.90, 0.56, 0.35),
    (0.40, 0.72, 0.75), (0.71, 0.62, 0.46), (0.88, 0.58, 0.68), (0.55, 0.60, 0.64),
]
DIRECTIONS = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", help="NAME.vtu as cvmesh writes it")
    parser.add_argument("image", help="PNG to write")
    parser.add_argument("--normal", default="y", metavar="x|y|z|X,Y,Z",
                        help="direction in which the mesh is cut away (default y)")
    parser.add_argument("--at", type=float, default=0.5, metavar="FRACTION",
                        help="place of the cut between the mesh's ends, 0 to 1 (default 0.5); "
                             "1 cuts nothing away")
    parser.add_argument("--turn", type=float, default=25, metavar="DEGREES",
                        help="turn of the camera around the up axis, away from the normal")
    parser.add_argument("--lift", type=float, default=15, metavar="DEGREES",
                        help="height of the camera")
    parser.add_argument("--lie", action="store_true",
                        help="turn the picture by 90 degrees, for long upright shapes")
    parser.add_argument("--hide", type=int, nargs="*", default=[], metavar="LABEL",
                        help="labels that are left out")
    parser.add_argument("--size", default="1000x700", metavar="WxH", help="pixels")
    return parser.parse_args()


def ensure_display():
    """Debian's VTK draws through X only: without a display, start again inside a virtual one."""
    if os.environ.get("DISPLAY"):
        return
    script = os.path.abspath(sys.argv[0])
    if shutil.which("xvfb-run") is None:
        sys.exit(f"{os.path.basename(script)}: no display and no xvfb-run; "
                 "run scripts/install_dependencies.sh --rendering")
    os.execvp("xvfb-run", ["xvfb-run", "-a", "-s", "-screen 0 1600x1200x24", sys.executable,
                           script] + sys.argv[1:])


def unit(vector):
    length = math.sqrt(sum(c * c for c in vector))
    if length == 0:
        sys.exit("render_mesh.py: --normal 0,0,0 has no direction")
    return tuple(c / length for c in vector)


def direction(text):
    if text in DIRECTIONS:
        return DIRECTIONS[text]
    try:
        parts = tuple(float(part) for part in text.split(","))
    except ValueError:
        parts = ()
    if len(parts) != 3:
        sys.exit(f"render_mesh.py: --normal {text} is neither x, y, z nor three numbers")
    return unit(parts)


def fit(renderer, camera, bounds, aspect):
    """Parallel projection, just wide enough for the box of the mesh."""
    view = camera.GetViewTransformMatrix()
    half = [0.0, 0.0]
    corners = [view.MultiplyPoint((bounds[i], bounds[2 + j], bounds[4 + k], 1))
               for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    for axis in (0, 1):  # the camera looks at the middle of the box, so the extent is symmetric
        half[axis] = max(abs(corner[axis]) for corner in corners)
    camera.ParallelProjectionOn()
    renderer.ResetCamera()
    camera.SetParallelScale(1.04 * max(half[1], half[0] / aspect))


def write_png(window, path):
    """Renders a window and writes what it shows."""
    from vtkmodules.vtkIOImage import vtkPNGWriter
    from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

    window.Render()
    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    writer = vtkPNGWriter()
    writer.SetInputConnection(grab.GetOutputPort())
    writer.SetFileName(path)
    writer.Write()


def main():
    arguments = parse_arguments()
    normal = direction(arguments.normal)
    width, height = (int(n) for n in arguments.size.split("x"))
    if not os.path.isfile(arguments.mesh):
        sys.exit(f"render_mesh.py: {arguments.mesh}: no such file")
    ensure_display()

    import vtkmodules.vtkInteractionStyle  # noqa: F401  (registers factories)
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.vtkCommonCore import vtkLookupTable
    from vtkmodules.vtkCommonDataModel import vtkPlane
    from vtkmodules.vtkFiltersCore import vtkThreshold
    from vtkmodules.vtkFiltersExtraction import vtkExtractGeometry
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader
    from vtkmodules.vtkRenderingCore import (
        vtkActor, vtkDataSetMapper, vtkRenderer, vtkRenderWindow)

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(arguments.mesh)
    reader.Update()
    grid = reader.GetOutput()
    labels = grid.GetCellData().GetArray("labels")
    if grid.GetNumberOfCells() == 0 or labels is None:
        sys.exit(f"render_mesh.py: {arguments.mesh}: no cells, or no cell array 'labels'")
    present = sorted({int(labels.GetTuple1(n)) for n in range(labels.GetNumberOfTuples())})
    grid.GetCellData().SetActiveScalars("labels")

    source = reader
    for label in arguments.hide:
        keep = vtkThreshold()
        keep.SetInputConnection(source.GetOutputPort())
        keep.SetInputArrayToProcess(0, 0, 0, 1, "labels")
        keep.SetLowerThreshold(label - 0.5)
        keep.SetUpperThreshold(label + 0.5)
        keep.SetThresholdFunction(vtkThreshold.THRESHOLD_BETWEEN)
        keep.SetInvert(True)
        source = keep

    bounds = grid.GetBounds()
    centre = [(bounds[2 * a] + bounds[2 * a + 1]) / 2 for a in range(3)]
    reach = sum(abs(normal[a]) * (bounds[2 * a + 1] - bounds[2 * a]) for a in range(3))
    if arguments.at < 1:
        plane = vtkPlane()
        plane.SetNormal(*normal)
        plane.SetOrigin(*(centre[a] + (arguments.at - 0.5) * reach * normal[a] for a in range(3)))
        cut = vtkExtractGeometry()
        cut.SetInputConnection(source.GetOutputPort())
        cut.SetImplicitFunction(plane)
        cut.ExtractInsideOn()
        cut.ExtractBoundaryCellsOn()  # whole tets, so that their shape can be seen
        source = cut

    skin = vtkDataSetSurfaceFilter()
    skin.SetInputConnection(source.GetOutputPort())
    # Colour by the place of a label in the list, so that neighbouring values differ.
    table = vtkLookupTable()
    table.IndexedLookupOn()
    table.SetNumberOfTableValues(len(present))
    for place, label in enumerate(present):
        table.SetAnnotation(label, str(label))
        table.SetTableValue(place, *PALETTE[place % len(PALETTE)], 1)
    mapper = vtkDataSetMapper()
    mapper.SetInputConnection(skin.GetOutputPort())
    mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray("labels")
    mapper.SetLookupTable(table)
    mapper.UseLookupTableScalarRangeOn()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().EdgeVisibilityOn()
    actor.GetProperty().SetEdgeColor(0.15, 0.15, 0.2)
    actor.GetProperty().SetLineWidth(1)
    actor.GetProperty().SetInterpolationToFlat()
    actor.GetProperty().SetAmbient(0.25)
    actor.GetProperty().SetDiffuse(0.8)

    renderer = vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor)
    camera = renderer.GetActiveCamera()
    up = (0, 0, 1) if abs(normal[2]) < 0.9 else (0, 1, 0)
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*(centre[a] + normal[a] for a in range(3)))
    camera.SetViewUp(*up)
    camera.Azimuth(arguments.turn)
    camera.Elevation(arguments.lift)
    camera.OrthogonalizeViewUp()
    if arguments.lie:
        camera.Roll(90)
    fit(renderer, camera, bounds, width / height)

    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.SetSize(width, height)
    window.AddRenderer(renderer)
    write_png(window, arguments.image)
    print(f"{arguments.image}: {grid.GetNumberOfCells()} tets, labels "
          + " ".join(str(label) for label in present))


if __name__ == "__main__":
    main()
